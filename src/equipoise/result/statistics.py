"""95 % regions in one, two and three dimensions, and limits of the verdicts."""

from __future__ import annotations

import numpy as np

from equipoise.conventions import FloatArray

NORMAL_95 = 1.96
"""Half width of the 95 % interval in standard deviations: root of the 95 % quantile of chi-squared, one degree."""
PLANAR_95 = 2.4477
"""Half axis of the 95 % ellipse in standard deviations (two degrees of freedom)."""
SPATIAL_95 = 2.7955
"""Half axis of the 95 % ellipsoid in standard deviations (three degrees of freedom)."""
NORMAL = {50: 0.674490, 90: 1.644854, 95: NORMAL_95}
"""Half width of an interval in standard deviations of a normal distribution, by its probability in percent."""
IDENTIFIED, WEAK = 0.1, 0.5
"""Largest ratio of the standard deviation to its reference for the verdicts "identified" and "weak"."""


def verdict_of(std: float, compared_with: float) -> str:
    """Return the verdict on a standard deviation: "identified", "weak" or "not identified".

    Args:
        std: posterior standard deviation.
        compared_with: reference in the same unit: the prior std, or the size of the quantity.
    """
    if std <= IDENTIFIED * compared_with:
        return "identified"
    return "weak" if std <= WEAK * compared_with else "not identified"


def ellipsoid_95(covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the axes of the 95 % ellipse or ellipsoid of a normal distribution.

    Args:
        covariance: (2, 2) or (3, 3), in a unit squared.

    Returns:
        (n, n) directions of the axes as columns, right-handed, and (n,) half axes in the unit, ascending.
    """
    values, directions = np.linalg.eigh(covariance)
    directions[:, 0] *= np.sign(np.linalg.det(directions))
    factor = PLANAR_95 if len(values) == 2 else SPATIAL_95
    return directions, factor * np.sqrt(np.maximum(values, 0.0))
