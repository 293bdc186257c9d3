"""Covers what equipoise uses of scipy.signal."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

_FloatArray = NDArray[np.float64]

def butter(N: int, Wn: float, *, fs: float, output: Literal["sos"]) -> _FloatArray: ...
def sosfilt_zi(sos: _FloatArray) -> _FloatArray: ...
def sosfilt(sos: _FloatArray, x: _FloatArray, *, axis: int, zi: _FloatArray) -> tuple[_FloatArray, _FloatArray]: ...
