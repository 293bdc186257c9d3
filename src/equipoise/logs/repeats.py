"""Samples that repeat, as a log has them that was written faster than its sensor was read."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from equipoise.conventions import FloatArray

_REPEATED = 0.3  # of consecutive samples
_LONGEST = 20  # samples: a sensor that repeats for longer is frozen


def repeated_rows(values: Sequence[FloatArray]) -> NDArray[np.bool_]:
    """Return (n,) whether each sample repeats the one before it in all (n, k) tables; none if few do, or for too long.

    Repeated samples would look like a sensor with half the noise that lags by half its period.
    """
    same = np.all([(np.diff(table, axis=0) == 0).all(axis=1) for table in values], axis=0)
    repeated = np.concatenate([[False], same])
    longest = int(np.diff(np.flatnonzero(np.concatenate([[True], ~repeated[1:], [True]]))).max())
    return repeated if repeated.mean() > _REPEATED and longest <= _LONGEST else np.zeros_like(repeated)
