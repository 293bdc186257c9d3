"""Times on a grid of whole nanoseconds, equal in memory and in the stamp of a ROS message."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from equipoise.conventions import FloatArray

IntArray = NDArray[np.int64]

LONGEST = 2.0**31
"""Largest absolute time of a stamp [s]: 68 years."""
_SECOND = 10**9


def nanoseconds(time: FloatArray) -> IntArray:
    """Return seconds as whole nanoseconds; converting the fraction separately keeps the precision of times since 1970."""
    whole = np.floor(time)
    return np.asarray(whole, dtype=np.int64) * _SECOND + np.asarray(np.rint((time - whole) * 1e9), dtype=np.int64)


def seconds(time: IntArray) -> FloatArray:
    """Return whole nanoseconds as seconds, the inverse of `nanoseconds` for times of less than 97 days (2^23 s)."""
    whole, fraction = np.divmod(time, _SECOND)
    return np.asarray(whole + fraction / 1e9)


def rounded(time: FloatArray) -> FloatArray:
    """Return seconds rounded to whole nanoseconds. After 97 days a double has less precision."""
    return seconds(nanoseconds(time))
