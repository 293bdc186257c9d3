"""Ramps of commands."""

from __future__ import annotations

import numpy as np

from equipoise.conventions import FloatArray


def smooth_step(count: int) -> FloatArray:
    """Return (count,) values from just above 0 to 1, with velocity and acceleration zero at both ends (minimum jerk)."""
    s = np.arange(1, count + 1) / count
    return s**3 * (10 - 15 * s + 6 * s**2)
