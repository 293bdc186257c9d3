import numpy as np
from numpy.typing import NDArray

def cumulative_simpson(
    y: NDArray[np.float64], *, dx: float, axis: int = -1, initial: float | None = None
) -> NDArray[np.float64]: ...
def cumulative_trapezoid(
    y: NDArray[np.float64],
    x: NDArray[np.float64] | None = None,
    dx: float = 1.0,
    *,
    axis: int = -1,
    initial: float | None = None,
) -> NDArray[np.float64]: ...
