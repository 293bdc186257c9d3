"""Resolution of encoders from their readings: a coarse encoder that repeats a reading for long is not frozen."""

from __future__ import annotations

import numpy as np

from equipoise.conventions import FloatArray

_COARSEST = 2 * np.pi / 1024
"""Step of an encoder of 10 bits [rad]; assumed if no encoder has shown a step."""
_STILL_STEPS = 30
"""Commanded travel of a loaded joint that need not turn by one step, in steps.

Targets move as the load does, and friction holds the joint: simulated A1, Go2, ANYmal C and Solo 12 with steps of 1.5 to
6 mrad have up to 16 steps of it.
"""


def smallest_steps(position: FloatArray) -> FloatArray:
    """Return the smallest step that each encoder has shown.

    Args:
        position: (n, nj) readings in order [rad].

    Returns:
        (nj,) smallest difference between two successive readings that differ [rad]; infinite where all are the same.
    """
    smallest: list[float] = []
    for readings in position.T:  # one encoder at a time, to save memory
        change = np.abs(np.diff(readings))
        smallest.append(change[change > 0].min(initial=np.inf))
    return np.array(smallest)


def frozen_travel(least: float, steps: FloatArray) -> FloatArray:
    """Return the commanded travel beyond which an encoder is frozen if it reads the same throughout.

    Args:
        least: travel for encoders of fine resolution [rad].
        steps: (nj,) smallest steps that were read [rad]; an encoder without one is assumed to be as coarse as the coarsest
            of the others.
    """
    measured = np.isfinite(steps)
    coarsest = steps[measured].max() if measured.any() else _COARSEST
    return np.maximum(least, _STILL_STEPS * np.minimum(np.where(measured, steps, coarsest), _COARSEST))
