"""Moves over planted feet: what does not change tells about joint zeros and about how the IMU is mounted.

While no foot slips, the feet's positions relative to each other change only by how the feet roll; and their heights above
each other, against gravity, do not change at all. Both are read at rest, before and after the move.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.precise.measurements.leg_motion import LegChains, cross
from equipoise.precise.measurements.lift_samples import at_times, attitudes
from equipoise.precise.measurements.tilt_equation import mounting
from equipoise.precise.unknowns import Values
from equipoise.recording.recording import Recording
from equipoise.robot.model import RobotModel


@dataclass(frozen=True, eq=False)
class RestReading:
    """A planted robot at rest: means over that rest.

    Attributes:
        joint_position: (nj,) mean of the joint positions [rad].
        acceleration_in_imu: (3,) mean of the accelerometer, in the IMU frame [m/s2].
    """

    joint_position: FloatArray
    acceleration_in_imu: FloatArray

    @classmethod
    def of(cls, still: Recording) -> RestReading:
        """Of a recording in which nothing moves."""
        return cls(still.joints.position.mean(axis=0), still.imu.acceleration_in_imu.mean(axis=0))


@dataclass(frozen=True, eq=False)
class PlantedMove:
    """A move between two rests, all feet planted.

    Attributes:
        before, after: rests on either side of the move.
        rotation_to_before: (3, 3) rotation from the IMU frame after the move to that before, by the gyroscope.
        rolled: (4, 3) displacements of the feet's centres by rolling, in base axes before the move [m].
    """

    before: RestReading
    after: RestReading
    rotation_to_before: FloatArray
    rolled: FloatArray


def read_move(
    robot: RobotModel, legs: LegChains, before: Recording, moving: Recording, after: Recording, gyro_bias: FloatArray
) -> PlantedMove:
    """A move and the rests on either side of it; the three recordings follow each other."""
    rotation = np.array(robot.imu_in_base.rotation)
    attitude = attitudes(moving.imu.time, moving.imu.angular_velocity_in_imu - gyro_bias)
    first, last = RestReading.of(before), RestReading.of(after)
    up = attitude.inv().apply(first.acceleration_in_imu / np.linalg.norm(first.acceleration_in_imu)) @ rotation.T
    joints = moving.joints
    up = at_times(joints.time, moving.imu.time, up)
    velocity = joints.velocity if joints.velocity is not None else np.gradient(joints.position, joints.time, axis=0)
    angular_velocity_in_base = at_times(
        joints.time, moving.imu.time, (moving.imu.angular_velocity_in_imu - gyro_bias) @ rotation.T
    )
    foot = legs.motion(joints.position, velocity, angular_velocity_in_base).foot_angular_velocity
    rolling = cross(foot, legs.foot_radius[:, None] * up[:, None])
    to_before = rotation @ attitude.as_matrix() @ rotation.T
    to_before = to_before[np.clip(np.searchsorted(moving.imu.time, joints.time), 0, len(to_before) - 1)]
    rolled = np.trapezoid(np.einsum("nij,nlj->nli", to_before, rolling), joints.time, axis=0)
    return PlantedMove(first, last, attitude.as_matrix()[-1], rolled)


class PlantedRows:
    """Residuals of planted moves and rests, at any values of the unknowns that they depend on.

    Attributes:
        DEPENDS_ON: names of the unknowns that the rows depend on.
    """

    DEPENDS_ON = ("joint_zero", "imu_tilt", "accelerometer_bias", "foot_radius")

    def __init__(self, legs: LegChains, rotation_imu_to_base: FloatArray, moves: Sequence[PlantedMove]) -> None:
        self.legs, self._rotation = legs, rotation_imu_to_base
        self._position = np.array([[move.before.joint_position, move.after.joint_position] for move in moves])
        self._acceleration = np.array(
            [[move.before.acceleration_in_imu, move.after.acceleration_in_imu] for move in moves]
        )
        self._to_before = np.array([move.rotation_to_before for move in moves])
        self._rolled = np.array([move.rolled for move in moves])

    def residuals(self, values: Values) -> tuple[FloatArray, FloatArray]:
        """What should be zero at the right values.

        Returns:
            (moves, 4, 3) displacements of the feet relative to their mean, in base axes before the move [m];
            (moves, 2, 4) heights of the feet's centres above their mean, against gravity, at the rests [m].
        """
        rotation = mounting(self._rotation, values["imu_tilt"])
        count = len(self._position)
        feet = self.legs.feet((self._position - values["joint_zero"]).reshape(2 * count, -1)).reshape(count, 2, 4, 3)
        to_before = rotation @ self._to_before @ rotation.T
        rolled = (1 + values["foot_radius"]) * self._rolled
        moved = np.einsum("mij,mlj->mli", to_before, feet[:, 1]) - feet[:, 0] - rolled
        gravity = (self._acceleration - values["accelerometer_bias"]) @ rotation.T
        up = gravity / np.linalg.norm(gravity, axis=2, keepdims=True)
        heights = np.einsum("mrlj,mrj->mrl", feet, up)
        return moved - moved.mean(axis=1, keepdims=True), heights - heights.mean(axis=2, keepdims=True)
