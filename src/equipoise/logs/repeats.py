"""Repeated samples in logs that are written faster than the sensor is read, and stamps that do not increase."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from equipoise.conventions import FloatArray

_REPEATED = 0.3  # of consecutive samples
_LONGEST = 20  # samples: a sensor that repeats for longer is frozen


def repeated_rows(values: Sequence[FloatArray]) -> NDArray[np.bool_]:
    """Return an (n,) mask of the samples that equal the one before in all (n, k) tables; all False if few or too many do.

    Repeated samples would look like a sensor with half the noise that lags by half its period.
    """
    same = np.all([(np.diff(table, axis=0) == 0).all(axis=1) for table in values], axis=0)
    repeated = np.concatenate([[False], same])
    longest = int(np.diff(np.flatnonzero(np.concatenate([[True], ~repeated[1:], [True]]))).max())
    return repeated if repeated.mean() > _REPEATED and longest <= _LONGEST else np.zeros_like(repeated)


def increasing(time: FloatArray) -> NDArray[np.intp]:
    """Return the rows whose times are numbers and exceed all before."""
    rows = np.flatnonzero(np.isfinite(time))
    return rows[np.diff(np.maximum.accumulate(time[rows]), prepend=-np.inf) > 0]
