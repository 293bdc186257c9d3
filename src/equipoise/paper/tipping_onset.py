"""Motion of the capture point at the start of a lift trial.

On four feet, floor friction keeps the legs away from their commanded positions. When two feet lose their load, legs and body
spring back by a fraction of a millimetre, at centimetres per second. On two feet the robot is a pendulum. It tips to the side
of its capture point x, not of its CoM (`experiments.tipping`), with a the lean of the CoM and w the pendulum's rate:

    x = a + a' / w,     x grows as e^(w t).

The feet are measured at rest. x moves from the rest until the feet leave the floor at t_0.
After t_0 it grows by x(t) - x(t_0) = (e^(w (t - t_0)) - 1) x(t_0), which determines its distance from the line at t_0.
Gyroscope and encoders measure both. Without this correction, support lines are wrong by half a
millimetre on an A1 and up to 7 mm on a HyQ.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.integrate import cumulative_trapezoid

from equipoise.conventions import FloatArray
from equipoise.experiments.tilt import RestMeans, still_means
from equipoise.experiments.tipping import Pendulum
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.recording.trials import CommandedLift
from equipoise.robot.kinematics import Kinematics
from equipoise.robot.model import DIAGONALS, LEG_NAMES, RobotModel

_OFF_THE_FLOOR = 0.12  # of the lift height: feet this high carry no load, and the robot has hardly tipped
_WINDOW = 0.035  # [s], half the interval of the difference that gives the rate of the lean


def tipping_onset(robot: RobotModel, recording: Recording, trial: CommandedLift) -> tuple[float, float]:
    """Compute the motion of the capture point at the start of a lift, across the support line; positive: forward.

    Args:
        robot: model of the robot.
        recording: recording with phases "rest", "unload" and "lower".
        trial: lift that was commanded.

    Returns:
        displacement of the capture point from the rest until the feet left the floor, and its distance from the line at that
        moment, from the rate of tipping [m].
    """
    rest = still_means(robot, recording.phase(Phase.REST))
    tipping = Pendulum.of(robot, rest.joint_position, rest.up_in_base, trial.diagonal)
    lifted = recording.phase(Phase.UNLOAD, until=Phase.LOWER)
    time, capture = _capture_point(robot, lifted, rest, tipping)
    off, end = _off_the_floor(robot, lifted, rest, trial), float(time[-1]) - _WINDOW
    moved, tipped = np.interp([off, end], time, capture).tolist()
    growth = math.expm1(tipping.rate * max(end - off, _WINDOW))
    return moved, (tipped - moved) / growth


def _capture_point(
    robot: RobotModel, lifted: Recording, rest: RestMeans, tipping: Pendulum
) -> tuple[FloatArray, FloatArray]:
    """Return (n,) times [s] and (n,) displacements of the capture point since the rest, forward across the line [m]."""
    imu, joints = lifted.imu, lifted.joints
    turning = (imu.angular_velocity_in_imu - rest.gyro_bias) @ (
        np.array(robot.imu_in_base.rotation).T @ tipping.axis_in_base
    )
    turned = cumulative_trapezoid(turning, imu.time, initial=0.0)
    time = joints.time
    lean = np.interp(time, imu.time, turned) + (joints.position - rest.joint_position) @ tipping.joints
    before, after = (np.interp(time + shift, time, lean) for shift in (-_WINDOW, _WINDOW))
    span = np.minimum(time + _WINDOW, time[-1]) - np.maximum(time - _WINDOW, time[0])
    rate = (after - before) / span
    rate += tipping.spin * (np.interp(time, imu.time, turning) - rate)
    return time, tipping.height * (lean + rate / tipping.rate)


def _off_the_floor(robot: RobotModel, lifted: Recording, rest: RestMeans, trial: CommandedLift) -> float:
    """Return the time at which the feet leave the floor according to the encoders, or the last time if they never do [s]."""
    kinematics = Kinematics(robot)
    standing = np.array([leg in DIAGONALS[trial.diagonal] for leg in LEG_NAMES])
    side = np.where(standing, -0.5, 0.5)
    low = side @ kinematics.foot_positions(rest.joint_position) @ rest.up_in_base
    for time, position in zip(lifted.joints.time, lifted.joints.position, strict=True):
        if side @ kinematics.foot_positions(position) @ rest.up_in_base - low >= _OFF_THE_FLOOR * trial.lift_height:
            return float(time)
    return float(lifted.joints.time[-1])
