"""Runs of equal flags."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def true_runs(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the first and last (exclusive) index of every run of true flags."""
    padded = np.concatenate([[False], flags, [False]]).astype(int)
    return [(int(a), int(b)) for a, b in np.flatnonzero(np.diff(padded)).reshape(-1, 2)]
