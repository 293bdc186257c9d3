"""Level-floor equation of walks: the line between two standing feet is level except for the floor's slope."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.estimator.equations.equation import MotionEquation
from equipoise.estimator.measurements.lift_samples import StepSamples
from equipoise.estimator.measurements.tilt_invariant import TiltInvariant
from equipoise.estimator.parameters import Unknowns

# Noise of a line's inclination, from step to step: the accelerometer's mean is not gravity alone, and floors are uneven.
# The errors of three successive steps are correlated.
_LEAN_NOISE = 0.02  # [rad]


class LevelFloor(MotionEquation[StepSamples]):
    """Rows of the inclination of the line between two standing feet, corrected for the floor's slope.

    The samples are the steps that the tilt equation reads.
    """

    depends_on = TiltInvariant.DEPENDS_ON
    name = "level floor"
    kind = StepSamples
    source = "noise of the lines between standing feet"

    def __init__(self, unknowns: Unknowns, samples: Sequence[tuple[int, StepSamples]]) -> None:
        super().__init__(unknowns, samples)
        self.equation = TiltInvariant(unknowns.robot, unknowns.legs, self.samples)

    def _rows_in(self, sample: StepSamples) -> int:
        return 1

    def residual(self, x: FloatArray) -> FloatArray:
        lean, _ = self.equation.lean(self.unknowns.values(x))
        return lean / (_LEAN_NOISE * self.scale)

    def linearise(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        lean, by = self.equation.lean(self.unknowns.values(x), self.open)
        noise = _LEAN_NOISE * self.scale
        return lean / noise, self._by_unknowns(x, by) / noise[:, None]

    def normalized_residual(self, x: FloatArray) -> FloatArray:
        return self.scale * np.abs(self.residual(x))
