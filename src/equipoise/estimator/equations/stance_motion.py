"""Stance motion equation: fixed feet determine joint offsets and the mounting of the IMU.

While no foot slips, relative foot positions change only by rolling. Relative foot heights along gravity change only by foot
compliance. Both are read at rest, before and after the motion. The load of each foot follows from statics with the model's
mass and CoM: motor friction is too large to obtain it from reported torques.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from equipoise.conventions import FloatArray
from equipoise.estimator.equations.equation import LEFT_OUT, MotionEquation, RunContext, whitening_of
from equipoise.estimator.measurements.drive_train import DRIVE_TRAIN, JointReadings
from equipoise.estimator.measurements.foot_contact import to_centre_by_width
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
from equipoise.estimator.parameters import Unknowns
from equipoise.estimator.unknowns import MORE_TIME, TracedValues, Values, inputs_of
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.recording.trials import PostureTrial
from equipoise.robot.model import RobotModel
from equipoise.robot.statics import loads_on_feet

_PER_MOVE = 20
_CENTRED = np.eye(4) - 0.25  # subtracts the mean over the feet
_WARP = np.array([[1.0], [-1.0], [-1.0], [1.0]])
# Standard deviations on an A1: displacement and height of feet at rest [m]; drift of the gyroscope's attitude over a motion
# and of the accelerometer's from rest to rest [rad]. Twice the values of an ideal robot: each rest ends one motion and begins
# the next, and errors of springs and foot compliance are the same in all.
_FOOT_NOISE, _HEIGHT_NOISE, _TURN_NOISE, _UP_NOISE = 2.4e-4, 1.6e-4, 6e-4, 8e-4
_MIN_NOISE_FACTOR = 0.3  # of these, for robots with ordinary sensors
_INDEPENDENT_ROWS = 15  # of a motion's twenty: means are subtracted
_FEWEST_DEGREES_OF_FREEDOM = 20.0  # they determine the noise to within about 20 %
# Safety factor on the noise from residuals: these may be small by chance, and errors of feet last over several motions.
_NOISE_MARGIN = 1.5


@dataclass(frozen=True, eq=False)
class RestReading:
    """Means over a rest on four feet.

    Attributes:
        joint_position: (nj,) joint positions [rad].
        acceleration_in_imu: (3,) accelerometer readings, in the IMU frame [m/s2].
        load: (4,) weight on each foot, according to the model [N].
        joint_torque: (nj,) reported joint torques; zero without any [Nm].
    """

    joint_position: FloatArray
    acceleration_in_imu: FloatArray
    load: FloatArray
    joint_torque: FloatArray

    @classmethod
    def of(cls, robot: RobotModel, still: Recording) -> RestReading:
        """Average a recording in which nothing moves."""
        joints, acceleration = still.joints, still.imu.acceleration_in_imu.mean(axis=0)
        position = joints.position.mean(axis=0)
        torque = np.zeros_like(position) if joints.torque is None else joints.torque.mean(axis=0)
        return cls(position, acceleration, loads_on_feet(robot, position), torque)


@dataclass(frozen=True, eq=False)
class StanceMotion:
    """Base motion between two rests, with all feet on the floor.

    Attributes:
        before, after: rests on either side of the motion.
        rotation_to_before: (3, 3) rotation from the IMU frame after the motion to that before, from the gyroscope.
        rolled: (4, 3) displacements of the feet's centres by rolling, in base axes before the motion [m].
        rolled_by_width: (2, 4, 3) displacements beyond those of spherical feet, divided by the feet's half-widths.
        duration: time between the rests [s].
        when: time since the middle of the run, divided by the run's duration.
        heading: rotation of the robot to its left since the start of the run [rad]; if it is not zero, the feet have new
            footholds.
    """

    before: RestReading
    after: RestReading
    rotation_to_before: FloatArray
    rolled: FloatArray
    rolled_by_width: FloatArray = field(default_factory=lambda: np.zeros((2, 4, 3)))
    duration: float = 0.0
    when: float = 0.0
    heading: float = 0.0


def read_move(run: RunContext, before: Recording, moving: Recording, after: Recording) -> StanceMotion:
    """Read a stance motion from three successive recordings: a rest, the motion and another rest."""
    legs, rotation = run.legs, np.array(run.robot.imu_in_base.rotation)
    gyro = moving.imu.angular_velocity_in_imu - run.gyro_bias
    attitude = attitudes(moving.imu.time, gyro)
    first, last = RestReading.of(run.robot, before), RestReading.of(run.robot, after)
    up = attitude.inv().apply(first.acceleration_in_imu / np.linalg.norm(first.acceleration_in_imu)) @ rotation.T
    joints = moving.joints
    up = at_times(joints.time, moving.imu.time, up)
    angular_velocity_in_base = at_times(joints.time, moving.imu.time, gyro @ rotation.T)
    foot = legs.motion(joints.position, joints.rates, angular_velocity_in_base).foot_angular_velocity[:, None]
    ball = legs.foot_radius[:, None] * up[:, None, None]
    to_centre = np.concatenate(
        [np.broadcast_to(ball, foot.shape), to_centre_by_width(legs, joints.position, up)], axis=1
    )
    rolling = cross_of_rows(foot, to_centre)
    to_before = rotation @ attitude.as_matrix() @ rotation.T
    to_before = to_before[np.clip(np.searchsorted(moving.imu.time, joints.time), 0, len(to_before) - 1)]
    rolled = np.trapezoid(np.einsum("nij,nklj->nkli", to_before, rolling), joints.time, axis=0)
    duration = float(moving.imu.time[-1] - moving.imu.time[0])
    return StanceMotion(first, last, attitude.as_matrix()[-1], rolled[0], rolled[1:], duration, run.when, run.heading)


def _joints_at(legs: LegChains, rests: Sequence[RestReading]) -> JointReadings:
    position = np.array([rest.joint_position for rest in rests])
    torque = np.array([rest.joint_torque for rest in rests])
    return JointReadings.of(legs, position, torque=torque)


def _higher_by_width(legs: LegChains, rotation_imu_to_base: FloatArray, rests: Sequence[RestReading]) -> FloatArray:
    """Return (2, 4, rests) heights of the feet's centres beyond those of spherical feet, divided by half-widths."""
    up = np.array([rest.acceleration_in_imu for rest in rests]) @ rotation_imu_to_base.T
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    position = np.array([rest.joint_position for rest in rests])
    return np.einsum("nklj,nj->kln", to_centre_by_width(legs, position, up), up)


