"""How a calibration tells what it is doing."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Progress:
    """What a calibration is about to do: in words, and how many trials are done of how many expected."""

    doing: str
    done: int
    expected: int
