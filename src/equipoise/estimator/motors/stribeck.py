"""Friction that grows toward rest, F_c + F_s exp(-(|v| / v_s)^1.5), and whether a robot's joints have it.

Grease that is dragged along carries less the slower a joint slides (Stribeck 1902). Exponents of 0.5 to 2 are in use, 1 by
Tustin, 2 by Bo and Pavelescu (Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30, 1994), and what is seen of joints
that slide does not tell which: with one between these two, viscous friction is right whichever it is, and F_s to a third.
"""

from __future__ import annotations

from statistics import NormalDist

import numpy as np
from scipy.sparse import csr_array

from equipoise.conventions import FloatArray

SPEEDS = (0.05, 0.07, 0.1, 0.14, 0.2, 0.3)
"""Speeds v_s that are tried, one for all joints: they have one grease [rad/s]."""
_EXPONENT = 1.5
_FALSE_ALARMS = 0.01  # share of the robots without, did averages know nothing of each other and the equation hold
_UNLIKE_NOISE = 1.7  # deviations by which amounts scatter where there is none, on simulated robots of four kinds


def stribeck_terms(average: csr_array, sign: FloatArray, velocity: FloatArray) -> FloatArray:
    """(speeds, m, nj) averages of sgn(v) exp(-(|v| / v_s)^1.5), of (n, nj) signs and velocities [rad/s]."""
    return np.stack([average @ (sign * np.exp(-((np.abs(velocity) / speed) ** _EXPONENT))) for speed in SPEEDS])


def is_wanted(terms: FloatArray, design: FloatArray, left: FloatArray, covariance: FloatArray, prior: float) -> bool:
    """Whether what a fit without leaves tells of such friction at a joint, at the v_s that explains most.

    A score test (Rao 1948): with E a term's columns, one a joint, D the fit's and C their posterior covariance, what is left
    tells amounts S^-1 E^T r with the information S = E^T E - E^T D C D^T E. No second fit is made for it. Amounts over their
    deviations are held against the normal quantile for as many joints and speeds as are tried.

    Args:
        terms: (speeds, n, nj) torques of a unit of friction at rest, over the noise.
        design: (n, nj, u) derivatives of the torques by the fit's unknowns, over the noise.
        left: (n, nj) what the fit leaves of the torques, over the noise.
        covariance: (u, u) posterior covariance of the fit's unknowns.
        prior: standard deviation of an amount before the run [Nm].
    """
    told: list[float] = []
    surest: list[float] = []
    for term in terms:
        across = np.asarray(np.einsum("njk,nj->kj", design, term), dtype=float)
        information = np.diag((term**2).sum(axis=0) + prior**-2) - across.T @ covariance @ across
        inverse = np.asarray(np.linalg.inv(information), dtype=float)
        score: FloatArray = (term * left).sum(axis=0)
        amounts = inverse @ score
        told.append(float(score @ amounts))
        # Of what the fit could as well call something else nothing is left but rounding, below zero as well.
        std = np.sqrt(np.maximum(np.diag(inverse), 0.0))
        surest.append(float(np.divide(amounts, std, out=np.zeros_like(amounts), where=std > 0).max()))
    best = int(np.argmax(told))
    least = _UNLIKE_NOISE * NormalDist().inv_cdf(1 - _FALSE_ALARMS / (len(terms) * terms.shape[-1]))
    return surest[best] > least
