"""Memory that is computed in: it takes longer to make than to use, and no two threads may use it at once."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable
from functools import lru_cache
from typing import Generic, TypeVar

Key = TypeVar("Key", bound=Hashable)
Made = TypeVar("Made")


class ThreadMemory(threading.local, Generic[Key, Made]):
    """Memory that each thread has made for itself, for the keys that it asked for last.

    Args:
        make: makes the memory of a key.
        size: of how many keys a thread keeps it.
    """

    def __init__(self, make: Callable[[Key], Made], size: int = 8) -> None:
        self.of: Callable[[Key], Made] = lru_cache(maxsize=size)(make)
