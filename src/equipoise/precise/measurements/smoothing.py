"""Quintic splines through noisy samples: positions with velocities, at any time in between."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline

from equipoise.conventions import FloatArray

_DEGREE = 5


@dataclass(frozen=True, eq=False)
class SplineFit:
    """A fitted spline, and how far noise of the samples moves it.

    Attributes:
        spline: spline of all columns.
        covariance: (k, k) covariance of the coefficients of any column, for samples with a standard deviation of one.
    """

    spline: BSpline
    covariance: FloatArray

    def noise(self, time: FloatArray, derivative: int = 0) -> FloatArray:
        """(n, n) covariance of the spline's values, or of a derivative, at (n,) times; as `covariance`."""
        unit = BSpline(self.spline.t, np.eye(len(self.covariance)), _DEGREE)
        basis = unit.derivative(derivative)(time) if derivative else unit(time)
        return basis @ self.covariance @ basis.T


def fit_spline(
    time: FloatArray,
    values: FloatArray,
    knot_spacing: float,
    derivative: FloatArray | None = None,
    derivative_weight: float = 0.0,
) -> SplineFit:
    """The quintic spline nearest to samples, and to samples of its derivative where there are any (least squares).

    Args:
        time: (n,) increasing times [s].
        values: (n, k) samples.
        knot_spacing: time between knots; a smaller one follows faster signals and more noise [s].
        derivative: (n, k) samples of the rate of change, or None.
        derivative_weight: weight of a derivative's residual, relative to a value's: the ratio of their noises [s].
    """
    start, end = float(time[0]), float(time[-1])
    intervals = max(1, int(np.ceil((end - start) / knot_spacing)))
    grid = np.linspace(start, end, intervals + 1)
    knots = np.concatenate([np.repeat(start, _DEGREE), grid, np.repeat(end, _DEGREE)])
    design = BSpline.design_matrix(time, knots, _DEGREE).toarray()
    rows, targets = [design], [values]
    if derivative is not None:
        slopes = BSpline(knots, np.eye(design.shape[1]), _DEGREE).derivative()(time)
        rows.append(derivative_weight * slopes)
        targets.append(derivative_weight * derivative)
    matrix, target = np.concatenate(rows), np.concatenate(targets)
    # A little weight on nothing keeps a knot interval without a sample (dropped ones) finite.
    gram = matrix.T @ matrix + 1e-9 * np.eye(design.shape[1])
    covariance = np.asarray(np.linalg.inv(gram), dtype=float)
    return SplineFit(BSpline(knots, covariance @ (matrix.T @ target), _DEGREE), covariance)
