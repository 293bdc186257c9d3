"""Legs that swung in the air."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.estimator.blocks.block import ResidualBlock
from equipoise.estimator.measurements.evidence import RunEvidence
from equipoise.estimator.measurements.leg_motion import LegChains
from equipoise.estimator.measurements.leg_swing import LegSwing
from equipoise.estimator.parameters import INERTIAL, Unknowns


class LegSwingBlock(ResidualBlock):
    """Rows of legs that swung in the air. Whitened as they come."""

    depends_on = (*INERTIAL, "torque_gain_common", "torque_gain")

    def __init__(self, unknowns: Unknowns, swings: Sequence[tuple[int, LegSwing]]) -> None:
        rows = [0, *np.cumsum([len(swing.target) for _, swing in swings]).tolist()]
        super().__init__(
            unknowns,
            [(index, slice(*edges)) for (index, _), edges in zip(swings, itertools.pairwise(rows), strict=True)],
        )
        self._rows = np.concatenate([swing.rows for _, swing in swings])
        self._target = np.concatenate([swing.target for _, swing in swings])

    @classmethod
    def of(cls, unknowns: Unknowns, legs: LegChains, evidence: RunEvidence) -> LegSwingBlock | None:
        """All such of a run; None if there is none."""
        swings = [(motion.index, motion.leg_swing) for motion in evidence.motions if motion.leg_swing is not None]
        return cls(unknowns, swings) if swings else None

    def residual(self, x: FloatArray) -> FloatArray:
        values = self.unknowns.values(x)
        gains = values["torque_gain_common"] + values["torque_gain"]
        return self._rows @ np.concatenate([self.unknowns.inertial(x)[10:], gains]) - self._target

    def information(self, x: FloatArray) -> FloatArray:
        """(size, size) information on all unknowns."""
        rows = np.zeros((len(self._target), self.unknowns.size))
        rows[:, self.columns] = self.linearise(x)[1]
        return rows.T @ rows

    def linearise(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        of_links, of_gains = np.split(self._rows, [len(self.unknowns.model_links)], axis=1)
        by = {
            "inertial": np.hstack([np.zeros((len(of_links), 10)), of_links]),
            "torque_gain_common": of_gains.sum(axis=1, keepdims=True),
            "torque_gain": of_gains,
        }
        return self.residual(x), self._by_unknowns(x, by)
