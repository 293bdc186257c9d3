"""Moves over planted feet: what does not change tells about joint zeros and about how the IMU is mounted.

While no foot slips, the feet's positions relative to each other change only by how the feet roll; and their heights above
each other, against gravity, by how they sag under what they carry. Both are read at rest, before and after the move. What each
foot carries there is statics', by the model's mass and CoM: torques that motors report hide it behind their friction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from equipoise.conventions import FloatArray
from equipoise.estimator.measurements.drive_train import DRIVE_TRAIN, JointReadings
from equipoise.estimator.measurements.heading import facing
from equipoise.estimator.measurements.imu_frame import (
    ACCELEROMETER,
    GYRO,
    gyro_error,
    mean_rotation,
    specific_force,
    traced_mounting,
    turned_by,
    turns_of,
)
from equipoise.estimator.measurements.leg_motion import LEG_SHAPE, LegChains, LegShape
from equipoise.estimator.measurements.leg_motion import cross as cross_of_rows
from equipoise.estimator.measurements.lift_samples import at_times, attitudes
from equipoise.estimator.measurements.traced import Traced, contract, cross, length, stacked, turned
from equipoise.estimator.unknowns import TracedValues, Values, inputs_of
from equipoise.recording.recording import Recording
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance
from equipoise.robot.statics import loads_on_feet

_PER_MOVE = 20
_CENTRED = np.eye(4) - 0.25  # takes the mean over the feet off
_WARP = np.array([[1.0], [-1.0], [-1.0], [1.0]])


@dataclass(frozen=True, eq=False)
class RestReading:
    """A planted robot at rest: means over that rest.

    Attributes:
        joint_position: (nj,) mean of the joint positions [rad].
        acceleration_in_imu: (3,) mean of the accelerometer, in the IMU frame [m/s2].
        load: (4,) weight on each foot, by the model [N].
        joint_torque: (nj,) mean of the joint torques as reported [Nm]; None where none are.
    """

    joint_position: FloatArray
    acceleration_in_imu: FloatArray
    load: FloatArray
    joint_torque: FloatArray | None = None

    @classmethod
    def of(cls, robot: RobotModel, still: Recording) -> RestReading:
        """Of a recording in which nothing moves."""
        joints, acceleration = still.joints, still.imu.acceleration_in_imu.mean(axis=0)
        torque = None if joints.torque is None else joints.torque.mean(axis=0)
        position = joints.position.mean(axis=0)
        return cls(position, acceleration, loads_on_feet(robot, position), torque)


@dataclass(frozen=True, eq=False)
class PlantedMove:
    """A move between two rests, all feet planted.

    Attributes:
        before, after: rests on either side of the move.
        rotation_to_before: (3, 3) rotation from the IMU frame after the move to that before, by the gyroscope.
        rolled: (4, 3) displacements of the feet's centres by rolling, in base axes before the move [m].
        duration: time between the rests [s].
        when: time since the middle of the run over the run's duration.
        heading: angle by which the robot was turned in the room since the run began, to its left [rad]; where it is not
            zero, its feet were planted anew.
    """

    before: RestReading
    after: RestReading
    rotation_to_before: FloatArray
    rolled: FloatArray
    duration: float = 0.0
    when: float = 0.0
    heading: float = 0.0


def read_move(
    robot: RobotModel, legs: LegChains, before: Recording, moving: Recording, after: Recording, gyro_bias: FloatArray
) -> PlantedMove:
    """A move and the rests on either side of it; the three recordings follow each other."""
    rotation = np.array(robot.imu_in_base.rotation)
    attitude = attitudes(moving.imu.time, moving.imu.angular_velocity_in_imu - gyro_bias)
    first, last = RestReading.of(robot, before), RestReading.of(robot, after)
    up = attitude.inv().apply(first.acceleration_in_imu / np.linalg.norm(first.acceleration_in_imu)) @ rotation.T
    joints = moving.joints
    up = at_times(joints.time, moving.imu.time, up)
    angular_velocity_in_base = at_times(
        joints.time, moving.imu.time, (moving.imu.angular_velocity_in_imu - gyro_bias) @ rotation.T
    )
    foot = legs.motion(joints.position, joints.rates, angular_velocity_in_base).foot_angular_velocity
    rolling = cross_of_rows(foot, legs.foot_radius[:, None] * up[:, None])
    to_before = rotation @ attitude.as_matrix() @ rotation.T
    to_before = to_before[np.clip(np.searchsorted(moving.imu.time, joints.time), 0, len(to_before) - 1)]
    rolled = np.trapezoid(np.einsum("nij,nlj->nli", to_before, rolling), joints.time, axis=0)
    return PlantedMove(first, last, attitude.as_matrix()[-1], rolled, float(moving.imu.time[-1] - moving.imu.time[0]))


class PlantedRows:
    """Residuals of planted moves and rests, at any values of the unknowns that they depend on.

    Attributes:
        DEPENDS_ON: names of the unknowns that the rows depend on.
        footholds: (4, 3) places of the feet relative to their mean at the nominal stance, in base axes [m].
    """

    DEPENDS_ON = (
        *DRIVE_TRAIN, "imu_tilt", *ACCELEROMETER, *GYRO, *LEG_SHAPE, "foot_radius", "foot_radius_each", "sag", "floor_slope",
        "floor_warp", "foothold_change",
    )  # fmt: skip

    def __init__(
        self, legs: LegChains, rotation_imu_to_base: FloatArray, stance: Stance, moves: Sequence[PlantedMove]
    ) -> None:
        self.legs, self._rotation = legs, rotation_imu_to_base
        self.footholds = stance.feet_in_base - stance.feet_in_base.mean(axis=0)
        rests = [[move.before for move in moves], [move.after for move in moves]]
        self._joints = [_joints_at(legs, side) for side in rests]
        self._acceleration = [np.array([rest.acceleration_in_imu for rest in side]).T for side in rests]
        self._load = [np.array([rest.load for rest in side]).T for side in rests]
        self._to_before = np.array([move.rotation_to_before for move in moves]).transpose(1, 2, 0)
        # Moves go straight from posture to posture: a turn about one axis, near enough for errors of the gyroscope.
        rotations = [Rotation.from_matrix(move.rotation_to_before) for move in moves]
        self._turns = np.moveaxis(np.array([turns_of(rotation) for rotation in rotations]), 0, -1)
        self._when = np.array([move.when for move in moves])
        drifts = [
            mean_rotation(rotation) * move.duration * move.when for rotation, move in zip(rotations, moves, strict=True)
        ]
        self._drifts = np.moveaxis(np.array(drifts), 0, -1)
        self._rolled = np.array([move.rolled for move in moves]).T
        self._heading = np.array([move.heading for move in moves])

    def residuals(self, values: Values) -> FloatArray:
        """(moves, 5, 4) what should be zero at the right values, of every foot [m].

        Three components of its displacement relative to the feet's mean, in base axes before the move; the height of its
        centre above their mean, against gravity, less that of its foothold, before and after the move.
        """
        return np.moveaxis(self._rows(inputs_of(values, self.DEPENDS_ON, self._moves), 1).value, -1, 0)

    def linearise(self, values: Values, names: Sequence[str] = DEPENDS_ON) -> tuple[FloatArray, dict[str, FloatArray]]:
        """`residuals`, and their (moves, 5, 4, size) derivatives by the unknowns named."""
        # As many copies of the moves as there are rows in each: walking back once gives the derivatives of all.
        inputs = inputs_of(values, self.DEPENDS_ON, _PER_MOVE * self._moves, names)
        rows = self._rows(inputs, _PER_MOVE)
        seed = np.repeat(np.eye(_PER_MOVE), self._moves, axis=1).reshape(rows.value.shape)
        gradients = rows.gradients(seed, [inputs[name] for name in names])
        shape = (-1, *rows.value.shape[:2], self._moves)
        by = {
            name: np.moveaxis(gradient.reshape(shape), (0, -1), (-1, 0))
            for name, gradient in zip(names, gradients, strict=True)
        }
        return np.moveaxis(rows.value[..., : self._moves], -1, 0), by

    @property
    def _moves(self) -> int:
        return self._rolled.shape[-1]

    def _rows(self, values: TracedValues, copies: int) -> Traced:
        """(5, 4, n) rows of the moves, one copy of all of them after the other."""
        to_before, rolled = np.tile(self._to_before, copies), np.tile(self._rolled, copies)
        heading = np.tile(self._heading, copies)
        rotation = traced_mounting(self._rotation, values["imu_tilt"])
        slope = facing(values["floor_slope"], heading)
        floor = contract("li,i...->l...", -self.footholds[:, :2], slope) + _WARP * values["floor_warp"]
        floor = floor + contract("lm,m...->l...", _CENTRED, values["foothold_change"] * (heading != 0.0))
        feet: list[Traced] = []
        heights: list[Traced] = []
        for rest in (0, 1):
            joints = self._joints[rest].at(np.tile(np.arange(self._moves), copies))
            foot = self.legs.traced_posture(joints.link_position(values), LegShape.of(self.legs, values)).foot
            felt = specific_force(values, np.tile(self._acceleration[rest], copies), np.tile(self._when, copies))
            gravity = turned(rotation, felt)
            up = gravity / length(gravity)
            feet.append(foot + up[:, None] * (values["sag"] * np.tile(self._load[rest], copies)))  # as if none sagged
            above = contract("il...,i...->l...", feet[rest], up)
            heights.append(contract("lm,m...->l...", _CENTRED, above) - floor)
        turn = contract("ij...,kj...->ik...", contract("ij...,jk...->ik...", rotation, to_before), rotation)
        drifted = turned(np.tile(self._drifts, copies), values["gyro_drift"])
        off = turned(rotation, turned_by(gyro_error(values), np.tile(self._turns, copies)) + drifted)
        after = contract("ij...,jl...->il...", turn, feet[1])
        moved = (
            after
            - cross(off[:, None], after)
            - feet[0]
            - (1.0 + values["foot_radius"] + values["foot_radius_each"]) * rolled
        )
        moved = contract("lm,im...->il...", _CENTRED, moved)
        return stacked([*(moved[axis] for axis in range(3)), *heights], axis=0)


def _joints_at(legs: LegChains, rests: Sequence[RestReading]) -> JointReadings:
    position = np.array([rest.joint_position for rest in rests])
    none = np.zeros(position.shape[1])
    return JointReadings.of(
        legs, position, torque=np.array([none if rest.joint_torque is None else rest.joint_torque for rest in rests])
    )
