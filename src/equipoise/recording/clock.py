"""Times on a grid of whole nanoseconds: the same in memory as in the stamp of a ROS message."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from equipoise.conventions import FloatArray

IntArray = NDArray[np.int64]

LONGEST = 2.0**31
"""Largest time of a stamp, either way [s]: 68 years."""
_SECOND = 10**9


def nanoseconds(time: FloatArray) -> IntArray:
    """Return seconds as whole nanoseconds; the fraction is converted alone, which keeps the precision of times since 1970."""
    whole = np.floor(time)
    return np.asarray(whole, dtype=np.int64) * _SECOND + np.asarray(np.rint((time - whole) * 1e9), dtype=np.int64)


def seconds(time: IntArray) -> FloatArray:
    """Return whole nanoseconds as seconds. `nanoseconds` of it gives them back, for times of less than 97 days (2^23 s)."""
    whole, fraction = np.divmod(time, _SECOND)
    return np.asarray(whole + fraction / 1e9)


def rounded(time: FloatArray) -> FloatArray:
    """Seconds rounded to whole nanoseconds; rounding again changes nothing. Later than 97 days a double holds less."""
    return seconds(nanoseconds(time))
