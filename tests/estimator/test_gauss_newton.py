"""Solver: damped steps reach the minimum from any start, and never raise the cost."""

from __future__ import annotations

import numpy as np
import pytest

from equipoise.errors import RecordingError
from equipoise.estimator.solve import NormalEquations, descend, solve

STEEPNESS = 50.0  # of the valley's walls, over the slope along its floor


class ValleyProblem:
    """Residuals of a narrow curved valley: full Gauss-Newton steps overshoot, halved ones converge slowly."""

    def __init__(self) -> None:
        self.costs: list[float] = []

    def residual(self, x: np.ndarray) -> np.ndarray:
        return np.array([STEEPNESS * (x[1] - x[0] ** 2), 1 - x[0]])

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        return np.array([[-2 * STEEPNESS * x[0], STEEPNESS], [-1.0, 0.0]])

    def prepare(self, x: np.ndarray) -> None: ...

    def renew_noise(self, x: np.ndarray) -> None: ...

    def normal_equations(self, x: np.ndarray, fix_scale: bool = False) -> NormalEquations:
        equations = NormalEquations.of(self.residual(x), self.jacobian(x))
        self.costs.append(equations.cost)
        return equations


@pytest.mark.parametrize("start", [(-1.2, 1.0), (-2.0, 4.0), (0.0, 0.0), (3.0, -1.0), (-1.0, 3.0)])
def test_the_minimum_does_not_depend_on_the_start(start):
    x, converged = solve(ValleyProblem(), np.array(start), rounds=2)
    assert converged
    assert np.allclose(x, 1.0, atol=0.02)


def test_an_accepted_step_never_raises_the_cost():
    problem = ValleyProblem()
    x, _ = descend(problem, np.array([-1.2, 1.0]))
    accepted = [problem.costs[0]]
    for cost in problem.costs[1:]:
        if cost <= accepted[-1] * (1 + 1e-9):
            accepted.append(cost)
    assert np.sum(problem.residual(x) ** 2) == pytest.approx(accepted[-1])
    assert len(accepted) < len(problem.costs)  # some steps were refused


def test_a_step_is_accepted_at_its_own_cost():
    class Wall(ValleyProblem):
        """Return a step that is small against its standard deviation and raises the cost."""

        def residual(self, x: np.ndarray) -> np.ndarray:
            return np.array([0.1 * (x[0] - 1), 20.0 * np.abs(x[1]) ** 0.5 * np.sign(x[1]) if x[0] > 0.2 else 0.0])

        def jacobian(self, x: np.ndarray) -> np.ndarray:
            return np.array([[0.1, 0.0], [0.0, 1.0]])

    problem = Wall()
    start = np.array([0.0, 1.0])
    x, _ = solve(problem, start, rounds=1)
    assert np.sum(problem.residual(x) ** 2) <= np.sum(problem.residual(start) ** 2)


def test_undetermined_parameters_are_refused():
    class Flat(ValleyProblem):
        def jacobian(self, x: np.ndarray) -> np.ndarray:
            return np.zeros((2, 2))

    with pytest.raises(RecordingError, match="do not determine an estimate"):
        solve(Flat(), np.zeros(2), rounds=1)
