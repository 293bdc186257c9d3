"""Torque balance of a robot on four feet or three, with the contact forces eliminated.

With q the base's and the joints' coordinates, Y the inverse-dynamics regressor and J the Jacobian of the contact points,

    Y(q, v, a) pi = S^T tau_link + J^T f,    tau_link = g tau - F_c tanh(v / v_0) - F_v v - A a.

Rows of N with N J^T = 0 eliminate any contact forces: six rows for legs of three joints, four for legs of two. Some
combinations of forces along the joint axes of such legs hardly act on the robot: they are not eliminated, but add noise. A
leg in the air has no contact force; its joint torques, which only swing it, are eliminated instead.
The base's acceleration is the accelerometer's, including gravity, so that no attitude is needed.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from equipoise.conventions import GRAVITY, FloatArray
from equipoise.errors import RecordingError
from equipoise.estimator.equations.equation import Equation, RunContext, whitening_of
from equipoise.estimator.measurements.drive_train import DRIVE_TRAIN, JointReadings
from equipoise.estimator.measurements.imu_frame import ACCELEROMETER, mounting, specific_force
from equipoise.estimator.measurements.leg_motion import LegChains
from equipoise.estimator.measurements.smoothing import fit_spline
from equipoise.estimator.parameters import INERTIAL, Unknowns
from equipoise.estimator.unknowns import USE_SCALE, Values, inputs_of
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.recording.trials import CrawlTrial, ExcitationTrial, MotorTrial, PostureTrial
from equipoise.robot.floor import floor_normals_by_fit
from equipoise.robot.inertial import moment_parameters
from equipoise.robot.model import LEG_NAMES, RobotModel

_KNOT, _STEP = 0.03, 0.09  # [s] on an A1; errors are correlated over longer times
STICTION_SPEED = 0.03
"""Speed v_0 within which friction changes its sign [rad/s]."""
_PAD = 0.05  # [s]
_FEWEST = 4  # samples
# Error of the friction model at rest and in motion, divided by the Coulomb friction.
_FRICTION_MODEL_ERROR = 1.0
_INITIAL_FRICTION = 0.5  # [Nm] on an A1
_TORQUE_FLOOR = 0.01  # [Nm] on an A1
_SAMPLES_AT_ONCE = 1024
_WEAK_FORCE = 1e-3  # of the strongest action of a contact force on the robot
_TORQUE_CORRELATION = 10.0  # samples of a motion with the same error: friction errors last for a second


@dataclass(frozen=True, eq=False)
class TorqueSamples:
    """Smoothed samples of one motion of a standing robot with torques, or the means of one rest.

    Attributes:
        joint_position, joint_velocity, joint_acceleration: (n, nj) joint positions and their derivatives [rad], [rad/s],
            [rad/s2].
        joint_torque: (n, nj) reported joint torques [Nm].
        angular_velocity_in_imu, angular_acceleration_in_imu: (n, 3) angular velocity and acceleration of the IMU
            [rad/s], [rad/s2].
        acceleration_in_imu: (n, 3) accelerometer readings, in the IMU frame [m/s2].
        period: (n,) sampling period before smoothing [s].
        standing: (n, 4) True for feet on the floor, FL FR RL RR.
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
        """Return the means over a rest; None without torques."""
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
        """Return smoothed samples of a stance motion; None without torques or if it is too short.

        All signals pass the same filter: differences between filters would appear as inertia or friction.

        Args:
            gyro_bias: (3,) bias of the gyroscope, in the IMU frame [rad/s].
            time_scale: time scale of the robot, relative to an A1.
            lifted: name of the leg in the air, or None.
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

    @property
    def friction_direction(self) -> FloatArray:
        """(n, nj) smoothed sign of each joint's velocity, tanh(v / v_0)."""
        return np.tanh(self.joint_velocity / STICTION_SPEED)

    def part(self, samples: slice) -> TorqueSamples:
        """Return a part of the samples."""
        return TorqueSamples(*(getattr(self, name)[samples] for name in self.__dataclass_fields__))

    @classmethod
    def joined(cls, parts: Sequence[TorqueSamples]) -> TorqueSamples:
        """Concatenate samples."""
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in cls.__dataclass_fields__))


