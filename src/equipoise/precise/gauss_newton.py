"""Gauss-Newton in rounds: noise levels of trials that fit worse than their sensors explain are raised, outliers left out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from equipoise.alive import alive
from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError

_ITERATIONS, _HALVINGS, _PATIENCE = 8, 8, 4
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

    def step(self) -> tuple[FloatArray, float]:
        """Gauss-Newton step, and the largest part of it in standard deviations of the unknown that it changes."""
        step = -np.linalg.solve(self.information, self.gradient)
        deviation = np.sqrt(np.diag(np.linalg.inv(self.information)))
        return np.asarray(step, dtype=float), float(np.abs(step / deviation).max())


class Problem(Protocol):
    """Squared residuals of a vector of unknowns."""

    def prepare(self, x: FloatArray) -> None:
        """Noise levels of a round."""
        ...

    def renew_noise(self, x: FloatArray) -> None:
        """Raise the noise of what does not fit."""
        ...

    def let_go(self) -> None:
        """Free what was held while noise levels were sought."""
        ...

    def normal_equations(self, x: FloatArray) -> NormalEquations:
        """Squared residuals and their derivatives."""
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
            x, _ = _descend(problem, x, _NEAR)
            problem.renew_noise(x)
        problem.let_go()
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


def _descend(problem: Problem, x: FloatArray, near: float) -> tuple[FloatArray, float]:
    """Steps that are halved until they help, until one is small or no part of one helps; and the last one's size."""
    here, size = problem.normal_equations(x), np.inf
    for _ in range(_ITERATIONS):
        alive()
        step, size = here.step()
        if size < near:
            return x + step, size
        for part in 0.5 ** np.arange(_HALVINGS):
            there = problem.normal_equations(x + part * step)
            if there.cost <= here.cost * (1 + 1e-9):
                x, here = x + part * step, there
                break
        else:
            break
    return x, size
