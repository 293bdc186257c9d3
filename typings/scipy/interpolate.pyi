"""Covers what equipoise uses of scipy.interpolate."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

class CubicSpline:
    def __init__(self, x: ArrayLike, y: ArrayLike, /) -> None: ...
    def __call__(self, x: ArrayLike, /) -> NDArray[np.float64]: ...
