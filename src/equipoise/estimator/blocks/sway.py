"""Where the IMU sits by a sway over planted feet, for runs whose tilts say otherwise (`findings.witness` says which)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.estimator.blocks.block import ResidualBlock
from equipoise.estimator.measurements.evidence import RunEvidence
from equipoise.estimator.measurements.imu_place import SwaySamples, imu_by_sway
from equipoise.estimator.measurements.leg_motion import LegChains
from equipoise.estimator.parameters import Unknowns


class SwayBlock(ResidualBlock):
    """The IMU's place less that by each sway, which hangs a little on joint zeros and mounting: rounds follow that."""

    depends_on = ("imu_position",)

    def __init__(self, unknowns: Unknowns, legs: LegChains, sways: Sequence[tuple[int, SwaySamples]]) -> None:
        super().__init__(unknowns, [(index, slice(3 * k, 3 * k + 3)) for k, (index, _) in enumerate(sways)])
        self._legs, self._sways = legs, [sway for _, sway in sways]
        self._place, self._noise = np.zeros((len(sways), 3)), np.ones((len(sways), 3))

    @classmethod
    def of(cls, unknowns: Unknowns, legs: LegChains, evidence: RunEvidence) -> SwayBlock | None:
        """All sways of a run; None if there is none, or the place is held at the model's."""
        sways = [(motion.index, motion.sway) for motion in evidence.motions if motion.sway is not None]
        return cls(unknowns, legs, sways) if sways and unknowns.estimates("imu_position") else None

    def prepare(self, x: FloatArray) -> None:
        values, unknowns = self.unknowns.values(x), self.unknowns
        found = [imu_by_sway(unknowns.robot, self._legs, sway, values, unknowns.stance.scale) for sway in self._sways]
        self._place, self._noise = (np.array(part) for part in zip(*found, strict=True))

    def residual(self, x: FloatArray) -> FloatArray:
        return ((self.unknowns.value(x, "imu_position") - self._place) / self._noise).ravel()

    def linearise(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        unit = np.diag(self.unknowns.scale[self.unknowns["imu_position"]])
        return self.residual(x), (unit / self._noise[..., None]).reshape(-1, 3)
