"""Tests of the few numbers of a control period, where NumPy's `any` and `all` take eight times as long."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def any_of(conditions: NDArray[np.bool_]) -> bool:
    """Return whether any condition is true."""
    return bool(np.count_nonzero(conditions))


def all_of(conditions: NDArray[np.bool_]) -> bool:
    """Return whether all conditions are true."""
    return bool(np.count_nonzero(conditions) == conditions.size)
