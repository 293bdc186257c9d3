"""What the legs of a lying robot say of its motors.

The base rests, so each leg is a chain that hangs from a body whose specific force the accelerometer reads. With Y the
inverse-dynamics regressor of its links, whose parameters are pi, each joint obeys

    tau = kappa (Y(q, v, a) pi + F_c sgn(v) + F_v v + A a + B s) + o + kp lag v_cmd,    kappa = 1 / g,

tau being the torque as reported, g the true torque over it, o its offset. A rotor that turns N times as fast as its joint in
a link that turns itself adds B q' w to the energy, w being that link's velocity about the joint's axis: B s is the torque of
that, the inertia B moved from the carrying link and the armature to the link that is driven.

Where the motor's own law is known, tau = kp (q_cmd(t - d) - q) - kd v, and reported torques are seen to obey it (`delay.py`),
the law's torque is taken: it is the same, without the noise of a current sensor.

Position targets move in steps, so torques are sawteeth. A sample is taken just after a step, and a motion feels the mean: the
sample is kp v_cmd T / 2 too large, `lag` being half a control period T. Where no torques are reported they follow from the
same law, and `lag` holds, besides, what the delay d is more than was thought.

All terms are made at every sample and go through one filter (`averages`) after that: torques, regressors, sgn(v). When a joint
turns back its friction jumps, and its acceleration with it; were the acceleration smoothed on its way and the friction
otherwise, what is left of the two jumps would be taken for inertia, viscosity and gains.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.sparse import csr_array

from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError
from equipoise.motors.delay import THOUGHT_DELAY, command_at, law_torque, motor_trial, position_loop_delays
from equipoise.precise.measurements.smoothing import fit_spline
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.robot.model import RobotModel
from equipoise.robot.tree import joint_axis

SPACING = 0.02  # between the averages of all terms [s] on an A1
_KNOT = 0.01  # of the positions' spline [s] on an A1: accelerations are averaged after it
_PER_KNOT = 4  # samples at least, of positions or of velocities
_STICTION_SPEED = 0.01  # [rad/s]: sgn(v) = tanh(v / v_0)
_SPEED_WEIGHT = 0.01  # noise of an encoder over that of its speed [s]
_SLIDES = 0.95  # averaged |sgn(v)| from which on a joint slid all the time
_FEWEST = 50  # averages
_UNLIKE = 0.05  # of the averaged torque: what may be left of it, beside noise, for the law's to be taken


@dataclass(frozen=True, eq=False)
class MotorSamples:
    """All joints in motion: n averages.

    Attributes:
        time: (n,) times [s].
        regressor: (n, nj, 10 bodies) inverse-dynamics regressor of the joints, the base's columns first.
        spin: (n, nj) joint torques by the spin of rotors that have an inertia times gear ratio of one [Nm].
        torque: (n, nj) joint torques, as reported or from the commands [Nm].
        sign: (n, nj) averaged sign of the joint velocities.
        velocity: (n, nj) joint velocities [rad/s].
        acceleration: (n, nj) joint accelerations [rad/s2].
        command_rate: (n, nj) rates of the position targets that torques obey [rad/s]; zero where gains are not known.
        slides: (n, nj) whether a joint slid all the time about an average: 1 or 0.
        period: control period [s].
        kp: position gain [Nm/rad]; 0: not known.
        reported: whether torques were.
        delays: (nj,) delays of the position loop and their deviations [s]; None where torques do not tell them.
    """

    time: FloatArray
    regressor: FloatArray
    spin: FloatArray
    torque: FloatArray
    sign: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    command_rate: FloatArray
    slides: FloatArray
    period: float
    kp: float
    reported: bool
    delays: tuple[FloatArray, FloatArray] | None


def motor_samples(robot: RobotModel, recording: Recording, time_scale: float) -> MotorSamples:
    """Averages of the steady part of a swing.

    Args:
        time_scale: factor on times, of the robot's scale; one on an A1.

    Raises:
        RecordingError: it is too short, or has neither torques nor gains.
    """
    trial, steady = motor_trial(recording), recording.phase(Phase.SWING)
    joints, imu, spacing = steady.joints, steady.imu, SPACING * time_scale
    at = joints.time
    time = np.arange(at[0] + 3 * spacing, at[-1] - 3 * spacing, spacing)
    if len(time) < _FEWEST:
        raise RecordingError(f"the joints swung for {steady.duration:.1f} s; {2 * _FEWEST * spacing:.0f} s are needed")
    each = float(np.median(np.diff(at))) / (1 if joints.velocity is None else 2)
    knot = max(_KNOT * time_scale, _PER_KNOT * each)
    position = fit_spline(at, joints.position, knot, joints.velocity, _SPEED_WEIGHT).spline
    speed = position.derivative()
    velocity, acceleration = speed(at), speed.derivative()(at)
    average = averages(at, time, spacing)
    torque, rate = joints.torque, np.zeros_like(joints.position)
    delays = position_loop_delays(recording, time_scale)
    if trial.kp is not None and trial.kd is not None:
        _, rate = command_at(recording, at - THOUGHT_DELAY)
        if torque is None:
            damped = velocity if joints.velocity is None else joints.velocity
            torque = law_torque(recording, joints, damped, THOUGHT_DELAY)
    if torque is None:
        raise RecordingError("the recording has no joint torques, and no gains from which they would follow")
    if delays is not None and joints.velocity is not None:
        share = 151 / 315 * float(np.median(np.diff(at))) / spacing  # of a sample's variance in an average
        torque = _by_law(torque, law_torque(recording, joints, joints.velocity, delays[0]), average, share)
    force = fit_spline(imu.time, imu.acceleration_in_imu, spacing).spline(np.clip(at, imu.time[0], imu.time[-1]))
    force_in_base = force @ np.array(robot.imu_in_base.rotation).T
    regressor = _regressors(robot, position(at), velocity, acceleration, force_in_base)
    sign = average @ np.tanh(velocity / _STICTION_SPEED)
    regressor = _each(average, regressor)
    acceleration = average @ acceleration
    return MotorSamples(
        time, regressor, _spin(robot, regressor) - acceleration, average @ torque, sign, average @ velocity, acceleration,
        average @ rate, (np.abs(sign) > _SLIDES).astype(float), control_period(recording), trial.kp or 0.0,
        joints.torque is not None, delays,
    )  # fmt: skip


def _by_law(reported: FloatArray, law: FloatArray, average: csr_array, share: float) -> FloatArray:
    """(n, nj) torques of the law, in the unit of the reported ones, of motors that obey it; as reported of the others [Nm].

    Args:
        average: matrix of the averages in which torques are to be alike.
        share: part of the variance of a sample's noise that is in an average.
    """
    mean = reported.mean(axis=0)
    reported, law = reported - mean, law - law.mean(axis=0)
    law *= (law * reported).sum(axis=0) / np.maximum((law**2).sum(axis=0), np.finfo(float).tiny)
    left, whole = (np.mean((average @ part) ** 2, axis=0) for part in (reported - law, reported))
    noise = share * np.var(np.diff(reported - law, axis=0), axis=0) / 2
    return mean + np.where(left - noise < _UNLIKE**2 * whole, law, reported)


def averages(time: FloatArray, at: FloatArray, spacing: float) -> csr_array:
    """(m, n) matrix of the means of n samples about m times, weighted by a cubic B-spline of that knot spacing [s]."""
    first, last = np.searchsorted(time, at - 2 * spacing), np.searchsorted(time, at + 2 * spacing)
    rows = np.repeat(np.arange(len(at)), last - first)
    counted = [np.arange(begin, end, dtype=np.intp) for begin, end in zip(first.tolist(), last.tolist(), strict=True)]
    columns: NDArray[np.intp] = np.concatenate(counted)
    away = np.abs(time[columns] - at[rows]) / spacing
    weights = np.asarray(np.where(away < 1, 2 / 3 - away**2 + away**3 / 2, (2 - away) ** 3 / 6), dtype=float)
    weights /= np.bincount(rows, weights, len(at))[rows]
    return csr_array((weights, (rows, columns)), shape=(len(at), len(time)))


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


def _each(average: csr_array, regressor: FloatArray) -> FloatArray:
    """(m, nj, k) averages of a regressor (n, nj, k), of which most is zero."""
    there = np.abs(regressor).max(axis=0) > 0
    averaged = np.zeros((average.shape[0], *regressor.shape[1:]))
    averaged[:, there] = average @ regressor[:, there]
    return averaged


def _spin(robot: RobotModel, regressor: FloatArray) -> FloatArray:
    """(n, nj) joint torques of an inertia of one about each joint's axis, in the driven link less in the carrying one."""
    model = robot.pinocchio
    torque = np.zeros(regressor.shape[:2])
    for joint in (joint for leg in robot.legs.values() for joint in leg.joint_ids):
        axis = joint_axis(model, joint)
        torque += _about(regressor, joint, axis)
        torque -= _about(regressor, model.parents[joint], model.jointPlacements[joint].rotation @ axis)
    return torque


def _about(regressor: FloatArray, joint: int, axis: FloatArray) -> FloatArray:
    """(n, nj) torques of a unit inertia about an axis of a link."""
    x, y, z = axis
    inertia = np.array([x * x, x * y, y * y, x * z, y * z, z * z])  # as Pinocchio orders it: xx, xy, yy, xz, yz, zz
    start = 10 * (joint - 1)
    return np.asarray(regressor[:, :, start + 4 : start + 10] @ inertia, dtype=float)
