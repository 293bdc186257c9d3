"""What the legs of a lying robot say of its motors.

The base rests, so each leg is a chain that hangs from a body whose specific force the accelerometer reads. With Y the
inverse-dynamics regressor of its links, whose parameters are pi, each joint obeys

    tau = kappa (Y(q, v, a) pi + F_c sgn(v) + F_v v + A a) + o + kp lag v_cmd,    kappa = 1 / g,

tau being the torque as reported, g the true torque over it, o its offset. Noise is in tau; what it is compared with comes from
encoders, which are a hundred times better.

Position targets move in steps, so torques are sawteeth. A sample is taken just after a step, and a motion feels the mean: the
sample is kp v_cmd T / 2 too large, `lag` being half a control period T. Where no torques are reported they follow from the
commands, tau = kp (q_cmd(t - d) - q) - kd v, and `lag` holds, besides, what the delay d is more than was thought.

All signals go through the same spline, sgn(v) as well: what is smoothed on one side of the equation is smoothed on the other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError
from equipoise.precise.measurements.smoothing import fit_spline
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.recording.trials import MotorTrial
from equipoise.robot.model import RobotModel

KNOT = 0.02  # [s] on an A1
THOUGHT_DELAY = 4e-3  # d, where nothing tells it [s]
_STICTION_SPEED = 0.03  # [rad/s]: sgn(v) = tanh(v / v_0)
_SPEED_WEIGHT = 0.01  # noise of an encoder over that of its speed [s]
_SLIDES, _RINGS = 0.8, 1.3  # smoothed |sgn(v)| between which a joint slid all the time, as far as the spline reaches
_FEWEST = 50  # samples


@dataclass(frozen=True, eq=False)
class MotorSamples:
    """All joints in motion, smoothed: n samples.

    Attributes:
        regressor: (n, nj, 10 bodies) inverse-dynamics regressor of the joints, the base's columns first.
        torque: (n, nj) joint torques, as reported or from the commands [Nm].
        sign: (n, nj) smoothed sign of the joint velocities.
        velocity: (n, nj) joint velocities [rad/s].
        acceleration: (n, nj) joint accelerations [rad/s2].
        command_rate: (n, nj) rates of the position targets that torques obey [rad/s]; zero where gains are not known.
        slides: (n, nj) whether a joint slid all the time about a sample: 1 or 0.
        period: control period [s].
        kp: position gain [Nm/rad]; 0: not known.
        reported: whether torques were.
    """

    regressor: FloatArray
    torque: FloatArray
    sign: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    command_rate: FloatArray
    slides: FloatArray
    period: float
    kp: float
    reported: bool


def motor_trial(recording: Recording) -> MotorTrial:
    """The trial that a recording is of; raises RecordingError if it is of another kind."""
    trial = recording.trial
    if not isinstance(trial, MotorTrial) or not recording.complete or recording.commands is None:
        raise RecordingError("the recording holds no complete swing of all joints")
    return trial


def motor_samples(robot: RobotModel, recording: Recording, time_scale: float) -> MotorSamples:
    """Smoothed samples of the steady part of a swing.

    Args:
        time_scale: factor on times, of the robot's scale; one on an A1.

    Raises:
        RecordingError: it is too short, or has neither torques nor gains.
    """
    trial, steady = motor_trial(recording), recording.phase(Phase.SWING)
    joints, imu, knot = steady.joints, steady.imu, KNOT * time_scale
    time = np.arange(joints.time[0] + 3 * knot, joints.time[-1] - 3 * knot, knot)
    if len(time) < _FEWEST:
        raise RecordingError(f"the joints swung for {steady.duration:.1f} s; {2 * _FEWEST * knot:.0f} s are needed")
    position = fit_spline(joints.time, joints.position, knot, joints.velocity, _SPEED_WEIGHT).spline
    speed, at = position.derivative(), joints.time
    velocity = speed(at) if joints.velocity is None else joints.velocity
    torque, rate = joints.torque, np.zeros_like(joints.position)
    if trial.kp is not None and trial.kd is not None:
        target, rate = command_at(recording, at - THOUGHT_DELAY)
        if torque is None:
            torque = trial.kp * (target - joints.position) - trial.kd * velocity
    if torque is None:
        raise RecordingError("the recording has no joint torques, and no gains from which they would follow")
    sign = np.tanh(speed(at) / _STICTION_SPEED)
    smooth = fit_spline(at, np.hstack([torque, sign, rate]), knot).spline(time)
    torque, sign, rate = np.split(smooth, 3, axis=1)
    force = fit_spline(imu.time, imu.acceleration_in_imu, knot).spline(np.clip(time, imu.time[0], imu.time[-1]))
    acceleration = speed.derivative()(time)
    force_in_base = force @ np.array(robot.imu_in_base.rotation).T
    slides = ((np.abs(sign) > _SLIDES) & (np.abs(sign) < _RINGS)).astype(float)
    return MotorSamples(
        _regressors(robot, position(time), speed(time), acceleration, force_in_base), torque, sign, speed(time), acceleration,
        rate, slides, control_period(recording), trial.kp or 0.0, joints.torque is not None,
    )  # fmt: skip


def command_at(recording: Recording, time: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(n, nj) position targets [rad] and their rates [rad/s] at (n,) times, linear between commands."""
    assert recording.commands is not None
    sent, targets = recording.commands.time, recording.commands.position
    rates = np.gradient(targets, sent, axis=0)
    columns = [np.column_stack([np.interp(time, sent, column) for column in part.T]) for part in (targets, rates)]
    return columns[0], columns[1]


def control_period(recording: Recording) -> float:
    """Time between commands [s]."""
    assert recording.commands is not None
    return float(np.median(np.diff(recording.commands.time)))


def _regressors(
    robot: RobotModel, position: FloatArray, velocity: FloatArray, acceleration: FloatArray, force_in_base: FloatArray
) -> FloatArray:
    """Pinocchio's regressors without gravity, which the (n, 3) specific force of the resting base has in it [m/s2]."""
    model = robot.pinocchio.copy()
    model.gravity.linear = np.zeros(3)
    data, rest = model.createData(), np.zeros(6)
    regressors = [
        pin.computeJointTorqueRegressor(
            model, data, robot.configuration(q), np.concatenate([rest, v]), np.concatenate([g, rest[:3], a])
        )[6:]
        for q, v, a, g in zip(position, velocity, acceleration, force_in_base, strict=True)
    ]
    return np.array(regressors)