@dataclass(frozen=True, eq=False)
class TorqueRows:
    """Rows of the balance, linear in the parameters: base pi + links s - torque tau_link = 0.

    Attributes:
        base: (n, r, 10) columns of the base's parameters, in Pinocchio's order about the base's origin.
        links: (n, r, 4 links) columns of a factor on each leg link, then of the offset of its first moment from the model's.
        torque: (n, r, nj) columns of each joint's link torque tau_link.
        acceleration_rows: (n, r, 6) coefficients of the base's acceleration noise, times the robot's inertia.
        force: (n, r) coefficients of the contact forces that were not eliminated.
    """

    base: FloatArray
    links: FloatArray
    torque: FloatArray
    acceleration_rows: FloatArray
    force: FloatArray


def torque_rows(legs: LegChains, samples: TorqueSamples, values: Values) -> TorqueRows:
    """Return the balance's rows of all samples, at given values of the other equations' parameters."""
    robot = legs.robot
    rotation = mounting(np.array(robot.imu_in_base.rotation), values["imu_tilt"])
    arm = robot.imu_in_base.translation + values["imu_position"]
    angular_velocity_in_base = samples.angular_velocity_in_imu @ rotation.T
    angular_acceleration_in_base = samples.angular_acceleration_in_imu @ rotation.T
    accelerometer = inputs_of(values, ACCELEROMETER, len(samples.acceleration_in_imu))
    at_imu = specific_force(accelerometer, samples.acceleration_in_imu.T).value.T @ rotation.T
    at_base = (
        at_imu
        - np.cross(angular_acceleration_in_base, arm)
        - np.cross(angular_velocity_in_base, np.cross(angular_velocity_in_base, arm))
    )
    readings = JointReadings.of(legs, samples.joint_position, torque=samples.joint_torque)
    position = readings.link_position(inputs_of(values, DRIVE_TRAIN, len(at_imu))).value.T
    velocity = np.hstack([np.zeros_like(at_imu), angular_velocity_in_base, samples.joint_velocity])
    acceleration = np.hstack([at_base, angular_acceleration_in_base, samples.joint_acceleration])
    regressor, twists = regressors_and_twists(robot, position, velocity, acceleration)
    contact = _contact_jacobians(robot, legs.feet(position), twists, values["foot_radius"], samples.standing)
    free, force = _without_forces(contact)
    rows = free @ regressor
    return TorqueRows(rows[:, :, :10], columns_of_links(robot, rows), free[:, :, 6:], free[:, :, :6], force)


