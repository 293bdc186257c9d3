"""What joint torques say: the balance of a robot on four feet or three, with the feet's forces eliminated.

With q the base's and the joints' coordinates, Y the inverse-dynamics regressor and J the Jacobian of the contact points,

    Y(q, v, a) pi = S^T tau_link + J^T f,    tau_link = g tau - F_c tanh(v / v_0) - F_v v - A a.

Rows of N with N J^T = 0 leave the forces out, whatever they are: six rows for legs of three joints, two for legs of two. A leg
whose foot is off the floor has no force to leave out: its joints' torques take the place, which swing it and carry nothing.
The base's acceleration is the accelerometer's, with gravity in it, so that no attitude is needed.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError
from equipoise.estimator.equations.equation import Equation, RunContext, whitening_of
from equipoise.estimator.measurements.drive_train import DRIVE_TRAIN, JointReadings
from equipoise.estimator.measurements.imu_frame import ACCELEROMETER, mounting, specific_force
from equipoise.estimator.measurements.leg_motion import LegChains
from equipoise.estimator.measurements.smoothing import fit_spline
from equipoise.estimator.parameters import INERTIAL, Unknowns
from equipoise.estimator.unknown import USE_SCALE
from equipoise.estimator.unknowns import Values, inputs_of
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.recording.trials import CrawlTrial, ExcitationTrial, MotorTrial, PostureTrial
from equipoise.robot.floor import floor_normals_by_fit
from equipoise.robot.inertial import moment_parameters
from equipoise.robot.model import LEG_NAMES, RobotModel

_KNOT, _STEP = 0.03, 0.09  # [s] on an A1; what errs lasts longer than either
_STICTION_SPEED = 0.03  # v_0 [rad/s]
_PAD = 0.05  # [s]
_FEWEST = 4  # samples
# Torque of an A1's joint that the friction model leaves unexplained, over its Coulomb friction; at rest and in motion.
_FRICTION_UNKNOWN = 1.0
_FRICTION_AT_FIRST = 0.5  # [Nm] on an A1
_TORQUE_FLOOR = 0.01  # [Nm] on an A1
_SAMPLES_AT_ONCE = 1024
_TORQUE_CORRELATION = 10.0  # samples of a motion that say what one says: friction's errors last for a second


@dataclass(frozen=True, eq=False)
class TorqueSamples:
    """A standing robot with torques: smoothed samples of one motion, or the means of one rest.

    Attributes:
        joint_position, joint_velocity, joint_acceleration: (n, nj) joint positions and their derivatives [rad], [rad/s],
            [rad/s2].
        joint_torque: (n, nj) joint torques as reported [Nm].
        angular_velocity_in_imu, angular_acceleration_in_imu: (n, 3) angular velocity and acceleration of the IMU
            [rad/s], [rad/s2].
        acceleration_in_imu: (n, 3) accelerometer readings, in the IMU frame [m/s2].
        period: (n,) time between two of the samples that were smoothed [s].
        standing: (n, 4) whether each foot is on the floor, FL FR RL RR.
    """

    joint_position: FloatArray
    joint_velocity: FloatArray
    joint_acceleration: FloatArray
    joint_torque: FloatArray
    angular_velocity_in_imu: FloatArray
    angular_acceleration_in_imu: FloatArray
    acceleration_in_imu: FloatArray
    period: FloatArray
    standing: NDArray[np.bool_]

    @classmethod
    def of_rest(cls, still: Recording) -> TorqueSamples | None:
        """Means over a rest; None without torques."""
        if still.joints.torque is None:
            return None
        position = still.joints.position.mean(axis=0)[None]
        none, still_base = np.zeros_like(position), np.zeros((1, 3))
        return cls(
            position, none, none, still.joints.torque.mean(axis=0)[None],
            still_base, still_base, still.imu.acceleration_in_imu.mean(axis=0)[None], np.zeros(1),
            np.ones((1, 4), dtype=bool),
        )  # fmt: skip

    @classmethod
    def of_motion(
        cls, moving: Recording, gyro_bias: FloatArray, time_scale: float, lifted: str | None = None
    ) -> TorqueSamples | None:
        """Smoothed samples of a motion over planted feet; None without torques or if it is too short.

        All signals go through the same filter: what differs between them would look like inertia or friction.

        Args:
            gyro_bias: (3,) bias of the gyroscope, in the IMU frame [rad/s].
            time_scale: factor on times, of the robot's scale; one on an A1.
            lifted: name of the leg whose foot is off the floor; None: all stand.
        """
        joints, imu = moving.joints, moving.imu
        if joints.torque is None or min(len(joints.time), len(imu.time)) < _FEWEST:
            return None
        start = max(joints.time[0], imu.time[0]) + _PAD * time_scale
        end = min(joints.time[-1], imu.time[-1]) - _PAD * time_scale
        if end - start < 3 * _KNOT * time_scale:
            return None
        time = np.arange(start, end, _STEP * time_scale)
        knot = _KNOT * time_scale
        of_joints = fit_spline(joints.time, [joints.position, joints.torque], knot).spline
        turning = imu.angular_velocity_in_imu - gyro_bias
        of_imu = fit_spline(imu.time, [turning, imu.acceleration_in_imu], knot).spline
        (position, torque), (angular_velocity, acceleration) = (np.hsplit(of(time), 2) for of in (of_joints, of_imu))
        (velocity, _), (angular_acceleration, _) = (np.hsplit(of.derivative()(time), 2) for of in (of_joints, of_imu))
        return cls(
            position, velocity, np.hsplit(of_joints.derivative(2)(time), 2)[0], torque,
            angular_velocity, angular_acceleration, acceleration, np.full(len(time), np.median(np.diff(joints.time))),
            np.tile([leg != lifted for leg in LEG_NAMES], (len(time), 1)),
        )  # fmt: skip

    def part(self, samples: slice) -> TorqueSamples:
        """Some of the samples."""
        return TorqueSamples(*(getattr(self, name)[samples] for name in self.__dataclass_fields__))

    @classmethod
    def joined(cls, parts: Sequence[TorqueSamples]) -> TorqueSamples:
        """All samples of several."""
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in cls.__dataclass_fields__))


@dataclass(frozen=True, eq=False)
class TorqueRows:
    """Rows of the balance, linear in everything unknown: base pi + links s + torque - gain . g' + ... = 0.

    Attributes:
        base: (n, r, 10) columns of the base's parameters, in Pinocchio's order about the base's origin.
        links: (n, r, 4 links) columns of a factor on each leg link, then of each one's first moment beside the model's.
        torque: (n, r, nj) columns of each joint's link torque, to be subtracted.
        reported: (n, nj) joint torques as reported [Nm].
        friction_direction: (n, nj) smoothed sign of each joint's velocity, tanh(v / v_0).
        joint_velocity, joint_acceleration: (n, nj) derivatives of the joint positions [rad/s], [rad/s2].
        acceleration_rows: (n, r, 6) coefficients of the base's acceleration times the robot's inertia, for its noise.
    """

    base: FloatArray
    links: FloatArray
    torque: FloatArray
    reported: FloatArray
    friction_direction: FloatArray
    joint_velocity: FloatArray
    joint_acceleration: FloatArray
    acceleration_rows: FloatArray


def torque_rows(robot: RobotModel, samples: TorqueSamples, values: Values) -> TorqueRows:
    """The balance's rows of all samples, at given values of the unknowns that are not of it."""
    rotation = mounting(np.array(robot.imu_in_base.rotation), values["imu_tilt"])
    arm = robot.imu_in_base.translation + values["imu_position"]
    angular_velocity_in_base = samples.angular_velocity_in_imu @ rotation.T
    angular_acceleration_in_base = samples.angular_acceleration_in_imu @ rotation.T
    felt = specific_force(
        inputs_of(values, ACCELEROMETER, len(samples.acceleration_in_imu)), samples.acceleration_in_imu.T
    )
    sensed = felt.value.T @ rotation.T
    at_base = (
        sensed
        - np.cross(angular_acceleration_in_base, arm)
        - np.cross(angular_velocity_in_base, np.cross(angular_velocity_in_base, arm))
    )
    readings = JointReadings.of(LegChains(robot), samples.joint_position, torque=samples.joint_torque)
    position = readings.link_position(inputs_of(values, DRIVE_TRAIN, len(sensed))).value.T
    velocity = np.hstack([np.zeros_like(sensed), angular_velocity_in_base, samples.joint_velocity])
    acceleration = np.hstack([at_base, angular_acceleration_in_base, samples.joint_acceleration])
    regressor, twists = _regressors_and_twists(robot, position, velocity, acceleration)
    contact = _contact_jacobians(robot, position, twists, values["foot_radius"], samples.standing)
    full, _ = np.linalg.qr(np.swapaxes(contact, 1, 2), mode="complete")
    free = np.swapaxes(full[:, :, 12:], 1, 2)  # what contact forces cannot reach
    rows = free @ regressor
    return TorqueRows(
        rows[:, :, :10],
        columns_of_links(robot, rows),
        free[:, :, 6:],
        samples.joint_torque,
        np.tanh(samples.joint_velocity / _STICTION_SPEED),
        samples.joint_velocity,
        samples.joint_acceleration,
        free[:, :, :6],
    )


