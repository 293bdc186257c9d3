"""Stribeck friction, F_c + F_s exp(-(|v| / v_s)^1.5), and a test for it.

A lubricant film carries less the slower a joint slides (Stribeck 1902). Exponents of 0.5 to 2 are in use: 1 by Tustin, 2 by
Bo and Pavelescu (Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30, 1994). Data of sliding joints do not determine
the exponent. With 1.5, viscous friction is unbiased for either, and F_s is accurate to a third.
"""

from __future__ import annotations

from statistics import NormalDist

import numpy as np
from scipy.sparse import csr_array

from equipoise.conventions import FloatArray

SPEEDS = (0.05, 0.07, 0.1, 0.14, 0.2, 0.3)
"""Candidate speeds v_s, one for all joints, which have the same lubricant [rad/s]."""
_EXPONENT = 1.5
_FALSE_ALARMS = 0.01  # share of robots without Stribeck friction, for uncorrelated averages and an exact equation
_SCATTER = 1.7  # std of normalized amounts without Stribeck friction, on simulated robots of four kinds


def stribeck_terms(average: csr_array, sign: FloatArray, velocity: FloatArray) -> FloatArray:
    """Return (speeds, m, nj) averages of sgn(v) exp(-(|v| / v_s)^1.5), from (n, nj) signs and velocities [rad/s]."""
    return np.stack([average @ (sign * np.exp(-((np.abs(velocity) / speed) ** _EXPONENT))) for speed in SPEEDS])


def is_significant(
    terms: FloatArray, design: FloatArray, left: FloatArray, covariance: FloatArray, prior: float
) -> bool:
    """Return True if the residual of a fit without Stribeck friction shows it at a joint, at the best v_s.

    This is a score test (Rao 1948) and needs no second fit. E has a term's columns, one per joint; D has the fit's columns, C
    is their posterior covariance and r the residual. The amounts are S^-1 E^T r, with the information
    S = E^T E - E^T D C D^T E. Amounts over their standard deviations are compared with the normal quantile for the number of
    joints and speeds.

    Args:
        terms: (speeds, n, nj) torques of unit friction at rest, divided by the noise.
        design: (n, nj, u) derivatives of the torques by the fit's parameters, divided by the noise.
        left: (n, nj) residual of the torques, divided by the noise.
        covariance: (u, u) posterior covariance of the fit's parameters.
        prior: prior standard deviation of an amount [Nm].
    """
    improvement: list[float] = []
    largest: list[float] = []
    for term in terms:
        across = np.asarray(np.einsum("njk,nj->kj", design, term), dtype=float)
        information = np.diag((term**2).sum(axis=0) + prior**-2) - across.T @ covariance @ across
        inverse = np.asarray(np.linalg.inv(information), dtype=float)
        score: FloatArray = (term * left).sum(axis=0)
        amounts = inverse @ score
        improvement.append(float(score @ amounts))
        # A term that the fit's columns can replace has only rounding errors left, which may be negative.
        std = np.sqrt(np.maximum(np.diag(inverse), 0.0))
        largest.append(float(np.divide(amounts, std, out=np.zeros_like(amounts), where=std > 0).max()))
    best = int(np.argmax(improvement))
    least = _SCATTER * NormalDist().inv_cdf(1 - _FALSE_ALARMS / (len(terms) * terms.shape[-1]))
    return largest[best] > least
