"""Least squares in rounds: noise levels of trials that fit worse than their sensors explain are raised, outliers left out.

Each round takes Gauss-Newton steps, damped where a whole one does not lower the cost (Marquardt 1963).
"""

from __future__ import annotations

from collections.abc import Callable
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
# Largest part of a step, in posterior standard deviations of the unknown: with one so small a round is done, whose noise
# levels hang on the unknowns little; with one so small the estimate is; and a larger last one is none.
_NEAR, _CONVERGED, _SETTLED = 0.3, 1e-2, 0.5


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Squared residuals and their derivatives, to first order of the residuals.

    Attributes:
        information: (size, size) J^T J of the residuals' derivative J.
        gradient: (size,) J^T r of the residuals r.
        cost: squared residuals.
    """

    information: FloatArray
    gradient: FloatArray
    cost: float

    @classmethod
    def of(cls, residual: FloatArray, jacobian: FloatArray) -> NormalEquations:
        """Of residuals and their derivative."""
        return cls(jacobian.T @ jacobian, jacobian.T @ residual, float(residual @ residual))

    def __add__(self, other: NormalEquations) -> NormalEquations:
        return NormalEquations(
            self.information + other.information, self.gradient + other.gradient, self.cost + other.cost
        )

    def damped_step(self, damping: float) -> tuple[FloatArray, float]:
        """Return the Levenberg-Marquardt step, and by how much it is predicted to lower the cost.

        Args:
            damping: multiple of the information's diagonal that is added to it; zero gives the Gauss-Newton step.
        """
        damped = self.information + damping * np.diag(np.diag(self.information))
        step = np.asarray(-np.linalg.solve(damped, self.gradient), dtype=float)
        return step, float(-step @ (2 * self.gradient + self.information @ step))

    def largest_step(self) -> float:
        """Return the largest part of the Gauss-Newton step, in standard deviations of the unknown that it changes."""
        step, _ = self.damped_step(0.0)
        return float(np.abs(step / np.sqrt(np.diag(np.linalg.inv(self.information)))).max())


class Problem(Protocol):
    """Squared residuals of a vector of unknowns."""

    def prepare(self, x: FloatArray) -> None:
        """Noise levels of a round."""
        ...

    def renew_noise(self, x: FloatArray) -> None:
        """Raise the noise of what does not fit."""
        ...

    def normal_equations(self, x: FloatArray, scale_held: bool = False) -> NormalEquations:
        """Squared residuals and their derivatives.

        Args:
            scale_held: whether the scale of all masses is held, as while noise levels are sought.
        """
        ...


def solve(problem: Problem, start: FloatArray, rounds: int) -> tuple[FloatArray, bool]:
    """The (size,) unknowns of least cost, and whether the last step was small; if not, something does not fit at all.

    Args:
        start: (size,) unknowns to start at.
        rounds: number of times that noise levels are renewed.

    Raises:
        RecordingError: what was recorded does not determine the unknowns.
    """
    x = start
    try:
        for _ in range(rounds):
            problem.prepare(x)
            x, _ = _descend(problem, x, _NEAR, scale_held=True)
            problem.renew_noise(x)
        problem.prepare(x)
        x, left = _descend(problem, x, _CONVERGED)
    except np.linalg.LinAlgError as error:
        raise RecordingError(f"the recordings do not determine an estimate: {error}") from error
    return x, left < _SETTLED


def descend(problem: Problem, start: FloatArray) -> tuple[FloatArray, bool]:
    """As `solve`, at the noise levels as they are.

    Raises:
        RecordingError: what was recorded does not determine the unknowns.
    """
    try:
        problem.prepare(start)
        x, left = start, np.inf
        for _ in range(_PATIENCE):  # what is told little is found slowly
            x, left = _descend(problem, x, _CONVERGED)
            if left < _CONVERGED:
                break
    except np.linalg.LinAlgError as error:
        raise RecordingError(f"the recordings do not determine an estimate: {error}") from error
    return x, left < _SETTLED


def _descend(problem: Problem, x: FloatArray, near: float, scale_held: bool = False) -> tuple[FloatArray, float]:
    """Take damped steps until a whole one is small or no step lowers the cost.

    Whole Gauss-Newton steps overshoot where the base is nearly a rod, whose log-Cholesky parameters curve strongly.

    Returns:
        (size,) unknowns, and the largest part of the last undamped step in standard deviations.
    """
    equations_at = partial(problem.normal_equations, scale_held=scale_held)
    here, damping, size = equations_at(x), 0.0, np.inf
    for _ in range(_ITERATIONS):
        size = here.largest_step()
        lower = _lower(equations_at, x, here, damping)
        if lower is None:
            break
        x, here, damping = lower
        if size < near:
            break
    return x, size


def _lower(
    equations_at: Callable[[FloatArray], NormalEquations], x: FloatArray, here: NormalEquations, damping: float
) -> tuple[FloatArray, NormalEquations, float] | None:
    """Take one Levenberg-Marquardt step, damped until it lowers the cost.

    Returns:
        (size,) unknowns, their equations and the damping of the next step; None if no step lowers the cost.
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
