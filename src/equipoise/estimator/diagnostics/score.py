"""Score tests of fixed parameters.

At the posterior mode, r are the residuals in units of their noise. J is their derivative by the estimated parameters, prior
rows included. C is their derivative by the parameters of one fixed row, in units of its usual prior. Then

    s = -C^T r,    F = C^T (1 - J (J^T J)^-1 J^T) C,    s^T F^-1 s ~ chi2(k)

if the model's values are right (Rao 1948; s are the Lagrange multipliers of the fixed parameters). A test names the cause
without another estimate, because each effect leaves a residual pattern that the estimated parameters cannot explain.
Only directions of F that the run hardly determines are left out: an effect far above the usual raises the noise levels.

The variance of s follows from the noise levels, not from the scatter of s between motions. Scatter does not help where an
error is common to all motions, and is worse here: scores sum to about zero at the mode, and in a clean run scatter gave 6.6
normal deviates where F gave 0.8.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.estimator.problem import Posterior
from equipoise.estimator.unknowns import Unknown

_INFORMATIVE = 0.1  # least eigenvalue of F: three times the usual size is then one standard deviation of the noise


@dataclass(frozen=True, eq=False)
class ScoreTest:
    """Score test of one fixed row.

    Attributes:
        row: row of the table of parameters.
        deviate: normal deviate as unlikely as the score, if the model's values are right; -inf: the run is not sensitive.
        values: estimates to first order with the usual prior, in the row's unit.
    """

    row: Unknown
    deviate: float
    values: FloatArray


def score_tests(posterior: Posterior) -> list[ScoreTest]:
    """Test all fixed rows; return the least likely first."""
    fixed = [row for row in posterior.unknowns.priors.rows() if not posterior.unknowns.estimates(row.name)]
    if not fixed:
        return []
    problem, x, opened = posterior.problem.with_all_open(posterior.x)
    equations, unknowns = problem.motion_equations(x), problem.unknowns
    tests: list[ScoreTest] = []
    for row in fixed:
        own = unknowns.columns(row.name)
        with_open = equations.information[np.ix_(own, opened)]
        information = equations.information[np.ix_(own, own)] - with_open @ posterior.covariance @ with_open.T
        # The gradient by the estimated parameters is zero at the mode, but for the last small step.
        score = -equations.gradient[own]
        values = np.linalg.solve(information + np.eye(len(own)), score) * unknowns.scale[own]
        tests.append(ScoreTest(row, deviate(information, score, _INFORMATIVE), values))
    return sorted(tests, key=lambda test: -test.deviate)


def deviate(covariance: FloatArray, score: FloatArray, least: float) -> float:
    """Return the normal deviate as unlikely as a zero-mean normal (k,) vector; -inf if no direction has enough variance.

    The cube root of s^T V^-1 s ~ chi2(k) is almost normal (Wilson and Hilferty 1931).

    Args:
        covariance: (k, k) covariance of the vector.
        least: variance below which a direction is left out.
    """
    variances, directions = np.linalg.eigh(covariance)
    kept = variances > least
    if not kept.any():
        return -np.inf
    mean_square = np.mean((score @ directions[:, kept]) ** 2 / variances[kept])
    variance = 2 / (9 * kept.sum())
    return float((np.cbrt(mean_square) - 1 + variance) / np.sqrt(variance))
