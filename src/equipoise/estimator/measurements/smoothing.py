"""Quintic smoothing splines of noisy positions and velocities.

A quintic B-spline overlaps only its five neighbours to either side. The normal equations have eleven diagonals, and the time
and memory of a fit are proportional to the number of samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.sparse import csr_array

from equipoise.conventions import FloatArray

_DEGREE = 5
_AT_ONCE = 1 << 16  # samples per block: its memory is small compared with the samples'


@dataclass(frozen=True, eq=False)
class SplineFit:
    """Fitted spline and its noise.

    Attributes:
        spline: spline of all columns.
        factor: (6, k) banded lower Cholesky factor of the normal equations, whose inverse is the covariance of the
            coefficients of any column for samples with a standard deviation of one.
        reach: interval to either side over which `at` and `noise` average [s].
    """

    spline: BSpline
    factor: FloatArray
    reach: float = 0.0

    def at(self, time: FloatArray, derivative: int = 0) -> FloatArray:
        """Return (n, k) values, or a derivative, at (n,) times."""
        curve = self.spline.derivative(derivative) if derivative else self.spline
        later, weights = mean_about(self.reach)
        return np.tensordot(weights, curve(later[:, None] + time), axes=1)

    def noise(self, time: FloatArray, derivative: int = 0) -> FloatArray:
        """Return the (n, n) covariance of `at`, for samples with a standard deviation of one."""
        later, weights = mean_about(self.reach)
        at_all = _basis(self.spline.t, (later[:, None] + time).ravel(), derivative).toarray()
        basis = np.tensordot(weights, at_all.reshape(len(weights), len(time), -1), axes=1)
        return np.asarray(basis @ cho_solve_banded((self.factor, True), basis.T), dtype=float)


def fit_spline(
    time: FloatArray,
    values: FloatArray | Sequence[FloatArray],
    knot_spacing: float,
    derivative: FloatArray | None = None,
    derivative_weight: float = 0.0,
    reach: float = 0.0,
) -> SplineFit:
    """Fit a quintic spline to samples, and optionally to samples of its derivative, by least squares.

    Args:
        time: (n,) increasing times [s].
        values: (n, k) samples, or several such tables, whose columns are joined without copying a long motion.
        knot_spacing: time between knots; a smaller one follows faster signals and more noise [s].
        derivative: (n, k) samples of the rate of change, or None.
        derivative_weight: weight of a derivative's residual, relative to a value's: the ratio of their noises [s].
        reach: see `SplineFit`.
    """
    tables = [values] if isinstance(values, np.ndarray) else list(values)
    start, end = float(time[0]), float(time[-1])
    intervals = max(1, int(np.ceil((end - start) / knot_spacing)))
    grid = np.linspace(start, end, intervals + 1)
    knots = np.concatenate([np.repeat(start, _DEGREE), grid, np.repeat(end, _DEGREE)])
    bands, moment = (
        np.zeros((_DEGREE + 1, len(knots) - _DEGREE - 1)),
        np.zeros((len(knots) - _DEGREE - 1, sum(table.shape[1] for table in tables))),
    )
    for first in range(0, len(time), _AT_ONCE):
        part = slice(first, first + _AT_ONCE)
        design = _basis(knots, time[part])
        bands += _bands(design)
        moment += design.T @ np.hstack([table[part] for table in tables])
        if derivative is not None:
            slopes = _basis(knots, time[part], 1) * derivative_weight
            bands += _bands(slopes)
            moment += slopes.T @ (derivative_weight * derivative[part])
    bands[0] += 1e-9  # keeps knot intervals without samples (dropped ones) finite
    factor = cholesky_banded(bands, lower=True)
    return SplineFit(BSpline(knots, cho_solve_banded((factor, True), moment), _DEGREE), factor, reach)


def noise_in_motion(values: FloatArray) -> float:
    """Return the standard deviation of white noise in (n, k) even samples of a motion, the median over columns.

    Third differences remove smooth signals; for white noise they have twenty times its variance.
    """
    sizes = [float(np.median(np.abs(np.diff(column, n=3)))) for column in values.T]
    return float(np.median(sizes)) / (0.6745 * np.sqrt(20))


def mean_about(reach: float) -> tuple[FloatArray, FloatArray]:
    """Return relative times and weights of an average: a mean of three, applied four times, that ends at the reach."""
    if not reach:
        return np.zeros(1), np.ones(1)
    weights: FloatArray = reduce(np.convolve, [np.full(3, 1 / 3)] * 4)
    return reach * np.linspace(-1.0, 1.0, len(weights) + 2)[1:-1], weights


def _basis(knots: FloatArray, time: FloatArray, derivative: int = 0) -> csr_array:
    """Return sparse (n, k) values, or derivatives, of all B-splines at (n,) times."""
    inner = knots[derivative : len(knots) - derivative]
    basis = csr_array(BSpline.design_matrix(time, inner, _DEGREE - derivative))
    for degree in range(_DEGREE - derivative + 1, _DEGREE + 1):
        basis = basis @ _coefficients_of_derivative(knots[_DEGREE - degree : len(knots) - (_DEGREE - degree)], degree)
    return basis


def _coefficients_of_derivative(knots: FloatArray, degree: int) -> csr_array:
    """Return the sparse (k - 1, k) matrix from a spline's coefficients to those of its derivative."""
    count = len(knots) - degree - 1
    per_time = degree / (knots[degree + 1 : degree + count] - knots[1:count])
    rows = np.arange(count - 1)
    return csr_array(
        (np.concatenate([-per_time, per_time]), (np.tile(rows, 2), np.concatenate([rows, rows + 1]))),
        shape=(count - 1, count),
    )


def _bands(design: csr_array) -> FloatArray:
    """Return (6, k) diagonals of design^T design, the main one and those below it."""
    gram = design.T @ design
    bands = np.zeros((_DEGREE + 1, gram.shape[0]))
    for below in range(_DEGREE + 1):
        bands[below, : gram.shape[0] - below] = gram.diagonal(-below)
    return bands
