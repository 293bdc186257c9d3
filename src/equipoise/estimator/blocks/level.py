"""Walks: lines between standing feet, which are level but for the floor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.estimator.blocks.block import MotionBlock
from equipoise.estimator.measurements.evidence import RunEvidence
from equipoise.estimator.measurements.leg_motion import LegChains
from equipoise.estimator.measurements.lift_samples import LiftSamples
from equipoise.estimator.measurements.tilt_equation import TiltEquation
from equipoise.estimator.parameters import Unknowns

# By which a line between two feet of a robot that walks may seem to lean, from step to step: the mean of what the
# accelerometer feels is not gravity alone, and floors are uneven. Three steps in a row say what one says.
_LEAN_NOISE = 0.02  # [rad]


class LevelBlock(MotionBlock):
    """The floor that a robot walks on is level, but for its slope: the line between two standing feet rises to neither."""

    depends_on = TiltEquation.DEPENDS_ON

    def __init__(self, unknowns: Unknowns, legs: LegChains, steps: Sequence[tuple[int, LiftSamples]]) -> None:
        super().__init__(unknowns, [(index, slice(k, k + 1)) for k, (index, _) in enumerate(steps)])
        self.equation = TiltEquation(unknowns.robot, legs, [step for _, step in steps])

    @classmethod
    def of(cls, unknowns: Unknowns, legs: LegChains, evidence: RunEvidence) -> LevelBlock | None:
        """All steps of a run; None if there is none."""
        steps = [(motion.index, step) for motion in evidence.motions for step in motion.steps]
        return cls(unknowns, legs, steps) if steps else None

    def residual(self, x: FloatArray) -> FloatArray:
        lean, _ = self.equation.lean(self.unknowns.values(x))
        return lean / (_LEAN_NOISE * self.scale)

    def linearise(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        lean, by = self.equation.lean(self.unknowns.values(x), self.open)
        noise = _LEAN_NOISE * self.scale
        return lean / noise, self._by_unknowns(x, by) / noise[:, None]

    def normalised_residual(self, x: FloatArray) -> FloatArray:
        return self.scale * np.abs(self.residual(x))
