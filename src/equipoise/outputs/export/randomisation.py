"""Bodies drawn from what a run left open, each one that can exist.

A body's pseudo-inertia is J = [[S, h], [h', m]], with its second moments of mass S and its first moment h = m c about the base
frame's origin; bodies that can exist are those with a positive definite J (Wensing, Kim and Slotine 2018). Drawn are the ten
entries of an upper triangular U with

    J = U J0 U',   U = exp(alpha) [exp(d1)   s12      s13     t1]
                                  [   0    exp(d2)    s23     t2]
                                  [   0       0     exp(d3)   t3]
                                  [   0       0        0       1]

about the body J0 that was found (log-Cholesky, Rucker and Wensing 2022): whatever is drawn, J is positive definite. To first
order the drawn bodies have the covariance of the estimate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from equipoise.estimation.parameters import COMPONENTS, components
from equipoise.robot.inertial import InertialParameters

FloatArray = NDArray[np.float64]

PARAMETERS = ("alpha", "d1", "d2", "d3", "s12", "s13", "s23", "t1", "t2", "t3")
"""The order of the entries of U: density, stretches along x y z, shears, shifts of the CoM."""
_DRAWS = 10_000
_QUANTILES = (0.025, 0.975)
_STEP = 1e-6


@dataclass(frozen=True, eq=False)
class Spread:
    """Bodies about one that was found.

    Attributes:
        body: that one.
        entries: (n, 10) drawn entries of U, in the order of PARAMETERS.
        bodies: (n, 10) the same bodies in the order of COMPONENTS.
    """

    body: InertialParameters
    entries: FloatArray
    bodies: FloatArray

    def entry_ranges(self) -> dict[str, tuple[float, float]]:
        """95 % of each entry of U."""
        return _ranges(PARAMETERS, self.entries)

    def body_ranges(self) -> dict[str, tuple[float, float]]:
        """95 % of mass [kg], CoM [m] and inertia about the CoM [kg m2]."""
        return _ranges(COMPONENTS, self.bodies)


def spread(body: InertialParameters, covariance: FloatArray, seed: int, draws: int = _DRAWS) -> Spread:
    """Draw bodies.

    Args:
        body: that was found.
        covariance: (10, 10) in the order of COMPONENTS.
        seed: of the draws.
        draws: how many.
    """
    pseudo = pseudo_inertia(body)
    slope = np.column_stack([
        (components(stretched(pseudo, step)) - components(stretched(pseudo, -step))) / (2 * _STEP)
        for step in _STEP * np.eye(len(PARAMETERS))
    ])  # fmt: skip
    root = np.linalg.solve(slope, _square_root(covariance))
    entries = np.random.default_rng(seed).standard_normal((draws, len(PARAMETERS))) @ root.T
    return Spread(body, entries, np.array([components(stretched(pseudo, entry)) for entry in entries]))


def stretched(pseudo: FloatArray, entries: FloatArray) -> InertialParameters:
    """The body whose pseudo-inertia is U J0 U'.

    Args:
        pseudo: (4, 4) J0.
        entries: (10,) of U, in the order of PARAMETERS.
    """
    alpha, d1, d2, d3, s12, s13, s23, t1, t2, t3 = entries
    upper = np.array([
        [np.exp(d1), s12, s13, t1], [0.0, np.exp(d2), s23, t2], [0.0, 0.0, np.exp(d3), t3], [0.0, 0.0, 0.0, 1.0],
    ])  # fmt: skip
    j = np.exp(2 * alpha) * upper @ pseudo @ upper.T
    mass, com = float(j[3, 3]), j[:3, 3] / j[3, 3]
    about_com = j[:3, :3] - mass * np.outer(com, com)
    return InertialParameters(mass, com, np.trace(about_com) * np.eye(3) - about_com)


def pseudo_inertia(body: InertialParameters) -> FloatArray:
    """(4, 4) J of a body."""
    second = np.trace(body.inertia) / 2 * np.eye(3) - body.inertia + body.mass * np.outer(body.com, body.com)
    first = body.mass * body.com
    return np.block([[second, first[:, None]], [first[None, :], np.array([[body.mass]])]])


def _square_root(covariance: FloatArray) -> FloatArray:
    """(10, 10) R with R R' the covariance, which may be singular (a mass that is known)."""
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(values, 0.0))


def _ranges(names: tuple[str, ...], draws: FloatArray) -> dict[str, tuple[float, float]]:
    low, high = np.quantile(draws, _QUANTILES, axis=0)
    return {name: (float(a), float(b)) for name, a, b in zip(names, low, high, strict=True)}
