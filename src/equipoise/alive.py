"""Signs of life of a program that thinks while it holds a robot up.

Whoever computes for long calls `alive` wherever a piece of the work is done, at most about a second apart on a slow computer.
The guard, which holds the robot meanwhile, and the watchdog know by it that the program has not hung: a thread that waits for
ever, runs in circles or was stopped gives no sign. Each thread's signs are its own; one that draws or writes vouches for none
that thinks.
"""

from __future__ import annotations

import threading
import time

_signs: dict[int, float] = {}


def alive() -> None:
    """A sign of life of the calling thread."""
    _signs[threading.get_ident()] = time.monotonic()


def last_sign(thread: int) -> float:
    """When a thread, by its identifier, gave its last sign, by the monotonic clock [s]; -inf if it never did."""
    return _signs.get(thread, -float("inf"))