def _whitening(footholds: FloatArray, size: float) -> FloatArray:
    """Return the (20, 20) matrix that whitens the rows of a motion over (4, 3) footholds relative to their mean [m].

    Args:
        size: scale of lengths, relative to an A1.
    """
    turns = np.asarray([np.cross(axis, footholds).T.ravel() for axis in np.eye(3)], dtype=float)
    moved = (size * _FOOT_NOISE) ** 2 * np.eye(12) + _TURN_NOISE**2 * turns.T @ turns
    leaning = footholds[:, :2] @ footholds[:, :2].T
    heights = whitening_of((size * _HEIGHT_NOISE) ** 2 * np.eye(4) + _UP_NOISE**2 * leaning)
    return np.asarray(block_diag(whitening_of(moved), heights, heights), dtype=float)


class StanceMotions(MotionEquation[StanceMotion]):
    """Whitened rows of stance motions: feet do not slip, footholds keep their heights."""

    depends_on = (
        *DRIVE_TRAIN, "imu_tilt", *ACCELEROMETER, *GYRO, *LEG_SHAPE, "foot_radius", "foot_radius_each", "foot_width",
        "foot_compliance", "floor_slope", "floor_warp", "foothold_change",
    )  # fmt: skip
    name = "moves"
    kind = StanceMotion
    source = "noise of stance motions"
    remedy = f"{MORE_TIME}; a hard floor"
    _noise_factor = 1.0  # determined by the residuals

    @classmethod
    def read(cls, run: RunContext, recording: Recording) -> Sequence[StanceMotion]:
        """Return the stance motion to a posture."""
        if not isinstance(recording.trial, PostureTrial) or not recording.complete:
            return ()
        parts = (
            recording.phase(Phase.BEFORE),
            recording.phase(Phase.MOVE, until=Phase.REST),
            recording.phase(Phase.REST),
        )
        return (read_move(run, *parts),)

    def __init__(self, unknowns: Unknowns, samples: Sequence[tuple[int, StanceMotion]]) -> None:
        super().__init__(unknowns, samples)
        legs, moves, stance = unknowns.legs, self.samples, unknowns.stance
        self._rotation = np.array(unknowns.robot.imu_in_base.rotation)
        self._footholds = stance.feet_in_base - stance.feet_in_base.mean(axis=0)
        self._whitening = _whitening(self._footholds, stance.scale.length)
        rests = [[move.before for move in moves], [move.after for move in moves]]
        self._joints = [_joints_at(legs, side) for side in rests]
        self._acceleration = [np.array([rest.acceleration_in_imu for rest in side]).T for side in rests]
        self._load = [np.array([rest.load for rest in side]).T for side in rests]
        self._to_before = np.array([move.rotation_to_before for move in moves]).transpose(1, 2, 0)
        # Rotation about one axis is a sufficient approximation for the gyroscope's errors.
        rotations = [Rotation.from_matrix(move.rotation_to_before) for move in moves]
        self._turns = np.moveaxis(np.array([turns_of(rotation) for rotation in rotations]), 0, -1)
        self._when = np.array([move.when for move in moves])
        drifts = [
            mean_rotation(rotation) * move.duration * move.when for rotation, move in zip(rotations, moves, strict=True)
        ]
        self._drifts = np.moveaxis(np.array(drifts), 0, -1)
        self._rolled = np.array([move.rolled for move in moves]).T
        self._rolled_by_width = np.array([move.rolled_by_width for move in moves]).T
        self._higher_by_width = [_higher_by_width(legs, self._rotation, side) for side in rests]
        self._heading = np.array([move.heading for move in moves])

    def _rows_in(self, sample: StanceMotion) -> int:
        return _PER_MOVE

    def residual(self, x: FloatArray) -> FloatArray:
        return self._whitened(self.residuals(self.unknowns.values(x)).reshape(-1, _PER_MOVE, 1)).ravel()

    def linearise(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        rows, by = self.derivatives(self.unknowns.values(x), self.open)
        columns = self._by_unknowns(x, by).reshape(-1, _PER_MOVE, len(self.columns))
        jacobian = self._whitened(columns).reshape(-1, len(self.columns))
        return self._whitened(rows.reshape(-1, _PER_MOVE, 1)).ravel(), jacobian

    def residuals(self, values: Values) -> FloatArray:
        """Return (moves, 5, 4) residuals of every foot [m].

        The first three are its displacement minus that by rolling, relative to the feet's mean, in base axes before the
        motion. The others are the height of its centre above the feet's mean minus that of its foothold, before and after
        the motion.
        """
        return np.moveaxis(self._rows(inputs_of(values, self.depends_on, len(self.samples)), 1).value, -1, 0)

    def derivatives(
        self, values: Values, names: Sequence[str] = depends_on
    ) -> tuple[FloatArray, dict[str, FloatArray]]:
        """Return `residuals` and their (moves, 5, 4, size) derivatives by the named parameters."""
        # One copy of the motions for each row: a single backward pass then gives the derivatives of all rows.
        moves = len(self.samples)
        inputs = inputs_of(values, self.depends_on, _PER_MOVE * moves, names)
        rows = self._rows(inputs, _PER_MOVE)
        seed = np.repeat(np.eye(_PER_MOVE), moves, axis=1).reshape(rows.value.shape)
        gradients = rows.gradients(seed, [inputs[name] for name in names])
        shape = (-1, *rows.value.shape[:2], moves)
        by = {
            name: np.moveaxis(gradient.reshape(shape), (0, -1), (-1, 0))
            for name, gradient in zip(names, gradients, strict=True)
        }
        return np.moveaxis(rows.value[..., :moves], -1, 0), by

    def _rows(self, values: TracedValues, copies: int) -> Traced:
        """Return (5, 4, n) rows of the motions, copy after copy."""
        to_before, rolled = np.tile(self._to_before, copies), np.tile(self._rolled, copies)
        heading, legs = np.tile(self._heading, copies), self.unknowns.legs
        rotation = traced_mounting(self._rotation, values["imu_tilt"])
        slope = facing(values["floor_slope"], heading)
        floor = contract("li,i...->l...", -self._footholds[:, :2], slope) + _WARP * values["floor_warp"]
        floor = floor + contract("lm,m...->l...", _CENTRED, values["foothold_change"] * (heading != 0.0))
        feet: list[Traced] = []
        heights: list[Traced] = []
        for rest in (0, 1):
            joints = self._joints[rest].at(np.tile(np.arange(len(self.samples)), copies))
            foot = legs.traced_posture(joints.link_position(values), LegShape.of(legs, values)).foot
            measured = specific_force(values, np.tile(self._acceleration[rest], copies), np.tile(self._when, copies))
            gravity = turned(rotation, measured)
            up = gravity / length(gravity)
            compression = values["foot_compliance"] * np.tile(self._load[rest], copies)
            feet.append(foot + up[:, None] * compression)  # positions without load
            above = contract("il...,i...->l...", feet[rest], up)
            wide = values["foot_width"][:, None] * np.tile(self._higher_by_width[rest], copies)
            above = above - wide[0] - wide[1]
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
            - contract("k...,ilk...->il...", values["foot_width"], np.tile(self._rolled_by_width, copies))
        )
        moved = contract("lm,im...->il...", _CENTRED, moved)
        return stacked([*(moved[axis] for axis in range(3)), *heights], axis=0)

    def at_residual_noise(self, x: FloatArray, covariance: FloatArray | None = None) -> StanceMotions:
        if covariance is None:
            return self._with_noise_factor(float(np.median(self.normalized_residual(x))))
        residual, jacobian = self.linearise(x)
        taken = float(np.einsum("ij,jk,ik->", jacobian, covariance[np.ix_(self.columns, self.columns)], jacobian))
        freedoms = _INDEPENDENT_ROWS * float(np.sum(self.scale < LEFT_OUT)) - taken
        if freedoms < _FEWEST_DEGREES_OF_FREEDOM:
            return self
        return self._with_noise_factor(
            self._noise_factor * _NOISE_MARGIN * float(np.sqrt(residual @ residual / freedoms))
        )

    def _with_noise_factor(self, factor: float) -> StanceMotions:
        """Return these rows with another noise factor; excluded motions stay excluded."""
        rows = copy(self)
        rows._noise_factor = max(_MIN_NOISE_FACTOR, min(1.0, factor))
        rows.scale = np.where(self.scale < LEFT_OUT, self.scale / self._noise_factor * rows._noise_factor, LEFT_OUT)
        return rows

    def _whitened(self, rows: FloatArray) -> FloatArray:
        """Whiten (moves, 20, k) rows."""
        return np.asarray(self._whitening @ rows / self.scale[:, None, None], dtype=float)

    def normalized_residual(self, x: FloatArray) -> FloatArray:
        residual = self.residual(x).reshape(-1, _PER_MOVE)
        return self.scale * np.sqrt((residual**2).sum(axis=1) / _INDEPENDENT_ROWS)
