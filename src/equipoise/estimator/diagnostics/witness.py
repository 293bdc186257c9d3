"""What a sway says of where the IMU sits, beside an estimate: tilts take that place for inertia, and a sway does not.

In ordinary runs it says what the tilts say, less surely, and stays a witness: the check. Where the two differ, as with a file
that has the IMU a centimetre elsewhere, its word is evidence; and where legs are trusted, whose lengths look the same.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.estimator.equations.imu_position import SwaySamples, imu_by_sway
from equipoise.estimator.problem import Posterior

# Standard deviations by which sway and tilts differ. With an IMU where the file has it two of 58 development runs are beyond,
# and their Ixx moves by 0.6 and 0.9 of its own; with one a centimetre off that tilts did not find, 14 of 16.
_DIFFERS = 1.5


@dataclass(frozen=True, eq=False)
class SwayWitness:
    """Where the IMU sits by a sway.

    Attributes:
        place: (3,) in the base frame, less where the model has it [m].
        apart: (3,) the same, less where the estimate has it [m].
        deviation: (3,) standard deviation of that [m].
        vouched_for: whether somebody said that it sits where the model has it.
    """

    place: FloatArray
    apart: FloatArray
    deviation: FloatArray
    vouched_for: bool

    @classmethod
    def of(cls, posterior: Posterior) -> SwayWitness | None:
        """Of a run's first sway; None if there is none."""
        sways = [sway for motion in posterior.motions for sway in motion.of(SwaySamples)]
        if not sways:
            return None
        unknowns = posterior.unknowns
        values, scale = unknowns.values(posterior.x), unknowns.stance.scale
        place, deviation = imu_by_sway(unknowns.robot, unknowns.legs, sways[0], values, scale)
        held = not unknowns.estimates("imu_position")
        known = deviation if held else np.hypot(deviation, posterior.deviation("imu_position"))
        return cls(place, place - values["imu_position"], known, held)

    @property
    def deviates(self) -> float:
        """Standard deviations that it is apart along the axis of most."""
        return float(np.abs(self.apart / self.deviation).max())

    @property
    def tells(self) -> bool:
        """Whether it says something that an estimate without it does not, and that nobody knows better."""
        return self.deviates > _DIFFERS and not self.vouched_for
