"""How the robot began to tip: where it was on its way to when its feet left the floor.

On four feet the floor holds the legs away from where their motors want them, by friction. When two feet lose their load, legs
and body spring back: by a fraction of a millimetre, but by centimetres a second, in the direction in which the robot was
dragged last. On two feet it is a pendulum, and tips to the side on which its capture point is, not its CoM
(`experiments.tipping`):

    x = a + a' / w,     x grows as e^(w t).

Between the rest, at which the feet are measured, and the moment t_0 at which they leave the floor, x moves by the head start
h x(t_0). From then on it grows by x(t) - x(t_0) = (e^(w (t - t_0)) - 1) x_true(t_0), which tells how far from the line the
capture point truly was. Gyroscope and encoders tell both. Without the head start an A1's support lines are half a millimetre
off, and a HyQ's up to seven.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid

from equipoise.conventions import FloatArray
from equipoise.experiments.tilt import RestMeans, rest_of
from equipoise.experiments.tipping import Pendulum
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.recording.trials import CommandedLift
from equipoise.robot.kinematics import Kinematics
from equipoise.robot.model import DIAGONALS, LEG_NAMES, RobotModel

_OFF_THE_FLOOR = 0.12  # of the lift's height: feet that are so high bear nothing, and the robot has hardly tipped since
_WINDOW = 0.035  # [s] to either side, over which the lean is differentiated


@dataclass(frozen=True)
class HeadStart:
    """How a lift's tipping began, across the support line; positive: forward.

    Attributes:
        moved: distance by which the capture point moved from the rest until the feet left the floor [m].
        ahead: distance of the capture point from the line at that moment, by how fast the robot tipped then [m].
    """

    moved: float
    ahead: float


def head_start(robot: RobotModel, recording: Recording, trial: CommandedLift) -> HeadStart:
    """How the robot began to tip in a lift.

    Args:
        robot: model of the robot.
        recording: recording with phases "rest", "unload" and "lower".
        trial: lift that was commanded.
    """
    rest = rest_of(robot, recording)
    tipping = Pendulum.of(robot, rest.joint_position, rest.up_in_base, trial.diagonal)
    lifted = recording.phase(Phase.UNLOAD, until=Phase.LOWER)
    time, capture = _capture_point(robot, lifted, rest, tipping)
    off, end = _off_the_floor(robot, lifted, rest, trial), float(time[-1]) - _WINDOW
    moved, tipped = np.interp([off, end], time, capture).tolist()
    growth = math.expm1(tipping.rate * max(end - off, _WINDOW))
    return HeadStart(moved, (tipped - moved) / growth)


def _capture_point(
    robot: RobotModel, lifted: Recording, rest: RestMeans, tipping: Pendulum
) -> tuple[FloatArray, FloatArray]:
    """(n,) times [s], and (n,) how far the capture point has moved forward across the line since the rest [m]."""
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
    """When the feet have left the floor, by the encoders; the end, if they never do [s]."""
    kinematics = Kinematics(robot)
    standing = np.array([leg in DIAGONALS[trial.diagonal] for leg in LEG_NAMES])
    side = np.where(standing, -0.5, 0.5)
    low = side @ kinematics.foot_positions(rest.joint_position) @ rest.up_in_base
    for time, position in zip(lifted.joints.time, lifted.joints.position, strict=True):
        if side @ kinematics.foot_positions(position) @ rest.up_in_base - low >= _OFF_THE_FLOOR * trial.lift_height:
            return float(time)
    return float(lifted.joints.time[-1])
