"""Intervals of 95 % in one, two and three dimensions, and the limits of the verdicts."""

from __future__ import annotations

import numpy as np

from equipoise.conventions import FloatArray

NORMAL_95 = 1.96
"""Standard deviations to either side that hold 95 % of a normal distribution: the root of chi-squared's 95 %, one degree."""
PLANAR_95 = 2.4477
"""Standard deviations to the edge of the ellipse that holds 95 % in the plane, two degrees of freedom."""
SPATIAL_95 = 2.7955
"""Standard deviations to the surface of the ellipsoid that holds 95 % in space, three degrees of freedom."""
NORMAL = {50: 0.674490, 90: 1.644854, 95: NORMAL_95}
"""Standard deviations to either side that hold so many percent of a normal distribution."""
IDENTIFIED, WEAK = 0.1, 0.5
"""Standard deviation up to which a quantity counts as identified, and as weak; over what it is compared with."""


def verdict_of(std: float, compared_with: float) -> str:
    """Return the verdict on a standard deviation: "identified", "weak" or "not identified".

    Args:
        std: posterior standard deviation.
        compared_with: number that it is compared with, in the same unit: the one before the run, or the
            quantity's size.
    """
    if std <= IDENTIFIED * compared_with:
        return "identified"
    return "weak" if std <= WEAK * compared_with else "not identified"


def ellipsoid_95(covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the region that holds 95 % of a normal distribution around its mean: an ellipse or an ellipsoid.

    Args:
        covariance: (2, 2) or (3, 3), in a unit squared.

    Returns:
        (n, n) directions of its axes as columns, right-handed, and (n,) half their lengths in that unit, ascending.
    """
    values, directions = np.linalg.eigh(covariance)
    directions[:, 0] *= np.sign(np.linalg.det(directions))
    factor = PLANAR_95 if len(values) == 2 else SPATIAL_95
    return directions, factor * np.sqrt(np.maximum(values, 0.0))
