"""Predicted measurements of motions, accurate enough for their Fisher information.

The model has rigid legs, a body that tips about its line as an inverted pendulum and rotates about its CoM as commanded,
and the sensor noise of an A1. Only the derivatives of the residuals are used, never their values.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from equipoise.bayesian.lift_design import LiftDesign, lift_feet, lift_settings, offset_of
from equipoise.conventions import GRAVITY, FloatArray
from equipoise.estimator.equations.stance_motion import RestReading, StanceMotion
from equipoise.estimator.measurements.lift_samples import KNOT, REACH, LiftSamples, attitudes
from equipoise.estimator.measurements.smoothing import fit_spline
from equipoise.experiments.posture import check_posture, feet_in_posture, stance_line
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.kinematics import foot_jacobians, inverse_kinematics
from equipoise.robot.model import DIAGONALS, LEG_NAMES, RobotModel
from equipoise.robot.posture import BodyPosture
from equipoise.robot.stance import Stance
from equipoise.robot.statics import loads_on_feet

RATE = 500.0  # [Hz]
ENCODER_NOISE, VELOCITY_NOISE, GYRO_NOISE = 3e-4, 0.03, 3e-3  # [rad], [rad/s], [rad/s]
ACCELEROMETER_NOISE = 0.05  # [m/s2]
_IN_AIR_AFTER = 0.4  # fraction of the lift time after which the feet are off the floor
_STEP = 0.020  # [s] on an A1; half the sampling rate of the estimator gives the same information


class _OnTwoFeet(NamedTuple):
    """State on two feet before the robot tips or rotates.

    Attributes:
        feet: (4, 3) feet in the base frame [m].
        joint_position: (nj,) joint positions [rad].
        inverse_jacobians: (4, n, 3) derivatives of each leg's joints with respect to its foot [rad/m].
        left: (3,) direction of the line, in base axes.
        height: height of the CoM over the line [m].
        about_com, about_line: moments of inertia about that direction, through the CoM and through the line [kg m2].
    """

    feet: FloatArray
    joint_position: FloatArray
    inverse_jacobians: FloatArray
    left: FloatArray
    height: float
    about_com: float
    about_line: float


@dataclass(frozen=True, eq=False)
class Predictor:
    """Predictor of a robot's measurements.

    Attributes:
        robot: assumed robot model.
        stance: nominal stance.
        com: (3,) CoM in the base frame [m].
        heading: yaw of the robot in the world since the run began [rad].
    """

    robot: RobotModel
    stance: Stance
    com: FloatArray
    heading: float = 0.0
    _stood: dict[LiftDesign, _OnTwoFeet] = field(default_factory=dict[LiftDesign, _OnTwoFeet], init=False)
    _rested: dict[BodyPosture, RestReading] = field(default_factory=dict[BodyPosture, RestReading], init=False)

    @cached_property
    def _noise(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Sample times of a lift, and covariances of smoothed joint velocities, angular velocities and specific forces."""
        watch, clock = lift_settings(self.stance).watch_time, self.stance.scale.time
        sensed = np.arange(-0.06 * clock, watch + 0.06 * clock, 1 / RATE)
        time = np.arange(REACH, watch - REACH, _STEP * clock)
        blank = np.zeros((len(sensed), 1))
        joints = fit_spline(sensed, blank, KNOT, blank, ENCODER_NOISE / VELOCITY_NOISE, REACH)
        of_imu = fit_spline(sensed, blank, KNOT, reach=REACH).noise(time)
        joints_move = ENCODER_NOISE**2 * joints.noise(time, derivative=1)
        return time, joints_move, GYRO_NOISE**2 * of_imu, ACCELEROMETER_NOISE**2 * of_imu

    def lift(self, design: LiftDesign) -> LiftSamples:
        """Predict the samples of the time on two feet."""
        robot, stance = self.robot, self.stance
        settings = lift_settings(stance)
        time, velocity_noise, angular_velocity_noise, acceleration_noise = self._noise
        stands = self._stands(replace(design, turn=None, swing=None))
        lifted, position, inverse_jacobians, left, height, about_com, about_line = stands
        rate = np.sqrt(robot.mass * GRAVITY * height / about_line)
        distance = offset_of(stance, -design.side) / height + 0.004 * (design.side == 0)
        tilt = distance * (np.cosh(rate * (time + _IN_AIR_AFTER * settings.lift_time)) - 1)
        tilt_rate = np.gradient(tilt, time)
        whole = design.amounts(stance, 1 / RATE)
        amount = np.interp(time, np.arange(1, len(whole) + 1) / RATE, whole, right=0.0)
        amount_rate = np.gradient(amount, time)
        axis = np.zeros(3)
        if design.turn is not None:
            axis[("roll", "pitch", "yaw").index(design.turn)] = 1.0
        turned_by = axis - (axis @ left) * left * about_com / about_line
        angular_velocity_in_base = np.outer(tilt_rate, left) + np.outer(amount_rate, turned_by)
        # The base's origin rotates about the line with the robot, and about the CoM with the body.
        round_line = tilt_rate - amount_rate * (axis @ left) * about_com / about_line
        origin = np.outer(round_line, np.cross(left, height * design.posture.rotation[2] - self.com))
        origin -= np.outer(amount_rate, np.cross(axis, self.com))
        # Joint motions follow from small motions of the feet through each leg's Jacobian.
        step = 1e-3
        moved = (design.feet(lifted, self.com, step) - lifted) / step
        per_amount = np.zeros(len(position))
        per_amount[robot.leg_joints] = np.einsum("lji,li->lj", inverse_jacobians, moved)
        mounting = np.array(robot.imu_in_base.rotation)
        in_imu = angular_velocity_in_base @ mounting
        path = attitudes(time, in_imu)
        up = path.inv().apply(design.posture.rotation[2] @ mounting)
        return LiftSamples(
            design.diagonal,
            0.0,
            _STEP * stance.scale.time,
            position + np.outer(amount, per_amount),
            np.outer(amount_rate, per_amount),
            np.outer(np.gradient(amount_rate, time), per_amount),
            in_imu,
            np.gradient(in_imu, time, axis=0),
            GRAVITY * up + np.gradient(origin, time, axis=0) @ mounting,
            up,
            velocity_noise,
            angular_velocity_noise,
            acceleration_noise,
            heading=self.heading,
        )

    def _stands(self, design: LiftDesign) -> _OnTwoFeet:
        """Return the state on two feet, which does not depend on turn and swing."""
        if design not in self._stood:
            robot, stance = self.robot, self.stance
            _, feet = lift_feet(stance, self.com, design, lift_settings(stance).height)
            position = inverse_kinematics(robot, feet, stance.joint_position)
            left = design.posture.rotation.T @ stance_line(stance, design.diagonal)[0]
            standing = [leg in DIAGONALS[design.diagonal] for leg in LEG_NAMES]
            arm = self.com - feet[standing].mean(axis=0)
            height = float(np.linalg.norm(arm - (arm @ left) * left))
            about_com = float(left @ composite_parameters(robot, position).inertia @ left)
            about_line = about_com + robot.mass * height**2
            inverse = np.asarray(np.linalg.pinv(foot_jacobians(robot, position)), dtype=float)
            self._stood[design] = _OnTwoFeet(feet, position, inverse, left, height, about_com, about_line)
        return self._stood[design]

    def move(self, before: BodyPosture, after: BodyPosture) -> StanceMotion:
        """Predict a stance motion, without the rolling of the feet, which does not affect the information."""
        mounting = np.array(self.robot.imu_in_base.rotation)
        turned = mounting.T @ before.rotation.T @ after.rotation @ mounting
        return StanceMotion(self.rest(before), self.rest(after), turned, np.zeros((4, 3)), heading=self.heading)

    def rest(self, posture: BodyPosture) -> RestReading:
        """Predict the readings at rest on four feet; raises ReachError."""
        if posture not in self._rested:
            feet = feet_in_posture(self.stance, self.com, posture)
            position = check_posture(self.robot, self.stance, feet)
            specific_force = GRAVITY * posture.rotation[2] @ np.array(self.robot.imu_in_base.rotation)
            loads, torque = loads_on_feet(self.robot, position), np.zeros_like(position)
            self._rested[posture] = RestReading(position, specific_force, loads, torque)
        return self._rested[posture]
