"""Score tests of what is held: whether the evidence pulls at an unknown that the estimate takes for the model's.

At the posterior's mode, with r the residuals in units of their noise, J their derivative by the open unknowns, with the rows
of the priors, and C that by one row of the table that is held, in units of what is usual of it,

    s = C^T r,    F = C^T (1 - J (J^T J)^-1 J^T) C,    s^T F^-1 s ~ chi2(k)

where the model's values are right (Rao 1948; the Lagrange multipliers of the held ones are s). It names the cause without an
iteration: what an effect does to residuals has a shape of its own, once all that open unknowns explain is taken off.
Directions of F that the run hardly sees are left out; not more of them, since what is far larger than usual raises the noise
levels.

The variance of s is what the noise levels say, not the scatter of s from motion to motion. That scatter is no better where an
error is the same in all motions, and worse here: scores add up to about zero at the mode, and of a clean run it made 6.6
normal deviates where F makes 0.8.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.estimator.problem import Posterior
from equipoise.estimator.unknown import Unknown

_SEEN = 0.1  # eigenvalue of F: along its direction three times the usual size is one standard deviation of the noise


@dataclass(frozen=True, eq=False)
class ScoreTest:
    """What the evidence says of a row that is held.

    Attributes:
        row: row of the table of unknowns.
        deviate: normal deviate as unlikely as the score, if the model's values are right; -inf: the run does not see it.
        values: most probable values to first order, were they unknown as is usual, in the row's unit.
    """

    row: Unknown
    deviate: float
    values: FloatArray


def score_tests(posterior: Posterior) -> list[ScoreTest]:
    """Of all rows that are held, the least likely first."""
    held = [row for row in posterior.unknowns.priors.rows() if not posterior.unknowns.estimates(row.name)]
    if not held:
        return []
    problem, x, opened = posterior.problem.with_all_open(posterior.x)
    equations, unknowns = problem.motion_equations(x), problem.unknowns
    tests: list[ScoreTest] = []
    for row in held:
        own = unknowns.columns(row.name)
        with_open = equations.information[np.ix_(own, opened)]
        information = equations.information[np.ix_(own, own)] - with_open @ posterior.covariance @ with_open.T
        # The gradient by the open ones is zero at the mode, but for the last small step.
        score = -equations.gradient[own]
        values = np.linalg.solve(information + np.eye(len(own)), score) * unknowns.scale[own]
        tests.append(ScoreTest(row, deviate(information, score, _SEEN), values))
    return sorted(tests, key=lambda test: -test.deviate)


def deviate(covariance: FloatArray, score: FloatArray, least: float) -> float:
    """Normal deviate as unlikely as a normal (k,) vector about zero is; -inf if it has no variance in any direction.

    Of s^T V^-1 s, chi2(k), the cube root, which is almost normal (Wilson and Hilferty 1931).

    Args:
        covariance: (k, k) of the vector.
        least: variance in a direction below which the direction is left out.
    """
    sizes, directions = np.linalg.eigh(covariance)
    seen = sizes > least
    if not seen.any():
        return -np.inf
    mean_square = np.mean((score @ directions[:, seen]) ** 2 / sizes[seen])
    variance = 2 / (9 * seen.sum())
    return float((np.cbrt(mean_square) - 1 + variance) / np.sqrt(variance))
