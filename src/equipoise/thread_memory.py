"""Thread-local working memory, for memory that is slow to create and cannot be shared."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable
from functools import lru_cache
from typing import Generic, TypeVar

Key = TypeVar("Key", bound=Hashable)
Made = TypeVar("Made")


class ThreadMemory(threading.local, Generic[Key, Made]):
    """Working memory of each thread, for its most recent keys.

    Args:
        make: function that creates the memory of a key.
        size: number of keys per thread.
    """

    def __init__(self, make: Callable[[Key], Made], size: int = 8) -> None:
        self.of: Callable[[Key], Made] = lru_cache(maxsize=size)(make)
