"""Gauss-Newton in rounds: noise levels of trials that fit worse than their sensors explain are raised, outliers left out."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from equipoise.alive import alive
from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError

_ITERATIONS = 8
_RENEWED = 2  # iteration of the first round at which columns by differences are renewed
_CONVERGED = 1e-2  # largest change of an unknown, in units of its posterior standard deviation
_NEARLY = 0.5  # of that: a step that large at the end is no end


class Problem(Protocol):
    """Squared residuals of a vector of unknowns."""

    def prepare(self, x: FloatArray) -> None:
        """Noise levels of a round."""
        ...

    def differentiate(self, x: FloatArray) -> None:
        """Renew the columns that are differences."""
        ...

    def renew_noise(self, x: FloatArray) -> None:
        """Raise the noise of what does not fit."""
        ...

    def cost(self, x: FloatArray) -> float:
        """Squared residuals."""
        ...

    def normal_equations(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(size, size) information and (size,) gradient."""
        ...


def solve(problem: Problem, start: FloatArray, rounds: int) -> tuple[FloatArray, bool]:
    """The (size,) unknowns of least cost, and whether the last step was small; if not, something does not fit at all.

    Args:
        start: (size,) unknowns to start at.
        rounds: number of times that noise levels are renewed.

    Raises:
        RecordingError: what was recorded does not determine the unknowns.
    """
    x, converged = start, False
    try:
        for remaining in range(rounds, -1, -1):
            problem.prepare(x)
            x, converged = _descend(problem, x, first_round=remaining == rounds)
            if remaining:
                problem.renew_noise(x)
    except np.linalg.LinAlgError as error:
        raise RecordingError(f"the recordings do not determine an estimate: {error}") from error
    return x, converged


def _descend(problem: Problem, x: FloatArray, first_round: bool) -> tuple[FloatArray, bool]:
    """Steps that are halved until they help; where no part of one does, columns by differences are out of date."""
    cost, full, deviation = problem.cost(x), np.full(len(x), np.inf), np.ones(len(x))
    renew = True
    for iteration in range(_ITERATIONS):
        alive()
        renewed = renew or (first_round and iteration == _RENEWED)
        if renewed:
            problem.differentiate(x)
        renew = False
        information, gradient = problem.normal_equations(x)
        full = -np.linalg.solve(information, gradient)
        deviation = np.sqrt(np.diag(np.linalg.inv(information)))
        for part in 0.5 ** np.arange(8):
            tried = problem.cost(x + part * full)
            if tried <= cost * (1 + 1e-9):
                x, cost = x + part * full, tried
                break
        else:
            if renewed:
                break
            renew = True
        if (np.abs(full) < _CONVERGED * deviation).all():
            break
    return x, bool((np.abs(full) < _NEARLY * deviation).all())
