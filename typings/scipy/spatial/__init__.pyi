import numpy as np
from numpy.typing import NDArray

"""Covers what equipoise uses of SciPy."""

class ConvexHull:
    simplices: NDArray[np.int32]
    equations: NDArray[np.float64]
    def __init__(self, points: NDArray[np.float64], /) -> None: ...
