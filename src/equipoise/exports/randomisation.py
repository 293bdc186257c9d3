"""Physical bodies drawn from the posterior of a run.

A body's pseudo-inertia is J = [[S, h], [h', m]], with its second moments of mass S and its first moment h = m c about the base
frame's origin. A body is physical if J is positive definite (Wensing, Kim and Slotine 2018). Bodies are drawn from the
normal distribution of the estimate, and those that are not physical are rejected.

A run determines the composite best, and a simulated robot has the legs of its file: so the base gets the uncertainty of the
composite. A drawn body is also given by the ten entries of an upper triangular U (log-Cholesky, Rucker and Wensing 2022):

    J = U J0 U',   U = exp(alpha) [exp(d1)   s12      s13     t1]
                                  [   0    exp(d2)    s23     t2]
                                  [   0       0     exp(d3)   t3]
                                  [   0       0        0       1]

with J0 of the estimated body. J is positive definite for any entries.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from equipoise.conventions import FloatArray
from equipoise.errors import NotEstimatedError
from equipoise.result.statistics import NORMAL_95
from equipoise.robot.inertial import COMPONENTS, InertialParameters, components

ENTRIES = ("alpha", "d1", "d2", "d3", "s12", "s13", "s23", "t1", "t2", "t3")
"""Entries of U: density, stretches along x y z, shears, shifts of the CoM."""
DRAWS = 10_000
_FEWEST = 0.01  # of the draws must be physical; otherwise the run identified hardly anything
QUANTILES = (0.025, 0.975)
_STEP = 1e-6
_UNITS = np.array([pin.PseudoInertia.FromDynamicParameters(unit).toMatrix() for unit in np.eye(10)])


def entry_ranges(entries: FloatArray) -> dict[str, tuple[float, float]]:
    """Return the 95 % range of each entry of U given the others: 1.96 / sqrt of its precision.

    It suits consumers that draw each entry independently. The entries are correlated: a box of the marginal ranges
    would hold bodies whose CoM is several times farther off than the posterior allows.

    Args:
        entries: (n, 10) entries of U of drawn bodies.
    """
    precision = np.linalg.inv(np.cov(entries.T))
    half_width = NORMAL_95 / np.sqrt(np.diag(precision))
    return {name: (-float(value), float(value)) for name, value in zip(ENTRIES, half_width, strict=True)}


def body_ranges(bodies: FloatArray) -> dict[str, tuple[float, float]]:
    """Return 95 % ranges of mass [kg], CoM [m] and inertia about the CoM [kg m2] of (n, 10) bodies."""
    low, high = np.quantile(bodies, QUANTILES, axis=0)
    return {name: (float(a), float(b)) for name, a, b in zip(COMPONENTS, low, high, strict=True)}


def drawn_bases(
    base: InertialParameters, composite: InertialParameters, covariance: FloatArray, seed: int, draws: int = DRAWS
) -> FloatArray:
    """Return (draws, 4, 4) pseudo-inertias of bodies drawn for the base.

    Args:
        base: parameters of the base for the model's legs.
        composite: parameters of the estimated composite.
        covariance: (10, 10) covariance of the composite, in the order of COMPONENTS.
        seed: seed of the draws.
        draws: number of draws.

    Raises:
        NotEstimatedError: hardly any drawn body is physical, or the base itself is not.
    """
    slope = vector_slope(composite)
    root = _square_root(slope @ covariance @ slope.T)
    rng = np.random.default_rng(seed)
    pseudo = pseudo_inertias(base.vector[None])[0]
    if not np.linalg.eigvalsh(pseudo)[0] > 0:
        raise NotEstimatedError("no body can be drawn: the estimated base is as flat as a plate")
    kept = np.empty((0, 4, 4))
    tried = 0
    while len(kept) < draws:
        drawn = pseudo_inertias(base.vector + rng.standard_normal((draws, 10)) @ root.T)
        kept = np.concatenate([kept, drawn[np.linalg.eigvalsh(drawn)[:, 0] > 0]])
        tried += draws
        if len(kept) < _FEWEST * tried:
            raise NotEstimatedError(
                f"less than {_FEWEST:.0%} of the bodies drawn from this run's posterior are physical; calibrate longer "
                "(--duration)"
            )
    return kept[:draws]


def pseudo_inertias(vectors: FloatArray) -> FloatArray:
    """Return (n, 4, 4) J of (n, 10) inertial parameters about the origin, in Pinocchio's order."""
    return np.asarray(np.tensordot(vectors, _UNITS, 1), dtype=float)


def components_of(pseudo: FloatArray) -> FloatArray:
    """Return (n, 10) parameters in the order of COMPONENTS."""
    mass = pseudo[:, 3, 3]
    com = pseudo[:, :3, 3] / mass[:, None]
    second = pseudo[:, :3, :3] - mass[:, None, None] * com[:, :, None] * com[:, None, :]
    inertia = np.trace(second, axis1=1, axis2=2)[:, None, None] * np.eye(3) - second
    return np.column_stack([mass, com, inertia[:, [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]])


def entries_between(pseudo: FloatArray, reference: FloatArray) -> FloatArray:
    """Return (n, 10) entries of U with J = U J0 U': U is the upper triangular root of J times the inverse of J0's.

    Args:
        pseudo: (n, 4, 4) pseudo-inertias J, positive definite.
        reference: (4, 4) pseudo-inertia J0; the identity for the log-Cholesky parameters of J.
    """
    upper = np.asarray(_upper_root(pseudo) @ np.linalg.inv(_upper_root(reference[None])[0]), dtype=float)
    scale = upper[:, 3, 3]
    unit = upper / scale[:, None, None]
    stretches = np.log(unit[:, [0, 1, 2], [0, 1, 2]])
    return np.column_stack([np.log(scale), stretches, unit[:, [0, 0, 1], [1, 2, 2]], unit[:, :3, 3]])


def _upper_root(pseudo: FloatArray) -> FloatArray:
    """Return (n, 4, 4) upper triangular U with J = U U'."""
    return np.asarray(np.linalg.cholesky(pseudo[:, ::-1, ::-1])[:, ::-1, ::-1], dtype=float)


def vector_slope(body: InertialParameters) -> FloatArray:
    """Return the (10, 10) derivative of the parameters about the origin by those in the order of COMPONENTS."""
    at = components(body)
    columns = [(_vector(at + step) - _vector(at - step)) / (2 * _STEP) for step in _STEP * np.eye(len(at))]
    return np.column_stack(columns)


def _vector(at: FloatArray) -> FloatArray:
    return InertialParameters.from_components(at).vector


def _square_root(covariance: FloatArray) -> FloatArray:
    """Return (10, 10) R with R R' the covariance, which may be singular (a known mass)."""
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(values, 0.0))