def _without_forces(contact: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return (n, r, 6 + nj) orthonormal rows on which no or hardly any contact force acts, and the (n, r) `TorqueRows.force`.

    All samples of one call have as many rows, although the weak action of a force depends on the posture: exactly none in
    one posture, a ten-thousandth in another. Rounding would otherwise choose the rows.
    """
    directions, sizes, _ = np.linalg.svd(np.swapaxes(contact, 1, 2))
    strong = int((sizes > _WEAK_FORCE * sizes[:, :1]).sum(axis=1).min())
    force = np.zeros((len(contact), directions.shape[2] - strong))
    force[:, : sizes.shape[1] - strong] = sizes[:, strong:]
    return np.swapaxes(directions[:, :, strong:], 1, 2), force


def columns_of_links(robot: RobotModel, rows: FloatArray) -> FloatArray:
    """Return (n, r, 4 links) `TorqueRows.links` from (n, r, 10 bodies) rows of the regressor."""
    joints = [joint for leg in robot.legs.values() for joint in leg.joint_ids]
    bodies = [(slice(10 * (joint - 1), 10 * joint), robot.pinocchio.inertias[joint]) for joint in joints]
    flat = rows.reshape(-1, rows.shape[2])  # all samples at once: five times as fast as one by one
    links = [flat[:, own] @ body.toDynamicParameters()[:, None] for own, body in bodies]
    moments = [flat[:, own] @ moment_parameters(body.lever) for own, body in bodies]
    return np.hstack([*links, *moments]).reshape(*rows.shape[:2], -1)


def regressors_and_twists(
    robot: RobotModel, position: FloatArray, velocity: FloatArray, acceleration: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Compute Pinocchio's regressors without gravity, and the columns of joint Jacobians about the base's origin.

    Returns:
        (n, 6 + nj, 10 bodies) and (n, 6, 6 + nj), linear part first, in base axes.
    """
    model = robot.pinocchio.copy()
    model.gravity.linear = np.zeros(3)
    data = model.createData()
    count, size = velocity.shape
    # Column-major like Pinocchio's matrices: the copies are faster.
    regressors, twists = np.empty((count, 10 * (model.njoints - 1), size)), np.empty((count, size, 6))
    configuration = np.hstack([np.tile(robot.configuration(position[0])[:7], (count, 1)), position])
    for q, v, a, regressor, twist in zip(configuration, velocity, acceleration, regressors, twists, strict=True):
        regressor.T[:] = pin.computeJointTorqueRegressor(model, data, q, v, a)
        twist.T[:] = pin.computeJointJacobians(model, data, q)
    return np.swapaxes(regressors, 1, 2), np.swapaxes(twists, 1, 2)


def _contact_jacobians(
    robot: RobotModel, feet: FloatArray, twists: FloatArray, foot_radius: FloatArray, standing: NDArray[np.bool_]
) -> FloatArray:
    """Return (n, 12, 6 + nj) Jacobians of the contact points, FL FR RL RR; for a lifted leg, of its joints."""
    legs = list(robot.legs.values())
    radii = np.array([[leg.foot_radius] for leg in legs]) * (1 + foot_radius)
    # Spheres touch the floor along its normal, which differs from the specific force of an accelerating body.
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
    return contact.reshape(len(feet), 12, -1)


def _floor_normals(feet: FloatArray, standing: NDArray[np.bool_]) -> FloatArray:
    """Return (n, 3) upward floor normals in base axes, from (n, 4, 3) feet of which all or three stand."""
    normals = floor_normals_by_fit(feet)[0]
    for lifted in range(4):
        if (on_three := ~standing[:, lifted]).any():
            normals[on_three] = floor_normals_by_fit(np.delete(feet[on_three], lifted, axis=1))[0]
    return normals


def sawtooth(torque: FloatArray, samples: TorqueSamples, stiffness: float) -> FloatArray:
    """Return the (n,) error of the balance from the sampling instant within a control period [Nm].

    Position targets move in steps. Torques and accelerations are therefore sawteeth, with an amplitude of half a step times
    the stiffness. A sample is one point of them; joint accelerations, which come from positions, are their mean.

    Args:
        torque: (n, r, nj) `TorqueRows.torque`.
        stiffness: stiffness of the joints' position control [Nm/rad].
    """
    half_step = stiffness * samples.period[:, None] / 2 * samples.joint_velocity
    return np.linalg.norm(np.einsum("nrj,nj->nr", torque, half_step), axis=1)


class TorqueBalance(Equation[TorqueSamples]):
    """Whitened rows of the torque balance, linearised at the values of the last iteration.

    Attributes:
        normalized_residual: root mean square of all residuals, divided by their expected noise.
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
        """Return the samples of a rest, stance motion or excitation, or of each three-footed step of a crawl."""
        clock, trial = run.stance.scale.time, recording.trial
        if isinstance(trial, MotorTrial):  # the robot lies on its belly or stands on three feet
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

    def _rows_in(self, sample: TorqueSamples) -> int:
        return 0  # `prepare` compresses the rows and counts them

    def prepare(self, x: FloatArray) -> None:
        """Build the whitened linear system in the inertial and actuator parameters.

        The rows of a motion are compressed to as many as there are columns, with the same squares and products, so that the
        time and memory of an iteration do not grow with a motion's duration.
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
        """Return (n, r, columns + 1) rows of a part of the samples, with their targets in the last column."""
        unknowns, samples = self.unknowns, self._joined.part(part)
        rows = torque_rows(unknowns.legs, samples, unknowns.values(x))
        scale = unknowns.torque_scale
        # The initial friction is large: otherwise the fit would assign friction to the motors' gains.
        friction = float(np.abs(unknowns.value(x, "coulomb_friction")[0]))
        friction = max(friction, 0.02 * scale) if friction else _INITIAL_FRICTION * scale
        direction = np.abs(samples.friction_direction)
        variance = friction**2 * ((1 - direction) ** 2 + _FRICTION_MODEL_ERROR**2) + (_TORQUE_FLOOR * scale) ** 2
        noise = (rows.torque * variance[:, None]) @ np.swapaxes(rows.torque, 1, 2)
        stiffness, _ = unknowns.robot.gains(unknowns.stance.hip_height)
        weight = GRAVITY * unknowns.robot.mass  # an upper bound of what a contact force is
        diagonal = sawtooth(rows.torque, samples, stiffness)[:, None] ** 2 + (weight * rows.force) ** 2
        noise += diagonal[:, :, None] * np.eye(noise.shape[1])
        # Accelerometer noise acts through the mass: 0.01 m/s2 on the whole robot.
        acceleration = (0.01 * unknowns.robot.mass) ** 2 * np.array([1, 1, 1, 0.01, 0.01, 0.01])
        noise += (rows.acceleration_rows * acceleration) @ np.swapaxes(rows.acceleration_rows, 1, 2)
        level = self.normalized_residual * np.sqrt(self._correlation[part])
        whitening = whitening_of(noise) / level[:, None, None]
        terms = {
            "torque_gain_common": -_summed(rows.torque, samples.joint_torque),
            "torque_gain": -rows.torque * samples.joint_torque[:, None],
            "coulomb_friction": _summed(rows.torque, samples.friction_direction),
            "viscous_friction": _summed(rows.torque, samples.joint_velocity),
            "armature": _summed(rows.torque, samples.joint_acceleration),
        }
        target = np.einsum("nrj,nj->nr", rows.torque, samples.joint_torque) - rows.links @ unknowns.model_links
        links = rows.links @ unknowns.of_links
        acting = [terms[name] for name in self.actuators if unknowns.estimates(name)]
        return whitening @ np.concatenate([rows.base, links, *acting, target[..., None]], axis=2)

    def _linear(self, x: FloatArray) -> FloatArray:
        return np.concatenate([self.unknowns.inertial(x)[:10], (x * self.unknowns.scale)[self.columns[10:]]])

    def residual(self, x: FloatArray) -> FloatArray:
        # Divided by the mean gain: the balance is homogeneous, and a lighter robot with weaker motors would fit any noise.
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
    """Return slices of successive equal rows, from (n, k) rows."""
    edges = np.flatnonzero(np.diff(rows, axis=0).any(axis=1)) + 1
    return [slice(begin, end) for begin, end in itertools.pairwise([0, *edges.tolist(), len(rows)])]


def _few_rows(system: FloatArray) -> FloatArray:
    """Compress (n, c) rows to at most c rows with the same squares and products."""
    if len(system) <= system.shape[1]:
        return system
    size = np.maximum(np.linalg.norm(system, axis=0), 1e-100)  # columns of zeros remain zero
    # A QR decomposition takes four times as long.
    squares, directions = np.linalg.eigh(system.T @ system / np.outer(size, size))
    return np.asarray(np.sqrt(np.maximum(squares, 0.0))[:, None] * directions.T * size, dtype=float)


def _summed(torque: FloatArray, signal: FloatArray) -> FloatArray:
    """Sum (n, r, nj) rows times an (n, nj) signal over the joints, to an (n, r, 1) column."""
    return np.einsum("nrj,nj->nr", torque, signal)[..., None]
