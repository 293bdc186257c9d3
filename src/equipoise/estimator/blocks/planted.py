"""Moves over planted feet: feet that stay, footholds that keep their heights."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.estimator.blocks.block import LEFT_OUT, MotionBlock, whitening_of
from equipoise.estimator.measurements.evidence import RunEvidence
from equipoise.estimator.measurements.leg_motion import LegChains
from equipoise.estimator.measurements.planted_moves import PlantedMove, PlantedRows
from equipoise.estimator.parameters import Unknowns

# Feet at rest on an A1: how far they seem to move [m], and to rise [m]; and how the gyroscope's attitude drifts over a move
# and the accelerometer's wanders from rest to rest [rad]. Twice what an ideal robot shows: each rest ends one move and begins
# the next, and springs and feet that sag are the same in all.
_FOOT_NOISE, _HEIGHT_NOISE, _TURN_NOISE, _UP_NOISE = 2.4e-4, 1.6e-4, 6e-4, 8e-4
_QUIETEST = 0.3  # of these, what robots with ordinary sensors show
_SAYING = 15  # rows of a move's twenty that say something: means are taken off
_FEWEST_FREEDOMS = 20.0  # from which on the noise that residuals show is known to a fifth
# Times what residuals show is what feet may do: they show less by chance, and what they do lasts over moves.
_RESTLESS = 1.5


class PlantedBlock(MotionBlock):
    """Rows of planted moves: feet that stay, footholds that keep their heights. Whitened."""

    depends_on = PlantedRows.DEPENDS_ON
    _quiet = 1.0  # factor on the noise that is allowed for, which quiet feet have shown

    def __init__(
        self, unknowns: Unknowns, legs: LegChains, rotation: FloatArray, moves: Sequence[tuple[int, PlantedMove]]
    ) -> None:
        motions = [(index, slice(20 * k, 20 * k + 20)) for k, (index, _) in enumerate(moves)]
        super().__init__(unknowns, motions)
        self.rows = PlantedRows(legs, rotation, unknowns.stance, [move for _, move in moves])
        feet, size = self.rows.footholds, unknowns.stance.scale.length
        turns = np.asarray([np.cross(axis, feet).T.ravel() for axis in np.eye(3)], dtype=float)
        moved = (size * _FOOT_NOISE) ** 2 * np.eye(12) + _TURN_NOISE**2 * turns.T @ turns
        leaning = feet[:, :2] @ feet[:, :2].T
        heights = (size * _HEIGHT_NOISE) ** 2 * np.eye(4) + _UP_NOISE**2 * leaning
        whitening = np.zeros((20, 20))
        whitening[:12, :12] = whitening_of(moved)
        whitening[12:16, 12:16] = whitening[16:, 16:] = whitening_of(heights)
        self._whitening = whitening

    @classmethod
    def of(cls, unknowns: Unknowns, legs: LegChains, evidence: RunEvidence) -> PlantedBlock | None:
        """All planted moves of a run; None if there is none."""
        moves = [(motion.index, motion.move) for motion in evidence.motions if motion.move is not None]
        return cls(unknowns, legs, np.array(unknowns.robot.imu_in_base.rotation), moves) if moves else None

    def residual(self, x: FloatArray) -> FloatArray:
        return self._whitened(self.rows.residuals(self.unknowns.values(x)).reshape(-1, 20, 1)).ravel()

    def linearise(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        rows, by = self.rows.linearise(self.unknowns.values(x), self.open)
        columns = self._by_unknowns(x, by).reshape(-1, 20, len(self.columns))
        jacobian = self._whitened(columns).reshape(-1, len(self.columns))
        return self._whitened(rows.reshape(-1, 20, 1)).ravel(), jacobian

    def at_shown_noise(self, x: FloatArray) -> PlantedBlock:
        """The same rows at the noise that they show at x, where that is less than what is allowed for."""
        return self._as_quiet_as(float(np.median(self.normalised_residual(x))))

    def at_found_noise(self, x: FloatArray, covariance: FloatArray) -> PlantedBlock:
        """The same rows at the noise that residuals at x show, the unknowns' freedoms taken off, where that is less.

        Args:
            covariance: (size, size) covariance of the estimate x.
        """
        residual, jacobian = self.linearise(x)
        taken = float(np.einsum("ij,jk,ik->", jacobian, covariance[np.ix_(self.columns, self.columns)], jacobian))
        freedoms = _SAYING * float(np.sum(self.scale < LEFT_OUT)) - taken
        if freedoms < _FEWEST_FREEDOMS:
            return self
        return self._as_quiet_as(self._quiet * _RESTLESS * float(np.sqrt(residual @ residual / freedoms)))

    def _as_quiet_as(self, shown: float) -> PlantedBlock:
        """The same rows at a factor on the noise that is allowed for; what is left out stays so."""
        found = copy(self)
        found._quiet = max(_QUIETEST, min(1.0, shown))
        found.scale = np.where(self.scale < LEFT_OUT, self.scale / self._quiet * found._quiet, LEFT_OUT)
        return found

    def _whitened(self, rows: FloatArray) -> FloatArray:
        """(moves, 20, k) of such."""
        return np.asarray(self._whitening @ rows / self.scale[:, None, None], dtype=float)

    def normalised_residual(self, x: FloatArray) -> FloatArray:
        residual = self.residual(x).reshape(-1, 20)
        return self.scale * np.sqrt((residual**2).sum(axis=1) / _SAYING)