def columns_of_links(robot: RobotModel, rows: FloatArray) -> FloatArray:
    """(n, r, 4 links) `TorqueRows.links` of (n, r, 10 bodies) rows of the regressor."""
    joints = [joint for leg in robot.legs.values() for joint in leg.joint_ids]
    bodies = [(slice(10 * (joint - 1), 10 * joint), robot.pinocchio.inertias[joint]) for joint in joints]
    links = [rows[:, :, own] @ body.toDynamicParameters()[:, None] for own, body in bodies]
    flat = rows.reshape(-1, rows.shape[2])  # of all samples at once: one by one it takes five times as long
    beside = [flat[:, own] @ moment_parameters(body.lever) for own, body in bodies]
    return np.concatenate([*links, *(part.reshape(*rows.shape[:2], -1) for part in beside)], axis=-1)


def _regressors_and_twists(
    robot: RobotModel, position: FloatArray, velocity: FloatArray, acceleration: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Pinocchio's regressors without gravity, and the columns of joint Jacobians about the base's origin.

    Returns:
        (n, 6 + nj, 10 bodies) and (n, 6, 6 + nj), linear part first, in base axes.
    """
    model = robot.pinocchio.copy()
    model.gravity.linear = np.zeros(3)
    data = model.createData()
    count, size = velocity.shape
    # Columns first, as Pinocchio has them: what is copied as it lies is copied fast.
    regressors, twists = np.empty((count, 10 * (model.njoints - 1), size)), np.empty((count, size, 6))
    configuration = np.hstack([np.tile(robot.configuration(position[0])[:7], (count, 1)), position])
    for q, v, a, regressor, twist in zip(configuration, velocity, acceleration, regressors, twists, strict=True):
        regressor.T[:] = pin.computeJointTorqueRegressor(model, data, q, v, a)
        twist.T[:] = pin.computeJointJacobians(model, data, q)
    return np.swapaxes(regressors, 1, 2), np.swapaxes(twists, 1, 2)


def _contact_jacobians(
    robot: RobotModel, position: FloatArray, twists: FloatArray, foot_radius: FloatArray, standing: NDArray[np.bool_]
) -> FloatArray:
    """(n, 12, 6 + nj) of the points where the feet touch the floor, FL FR RL RR; of a lifted leg, of its joints."""
    legs, feet = list(robot.legs.values()), LegChains(robot).feet(position)
    radii = np.array([[leg.foot_radius] for leg in legs]) * (1 + foot_radius)
    # Spheres touch the floor along its normal, which is not what an accelerating body feels as down.
    point = feet - radii * _floor_normals(feet, standing)[:, None]
    moving = np.zeros((4, 1, twists.shape[2]))
    moving[:, :, :6] = 1.0
    for own, leg in zip(moving, legs, strict=True):
        own[:, [6 + joint for joint in leg.joints]] = 1.0
    at_point = twists[:, None, :3] + np.cross(twists[:, None, 3:], point[..., None], axis=2)
    contact = moving * at_point
    for number, leg in enumerate(legs):
        own = np.zeros(contact.shape[2:])
        own[range(len(leg.joints)), [6 + joint for joint in leg.joints]] = 1.0
        contact[~standing[:, number], number] = own
    return contact.reshape(len(position), 12, -1)


def _floor_normals(feet: FloatArray, standing: NDArray[np.bool_]) -> FloatArray:
    """(n, 3) upward unit normals in base axes of the planes of the (n, 4, 3) feet that stand, all or all but one."""
    normals = floor_normals_by_fit(feet)[0]
    for lifted in range(4):
        if (on_three := ~standing[:, lifted]).any():
            normals[on_three] = floor_normals_by_fit(np.delete(feet[on_three], lifted, axis=1))[0]
    return normals


def sawtooth(rows: TorqueRows, period: FloatArray, stiffness: float) -> FloatArray:
    """(n,) size of the balance's error from where in a control period its samples were taken [Nm].

    Position targets move in steps, so torques and accelerations are sawteeth, of half a step times the stiffness to either
    side. A sample is one moment of them; joint accelerations, which come from positions, are their mean.

    Args:
        period: (n,) control period [s].
        stiffness: stiffness of the joints' position control [Nm/rad].
    """
    half_step = stiffness * period[:, None] / 2 * rows.joint_velocity
    return np.linalg.norm(np.einsum("nrj,nj->nr", rows.torque, half_step), axis=1)


class TorqueBalance(Equation[TorqueSamples]):
    """Rows of the torque balance, at the last round's values of all that it is not linear in. Whitened.

    Attributes:
        normalized_residual: root mean square of all rows' residuals over what their noise explains.
    """

    actuators = ("torque_gain_common", "torque_gain", "coulomb_friction", "viscous_friction", "armature")
    gains = ("torque_gain_common", "torque_gain")
    depends_on = (*INERTIAL, *actuators)
    name = "torques"
    kind = TorqueSamples
    source = "noise of joint torques"
    remedy = USE_SCALE

    @classmethod
    def read(cls, run: RunContext, recording: Recording) -> Sequence[TorqueSamples]:
        """A rest; a move over planted feet or an excitation; each step of a crawl, on three feet."""
        clock, trial = run.stance.scale.time, recording.trial
        if isinstance(trial, MotorTrial):  # it rests on its belly, or on three feet
            return ()
        rest = TorqueSamples.of_rest(recording.phase(Phase.REST)) if recording.has_phase(Phase.REST) else None
        moving: list[TorqueSamples | None] = []
        if recording.complete and isinstance(trial, PostureTrial):
            moving.append(TorqueSamples.of_motion(recording.phase(Phase.MOVE, until=Phase.REST), run.gyro_bias, clock))
        elif recording.complete and isinstance(trial, ExcitationTrial):
            moving.append(TorqueSamples.of_motion(recording.phase(Phase.EXCITATION), run.gyro_bias, clock))
        elif recording.complete and isinstance(trial, CrawlTrial):
            for step in trial.steps:
                on_three = recording.between(step.start, step.end)
                moving.append(TorqueSamples.of_motion(on_three, run.gyro_bias, clock, step.lifted))
        found = [samples for samples in (rest, *moving) if samples is not None]
        if isinstance(trial, CrawlTrial) and recording.complete and not found:
            raise RecordingError("no joint torques, or no step long enough for them")
        return found

    def __init__(self, unknowns: Unknowns, samples: Sequence[tuple[int, TorqueSamples]]) -> None:
        super().__init__(unknowns, samples)
        self._joined = TorqueSamples.joined(self.samples)
        counts = [len(sample.joint_position) for sample in self.samples]
        self._correlation = np.repeat([1.0 if count == 1 else _TORQUE_CORRELATION for count in counts], counts)
        self._owner = np.repeat([index for index, _ in samples], counts)
        self.normalized_residual = 1.0
        self._matrix, self._target = np.zeros((0, 0)), np.zeros(0)
        self._row_correlation, self._rows = np.zeros(0), 0

    def _rows_in(self, sample: TorqueSamples) -> int:
        return 0  # before `prepare`, which finds how many say the same as all

    def prepare(self, x: FloatArray) -> None:
        """The rows as a linear system in the inertial parameters and what the actuators do, whitened.

        Many rows of one motion become as few as there are columns, by orthogonal turns, which change no square and no
        product of what is made of them: neither time nor memory of a round grows with how long a motion lasted.
        """
        systems: list[FloatArray] = []
        owners: list[FloatArray] = []
        self._rows = 0
        for first in range(0, len(self._owner), _SAMPLES_AT_ONCE):
            part = slice(first, first + _SAMPLES_AT_ONCE)
            whitened = self._whitened(x, part)
            self._rows += whitened.shape[0] * whitened.shape[1]
            of_part = np.column_stack([self._owner[part], self._correlation[part]])
            for alike in _alike(of_part):
                systems.append(_few_rows(whitened[alike].reshape(-1, whitened.shape[2])))
                owners.append(np.tile(of_part[alike.start], (len(systems[-1]), 1)))
        whole, owner = np.concatenate(systems), np.concatenate(owners)
        self._matrix, self._target = whole[:, :-1], whole[:, -1]
        self._row_correlation = owner[:, 1]
        self.motions = [(int(owner[rows.start, 0]), rows) for rows in _alike(owner[:, :1])]

    def _whitened(self, x: FloatArray, part: slice) -> FloatArray:
        """(n, r, columns + 1) rows of some of the samples and, in the last column, their targets."""
        unknowns, samples = self.unknowns, self._joined.part(part)
        rows = torque_rows(unknowns.robot, samples, unknowns.values(x))
        scale = unknowns.torque_scale
        # Before anything is known of friction it is taken to be large: else what it does is taken for the motors' gains.
        found = float(np.abs(unknowns.value(x, "coulomb_friction")[0]))
        coulomb_friction = max(found, 0.02 * scale) if found else _FRICTION_AT_FIRST * scale
        direction = np.abs(rows.friction_direction)
        unknown = coulomb_friction**2 * ((1 - direction) ** 2 + _FRICTION_UNKNOWN**2) + (_TORQUE_FLOOR * scale) ** 2
        noise: FloatArray = np.einsum("nrj,nj,nsj->nrs", rows.torque, unknown, rows.torque)
        stiffness, _ = unknowns.robot.gains(unknowns.stance.hip_height)
        noise += sawtooth(rows, samples.period, stiffness)[:, None, None] ** 2 * np.eye(noise.shape[1])
        # The accelerometer's noise acts through the mass: a hundredth of a metre per second squared on all of it.
        weight = (0.01 * unknowns.robot.mass) ** 2 * np.array([1, 1, 1, 0.01, 0.01, 0.01])
        noise += np.einsum("nrk,k,nsk->nrs", rows.acceleration_rows, weight, rows.acceleration_rows)
        level = self.normalized_residual * np.sqrt(self._correlation[part])
        whitening = whitening_of(noise) / level[:, None, None]
        terms = {
            "torque_gain_common": -_summed(rows.torque, rows.reported),
            "torque_gain": -rows.torque * rows.reported[:, None],
            "coulomb_friction": _summed(rows.torque, rows.friction_direction),
            "viscous_friction": _summed(rows.torque, rows.joint_velocity),
            "armature": _summed(rows.torque, rows.joint_acceleration),
        }
        target = np.einsum("nrj,nj->nr", rows.torque, rows.reported) - rows.links @ unknowns.model_links
        links = rows.links @ unknowns.of_links
        acting = [terms[name] for name in self.actuators if unknowns.estimates(name)]
        return whitening @ np.concatenate([rows.base, links, *acting, target[..., None]], axis=2)

    def _linear(self, x: FloatArray) -> FloatArray:
        return np.concatenate([self.unknowns.inertial(x)[:10], (x * self.unknowns.scale)[self.columns[10:]]])

    def residual(self, x: FloatArray) -> FloatArray:
        # Over the mean gain: the balance is homogeneous, and lighter robots with weaker motors would fit any noise better.
        return (self._matrix @ self._linear(x) - self._target) / self._mean_gain(x)

    def _mean_gain(self, x: FloatArray) -> float:
        return 1 + float(sum(self.unknowns.value(x, name).mean() for name in self.gains))

    def linearise(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        unknowns, gain, residual = self.unknowns, self._mean_gain(x), self.residual(x)
        jacobian = self._matrix * unknowns.scale[self.columns]
        jacobian[:, :10] = self._matrix[:, :10] @ unknowns.inertial_jacobian(x)[:10, :10]
        for name in self.gains:
            own = np.isin(self.columns, unknowns.columns(name))
            jacobian[:, own] -= np.outer(residual, unknowns.scale[self.columns[own]] / max(1, own.sum()))
        return residual, jacobian / gain

    def renew_noise(self, x: FloatArray) -> None:
        residual = self.residual(x) * self.normalized_residual * np.sqrt(self._row_correlation)
        self.normalized_residual = max(1.0, float(np.sqrt(np.sum(residual**2) / self._rows)))


def _alike(rows: FloatArray) -> list[slice]:
    """Runs of (n, k) rows that are the same."""
    edges = np.flatnonzero(np.diff(rows, axis=0).any(axis=1)) + 1
    return [slice(begin, end) for begin, end in itertools.pairwise([0, *edges.tolist(), len(rows)])]


def _few_rows(system: FloatArray) -> FloatArray:
    """(m, c) rows with the squares and products of (n, c) rows, m no more than c."""
    return np.asarray(np.linalg.qr(system, mode="r"), dtype=float) if len(system) > system.shape[1] else system


def _summed(torque: FloatArray, signal: FloatArray) -> FloatArray:
    """(n, r, 1) columns of what all joints have in common, of (n, r, nj) rows and an (n, nj) signal of each joint."""
    return np.einsum("nrj,nj->nr", torque, signal)[..., None]
