"""Covers what equipoise uses of SciPy."""

import numpy as np
from numpy.typing import NDArray

from . import transform as transform

class ConvexHull:
    vertices: NDArray[np.int_]
    simplices: NDArray[np.int32]
    equations: NDArray[np.float64]
    def __init__(self, points: NDArray[np.float64], /) -> None: ...
