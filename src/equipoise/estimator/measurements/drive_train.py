"""From encoders on the motors to the links: zeros, springs and play between them.

A motor-side encoder reads the link's angle and what the gear and the shank give under the joint's torque:

    q_link = q_read - zero - torque / k - (play / 2) sign(torque)

Springs and play are alike in joints of one kind, hips, thighs or calves. The torque is the link's, without the friction of the
motor: a motor that sticks reports the same torque while the leg behind it gives.
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
_TURNED_OVER = 0.01  # [m] times the legs' weight: torque at which play is all but on one side, 0.7 Nm on an A1


@dataclass(frozen=True, eq=False)
class JointReadings:
    """Joints of n samples, components first.

    Attributes:
        by_kind: (nj, kinds) one where a joint is of a kind.
        position: (nj, n) joint positions as read [rad].
        velocity: (nj, n) joint velocities as read [rad/s].
        torque: (nj, n) joint torques at the links, zero where none are known [Nm].
        torque_rate: (nj, n) their rates of change [Nm/s].
        acceleration: (nj, n) joint accelerations as read [rad/s2].
        small: torque at which play is all but on one side [Nm].
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
        """Of (n, nj) samples; what is not given is zero."""
        none = np.zeros_like(position)
        position, velocity, torque, rate, acceleration = (
            np.ascontiguousarray((none if part is None else part).T)
            for part in (position, velocity, torque, torque_rate, acceleration)
        )
        small = _TURNED_OVER * float(legs.mass.sum()) * GRAVITY
        return cls(legs.by_kind, position, velocity, torque, rate, acceleration, small)

    def at(self, places: NDArray[np.intp]) -> JointReadings:
        """Some of the samples."""
        position, velocity, torque, rate, acceleration = (
            part[:, places] for part in (self.position, self.velocity, self.torque, self.torque_rate, self.acceleration)
        )
        return JointReadings(self.by_kind, position, velocity, torque, rate, acceleration, self.small)

    def later(self, values: TracedValues) -> tuple[Traced, Traced]:
        """`link_position` and `link_velocity` at the moments of the IMU's samples, which are younger."""
        late = values["clock_offset"]
        return (
            self.link_position(values) + late * self.velocity,
            self.link_velocity(values) + late * self.acceleration,
        )

    def link_position(self, values: TracedValues) -> Traced:
        """(nj, n) joint positions of the links [rad]."""
        side = np.tanh(self.torque / self.small)
        given = self._of_joints(values["compliance"]) * self.torque + 0.5 * self._of_joints(values["backlash"]) * side
        sine, cosine = _eccentricity(values)
        turned = sine * np.sin(self.position) + cosine * np.cos(self.position)
        return self.position - values["joint_offset"] - given - turned

    def link_velocity(self, values: TracedValues) -> Traced:
        """(nj, n) joint velocities of the links [rad/s]."""
        side_rate = (1 - np.tanh(self.torque / self.small) ** 2) * self.torque_rate / self.small
        given = self._of_joints(values["compliance"]) * self.torque_rate
        sine, cosine = _eccentricity(values)
        turning = (sine * np.cos(self.position) - cosine * np.sin(self.position)) * self.velocity
        return Traced(self.velocity) - given - 0.5 * self._of_joints(values["backlash"]) * side_rate - turning

    def _of_joints(self, of_kinds: Traced) -> Traced:
        return contract("jk,k...->j...", self.by_kind, of_kinds)


def _eccentricity(values: TracedValues) -> tuple[Traced, Traced]:
    """(nj, n) what goes with the sine and with the cosine of a joint's reading [rad]."""
    return values["eccentricity"][::2], values["eccentricity"][1::2]
