"""Variance reductions of a plan's next step, for all candidates at once."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence

import numpy as np

from equipoise.bayesian.planning.candidates import Candidates
from equipoise.conventions import FloatArray
from equipoise.robot.posture import BodyPosture

_NEGLIGIBLE = 1e-6  # size of a row, in units of its noise, per prior standard deviation


class Steps:
    """Gains of the next step of a plan: a move, or a lift with the move to its posture unless that is planned.

    An addition J^T J to the information C^-1 lowers the weighted covariance W C W^T by

        W C J^T (1 + J C J^T)^-1 J C W^T.

    Its linear systems have as many equations as J has rows. J C J^T and J C W^T of each candidate are stored and
    updated after each step.

    Args:
        covariance: (size, size) covariance C of the parameters before the first step.
        weights: (10, size) weights W of the parameters.
    """

    def __init__(self, candidates: Candidates, covariance: FloatArray, weights: FloatArray) -> None:
        self._count = len(candidates.lifts)
        self._move = [self._count + candidates.postures.index(lift.posture) for lift in candidates.lifts]
        self._posture = [*(lift.posture for lift in candidates.lifts), *candidates.postures]
        self._rows, self._weights = _as_few_rows(candidates.rows), weights
        seen = self._times(covariance)
        self._noise = np.eye(self._rows.shape[1]) + seen @ _transposed(self._rows)
        self._shared = seen[: self._count] @ _transposed(self._rows[self._move])
        self._effect = self._times(covariance @ weights.T)

    def parts(self, index: int, visited: Container[BodyPosture]) -> tuple[int, ...]:
        """Return the indices of a candidate: a move, or a lift with the move to its posture unless that is visited."""
        if index >= self._count or self._posture[index] in visited:
            return (index,)
        return (index, self._move[index])

    def rows(self, parts: Sequence[int]) -> FloatArray:
        """Return the (m, size) J of `parts`, reduced to the fewest equivalent rows."""
        return np.concatenate([self._rows[part] for part in parts])

    def update(self, taken: FloatArray, covariance: FloatArray) -> None:
        """Update the stored matrices after a step.

        Args:
            taken: (m, size) J of that step.
            covariance: (size, size) covariance of the parameters before it.
        """
        across = covariance @ taken.T
        seen = self._times(across)
        gain = seen @ np.linalg.inv(np.eye(len(taken)) + taken @ across)
        self._noise -= gain @ _transposed(seen)
        self._shared -= gain[: self._count] @ _transposed(seen[self._move])
        self._effect -= gain @ (self._weights @ across).T

    def best(self, costs: Mapping[int, float], visited: Container[BodyPosture]) -> tuple[float, int] | None:
        """Return the largest reduction of the weighted variances per second, and its candidate's index; None without one.

        Args:
            costs: robot time of the possible candidates by index [s].
        """
        noise, effect = self._noise, self._effect
        alone = [index for index in costs if len(self.parts(index, visited)) == 1]
        lowered = dict(zip(alone, _lowered(noise[alone], effect[alone]), strict=True))
        lifts = [index for index in costs if len(self.parts(index, visited)) == 2]
        if lifts:
            moves = [self._move[index] for index in lifts]
            shared = self._shared[lifts]
            both = np.block([[noise[lifts], shared], [_transposed(shared), noise[moves]]])
            lowered |= dict(
                zip(lifts, _lowered(both, np.concatenate([effect[lifts], effect[moves]], axis=1)), strict=True)
            )
        gains = {index: lowered[index] / cost for index, cost in costs.items()}
        best = max(gains, key=lambda index: gains[index], default=None)
        return (gains[best], best) if best is not None and gains[best] > 0 else None

    def _times(self, columns: FloatArray) -> FloatArray:
        """Return the (k, m, c) products of all candidates' rows with (size, c) columns."""
        flat = self._rows.reshape(-1, len(columns)) @ columns
        return flat.reshape(*self._rows.shape[:2], -1)


def _transposed(matrices: FloatArray) -> FloatArray:
    return np.swapaxes(matrices, -1, -2)


def _lowered(noise: FloatArray, effect: FloatArray) -> list[float]:
    """Return the traces of the reductions, from (k, m, m) matrices 1 + J C J^T and (k, m, 10) J C W^T."""
    return np.sum(np.linalg.solve(noise, effect) * effect, axis=(1, 2)).tolist()


def _as_few_rows(rows: Sequence[FloatArray]) -> FloatArray:
    """Return (k, m, size) rows with the same information, with m as small as possible; zeros pad the others."""
    longest = max(map(len, rows))
    padded = np.zeros((len(rows), longest, rows[0].shape[1]))
    for index, each in enumerate(rows):
        padded[index, : len(each)] = each
    _, sizes, directions = np.linalg.svd(padded, full_matrices=False)
    count = int((sizes > _NEGLIGIBLE).sum(axis=1).max(initial=1))
    return np.asarray(sizes[:, :count, None] * directions[:, :count], dtype=float)
