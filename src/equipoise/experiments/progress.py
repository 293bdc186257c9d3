"""Progress of a calibration, for display."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Progress:
    """Description of the next motion, number of completed trials, and number of expected trials."""

    doing: str
    done: int
    expected: int
