"""Covers what equipoise uses of scipy.optimize."""

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

class OptimizeResult:
    x: float

def minimize_scalar(
    fun: Callable[[float], float],
    *,
    bounds: tuple[float, float],
    method: str,
    options: Mapping[str, float] | None = None,
) -> OptimizeResult: ...
def nnls(A: NDArray[np.float64], b: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]: ...

class LinearResult:
    x: NDArray[np.float64]

def lsq_linear(
    A: NDArray[np.float64],
    b: NDArray[np.float64],
    bounds: tuple[NDArray[np.float64], NDArray[np.float64]],
    method: str = "trf",
) -> LinearResult: ...
