"""What joint torques say: the balance of a robot on four feet or three, with the feet's forces eliminated.

With q the base's and the joints' coordinates, Y the inverse-dynamics regressor and J the Jacobian of the contact points,

    Y(q, v, a) pi = S^T tau_link + J^T f,    tau_link = g tau - F_c tanh(v / v_0) - F_v v - A a.

Rows of N with N J^T = 0 leave the forces out, whatever they are: six rows for legs of three joints, two for legs of two. A leg
whose foot is off the floor has no force to leave out: its joints' torques take the place, which swing it and carry nothing.
The base's acceleration is the accelerometer's, with gravity in it, so that no attitude is needed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from equipoise.conventions import FloatArray
from equipoise.estimator.measurements.drive_train import DRIVE_TRAIN, JointReadings
from equipoise.estimator.measurements.imu_frame import ACCELEROMETER, mounting, specific_force
from equipoise.estimator.measurements.leg_motion import LegChains
from equipoise.estimator.measurements.smoothing import fit_spline
from equipoise.estimator.unknowns import Values, inputs_of
from equipoise.recording.recording import Recording
from equipoise.robot.floor import floor_normals_by_fit
from equipoise.robot.inertial import moment_parameters
from equipoise.robot.model import LEG_NAMES, RobotModel

_KNOT, _STEP = 0.03, 0.09  # [s] on an A1; what errs lasts longer than either
_STICTION_SPEED = 0.03  # v_0 [rad/s]
_PAD = 0.05  # [s]
_FEWEST = 4  # samples


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
