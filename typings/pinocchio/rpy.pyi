"""Covers what equipoise uses of pinocchio.rpy."""

import numpy as np
from numpy.typing import NDArray

def rpyToMatrix(rpy: NDArray[np.float64], /) -> NDArray[np.float64]: ...
def matrixToRpy(rotation: NDArray[np.float64], /) -> NDArray[np.float64]: ...
