"""Drive train model from motor encoders to links: joint offsets, compliance, backlash and eccentricity.

A motor-side encoder reads the link's angle and the deflection of gear and shank under the joint's torque:

    q_link = q_read - offset - torque / k - (backlash / 2) sign(torque)

Compliance and backlash are equal in joints of one kind: hips, thighs or calves. The torque is the link's, without motor
friction: a sticking motor reports the same torque while the leg behind it deflects.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from equipoise.conventions import GRAVITY, FloatArray
from equipoise.estimator.measurements.leg_motion import LegChains
from equipoise.estimator.measurements.traced import Traced, contract
from equipoise.estimator.unknowns import TracedValues

DRIVE_TRAIN = ("joint_offset", "compliance", "backlash", "eccentricity")
_BACKLASH_ARM = 0.01  # [m] times the legs' weight: torque that takes up the backlash almost fully, 0.7 Nm on an A1


@dataclass(frozen=True, eq=False)
class JointReadings:
    """Joint readings of n samples, components first.

    Attributes:
        by_kind: (nj, kinds) one where a joint is of a kind, else zero.
        position: (nj, n) joint position readings [rad].
        velocity: (nj, n) joint velocity readings [rad/s].
        torque: (nj, n) joint torques at the links, or zero [Nm].
        torque_rate: (nj, n) rates of change of `torque` [Nm/s].
        acceleration: (nj, n) joint acceleration readings [rad/s2].
        small: torque that takes up the backlash almost fully [Nm].
    """

    by_kind: FloatArray
    position: FloatArray
    velocity: FloatArray
    torque: FloatArray
    torque_rate: FloatArray
    acceleration: FloatArray
    small: float

    @classmethod
    def of(
        cls, legs: LegChains, position: FloatArray, velocity: FloatArray | None = None, torque: FloatArray | None = None,
        torque_rate: FloatArray | None = None, acceleration: FloatArray | None = None,
    ) -> JointReadings:  # fmt: skip
        """Collect (n, nj) samples; omitted ones are zero."""
        none = np.zeros_like(position)
        given = (position, velocity, torque, torque_rate, acceleration)
        parts = (np.ascontiguousarray((none if part is None else part).T) for part in given)
        return cls(legs.by_kind, *parts, small=_BACKLASH_ARM * float(legs.mass.sum()) * GRAVITY)

    def at(self, places: NDArray[np.intp]) -> JointReadings:
        """Select samples by index."""
        readings = (self.position, self.velocity, self.torque, self.torque_rate, self.acceleration)
        return JointReadings(self.by_kind, *(part[:, places] for part in readings), small=self.small)

    def later(self, values: TracedValues) -> tuple[Traced, Traced]:
        """Return `link_position` and `link_velocity` at the times of the IMU's samples, which are later."""
        late = values["clock_offset"]
        return (
            self.link_position(values) + late * self.velocity,
            self.link_velocity(values) + late * self.acceleration,
        )

    def link_position(self, values: TracedValues) -> Traced:
        """Return (nj, n) joint positions of the links [rad]."""
        side = np.tanh(self.torque / self.small)
        bent = self._of_joints(values["compliance"]) * self.torque + 0.5 * self._of_joints(values["backlash"]) * side
        sine, cosine = _eccentricity(values)
        eccentric = sine * np.sin(self.position) + cosine * np.cos(self.position)
        return self.position - values["joint_offset"] - bent - eccentric

    def link_velocity(self, values: TracedValues) -> Traced:
        """Return (nj, n) joint velocities of the links [rad/s]."""
        side_rate = (1 - np.tanh(self.torque / self.small) ** 2) * self.torque_rate / self.small
        rate = self._of_joints(values["compliance"]) * self.torque_rate
        sine, cosine = _eccentricity(values)
        eccentric_rate = (sine * np.cos(self.position) - cosine * np.sin(self.position)) * self.velocity
        return Traced(self.velocity) - rate - 0.5 * self._of_joints(values["backlash"]) * side_rate - eccentric_rate

    def _of_joints(self, of_kinds: Traced) -> Traced:
        return contract("jk,k...->j...", self.by_kind, of_kinds)


def _eccentricity(values: TracedValues) -> tuple[Traced, Traced]:
    """Return the (nj, n) amplitudes of the sine and cosine of a joint's reading [rad]."""
    return values["eccentricity"][::2], values["eccentricity"][1::2]
