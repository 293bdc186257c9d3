"""Iteratively reweighted least squares: noise levels of trials with large residuals are raised, outliers are left out.

Each round takes Gauss-Newton steps, damped where a full step does not lower the cost (Marquardt 1963).
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError

_ITERATIONS, _PATIENCE = 40, 4
_LEAST_DAMPING, _MOST_DAMPING = 1e-5, 1e6  # below it a step is not damped, above it no step lowers the cost
_STIFFEN, _EASE = 10.0, 5.0  # factors of the damping after a step that failed, and after one that gained as predicted
_AS_PREDICTED = 0.5  # share of the predicted gain
_ROUNDING = 1e-9  # of the cost
# Limits of a step's largest component, in posterior standard deviations. Below _NEAR a round ends, as noise levels depend
# little on the parameters. Below _CONVERGED the estimate ends. From _SETTLED on, the last step means no convergence.
_NEAR, _CONVERGED, _SETTLED = 0.3, 1e-2, 0.5


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Sum of squared residuals with its gradient and Gauss-Newton information.

    Attributes:
        information: (size, size) J^T J of the residuals' derivative J.
        gradient: (size,) J^T r of the residuals r.
        cost: sum of squared residuals.
    """

    information: FloatArray
    gradient: FloatArray
    cost: float

    @classmethod
    def of(cls, residual: FloatArray, jacobian: FloatArray) -> NormalEquations:
        """Return the normal equations of residuals and their derivative."""
        return cls(jacobian.T @ jacobian, jacobian.T @ residual, float(residual @ residual))

    def __add__(self, other: NormalEquations) -> NormalEquations:
        return NormalEquations(
            self.information + other.information, self.gradient + other.gradient, self.cost + other.cost
        )

    def damped_step(self, damping: float) -> tuple[FloatArray, float]:
        """Return the Levenberg-Marquardt step and the reduction of the cost that it predicts.

        Args:
            damping: multiple of the information's diagonal that is added to it; zero gives the Gauss-Newton step.
        """
        damped = self.information + damping * np.diag(np.diag(self.information))
        step = np.asarray(-np.linalg.solve(damped, self.gradient), dtype=float)
        return step, float(-step @ (2 * self.gradient + self.information @ step))

    def largest_step(self) -> float:
        """Return the largest component of the Gauss-Newton step, in posterior standard deviations."""
        step, _ = self.damped_step(0.0)
        return float(np.abs(step / np.sqrt(np.diag(np.linalg.inv(self.information)))).max())


class Problem(Protocol):
    """Least-squares problem in a parameter vector x."""

    def prepare(self, x: FloatArray) -> None:
        """Set the noise levels of a round."""
        ...

    def renew_noise(self, x: FloatArray) -> None:
        """Raise the noise levels of trials with large residuals."""
        ...

    def normal_equations(self, x: FloatArray, fix_scale: bool = False) -> NormalEquations:
        """Return the normal equations at x.

        Args:
            fix_scale: True to fix the scale of all masses, as while noise levels are estimated.
        """
        ...


@contextmanager
def _determined() -> Generator[None]:
    """Raise RecordingError where a matrix is singular."""
    try:
        yield
    except np.linalg.LinAlgError as error:
        raise RecordingError(f"the recordings do not determine an estimate ({error}): record more motions") from error


@_determined()
def solve(problem: Problem, start: FloatArray, rounds: int) -> tuple[FloatArray, bool]:
    """Return the (size,) parameters of least cost, and True if the iteration converged.

    Args:
        start: (size,) parameters of the first step.
        rounds: number of times that noise levels are renewed.

    Raises:
        RecordingError: the recordings do not determine the parameters.
    """
    x = start
    for _ in range(rounds):
        problem.prepare(x)
        x, _ = _descend(problem, x, _NEAR, fix_scale=True)
        problem.renew_noise(x)
    return descend(problem, x, patience=1)


@_determined()
def descend(problem: Problem, start: FloatArray, patience: int = _PATIENCE) -> tuple[FloatArray, bool]:
    """Return the result of `solve` at the present noise levels.

    Args:
        patience: number of descents at most: poorly determined parameters converge slowly.

    Raises:
        RecordingError: the recordings do not determine the parameters.
    """
    problem.prepare(start)
    x, left = start, np.inf
    for _ in range(patience):
        x, left = _descend(problem, x, _CONVERGED)
        if left < _CONVERGED:
            break
    return x, left < _SETTLED


def _descend(problem: Problem, x: FloatArray, near: float, fix_scale: bool = False) -> tuple[FloatArray, float]:
    """Take damped steps until a full step is small or no step lowers the cost.

    Full Gauss-Newton steps overshoot where the base is nearly a rod, whose log-Cholesky parameters are strongly nonlinear.

    Returns:
        (size,) parameters, and the largest component of the last undamped step in standard deviations.
    """
    equations_at = partial(problem.normal_equations, fix_scale=fix_scale)
    here, damping, size = equations_at(x), 0.0, np.inf
    for _ in range(_ITERATIONS):
        size = here.largest_step()
        step = _downhill_step(equations_at, x, here, damping)
        if step is None:
            break
        x, here, damping = step
        if size < near:
            break
    return x, size


def _downhill_step(
    equations_at: Callable[[FloatArray], NormalEquations], x: FloatArray, here: NormalEquations, damping: float
) -> tuple[FloatArray, NormalEquations, float] | None:
    """Take one Levenberg-Marquardt step, damped until it lowers the cost.

    Returns:
        (size,) parameters, their equations and the damping of the next step; None if no step lowers the cost.
    """
    while damping < _MOST_DAMPING:
        step, predicted = here.damped_step(damping)
        there = equations_at(x + step)
        gain = here.cost - there.cost
        if gain >= -_ROUNDING * here.cost:
            eased = damping / _EASE if gain > _AS_PREDICTED * predicted else damping
            return x + step, there, eased if eased > _LEAST_DAMPING else 0.0
        damping = max(_STIFFEN * damping, _LEAST_DAMPING)
    return None
