"""Equations of motion of legs that swing in the air, linear in the motors' parameters.

Each leg hangs from a base whose specific force the accelerometer measures. The base rests if the robot lies. If the robot
stands on its other feet, the base moves a little and the gyroscope measures it. With Y the inverse-dynamics regressor of a
leg's links and pi their parameters, each joint obeys

    tau = kappa (Y(q, v, a) pi + F_c sgn(v) + F_v v + A a + B s) + o + kp lag v_cmd,    kappa = 1 / g,

tau is the reported torque, g the ratio of true to reported torque, and o the torque's offset. If the data require it, the
bracket has another term for Stribeck friction (`stribeck.py`). A geared rotor in a rotating link adds B q' w to the energy,
where w is the link's velocity about the joint's axis. B s is the corresponding torque: the inertia B is moved from the
carrying link and the armature to the driven link.

If reported torques obey a known control law, tau = kp (q_cmd(t - d) - q) - kd v (`delay.py`), the law's torque is used: it
has no current-sensor noise.

Position targets move in steps, so torques are sawteeth. A sample is taken just after a step, but the motion depends on the
mean: the sample is kp v_cmd T / 2 too large, and `lag` is half a control period T. Unreported torques are computed from the
same law; `lag` then also contains the delay d minus its nominal value.

All terms (torques, regressors, sgn(v)) are computed at every sample and then pass one filter (`averages`). When a joint
reverses, its friction and acceleration jump. With different filters, the remainder of these jumps would appear as inertia,
viscosity and gains.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError
from equipoise.estimator.equations.torque_balance import regressors_and_twists
from equipoise.estimator.measurements.smoothing import fit_spline
from equipoise.estimator.motors.delay import (
    NOMINAL_DELAY,
    command_at,
    law_torque,
    motor_trial,
    position_loop_delays,
    swinging_joints,
)
from equipoise.estimator.motors.stribeck import SPEEDS, stribeck_terms
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.robot.model import RobotModel
from equipoise.robot.tree import joint_axis

SPACING = 0.02  # between the averages of all terms [s] on an A1
_KNOT = 0.01  # of the positions' spline [s] on an A1, before averaging
_PER_KNOT = 4  # samples at least, of positions or of velocities
_STICTION_SPEED = 0.01  # [rad/s]: sgn(v) = tanh(v / v_0)
_SPEED_WEIGHT = 0.01  # noise of an encoder over that of its speed [s]
_SLIDES = 0.95  # minimum averaged |sgn(v)| of a joint that slides continuously
_FEWEST = 50  # averages
_NEAR = 6  # spacings from a gap in the samples: splines are inaccurate there
_LAW_TOLERANCE = 0.05  # of the averaged torque: maximum difference beyond noise for the law's torque to be used


@dataclass(frozen=True, eq=False)
class MotorSamples:
    """Averaged samples of all joints in motion.

    Attributes:
        time: (n,) times [s].
        regressor: (n, nj, 10 bodies) inverse-dynamics regressor of the joints, the base's columns first.
        spin: (n, nj) joint torques due to spinning rotors with an inertia times gear ratio of one [Nm].
        torque: (n, nj) joint torques, reported or from the commands [Nm].
        sign: (n, nj) averaged sign of the joint velocities.
        velocity: (n, nj) joint velocities [rad/s].
        acceleration: (n, nj) joint accelerations [rad/s2].
        stribeck: (speeds, n, nj) averaged Stribeck friction of one at rest, see `stribeck_terms`.
        command_rate: (n, nj) rates of the position targets [rad/s]; zero without known gains.
        slides: (n, nj) 1 if a swinging joint slid continuously during an average, else 0.
        period: control period [s].
        kp: position gain [Nm/rad]; 0 if it is not known.
        reported: True if torques were reported.
        delays: (nj,) delays of the position loop and their standard deviations [s], or None if they are not identified.
    """

    time: FloatArray
    regressor: FloatArray
    spin: FloatArray
    torque: FloatArray
    sign: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    stribeck: FloatArray
    command_rate: FloatArray
    slides: FloatArray
    period: float
    kp: float
    reported: bool
    delays: tuple[FloatArray, FloatArray] | None

    def terms(self, stribeck_speed: float | None = None) -> dict[str, FloatArray]:
        """Return (n, nj) torques of unit friction, rotor inertia, ... by name, with Stribeck friction of one of `SPEEDS`
        [rad/s] or without.
        """
        terms = {"coulomb_friction": self.sign, "viscous_friction": self.velocity, "armature": self.acceleration}
        return terms if stribeck_speed is None else terms | {"stribeck": self.stribeck[SPEEDS.index(stribeck_speed)]}


def motor_samples(robot: RobotModel, swings: Sequence[Recording], time_scale: float) -> MotorSamples:
    """Average the steady parts of swings.

    Args:
        swings: recordings that together contain a swing of every joint.
        time_scale: time scale of the robot, relative to an A1.

    Raises:
        RecordingError: one is too short, or has neither torques nor gains.
    """
    swings = [_without_constant_signals(robot, recording) for recording in swings]
    delays = position_loop_delays(robot, swings, time_scale)
    parts = [_samples_of(robot, recording, time_scale, delays) for recording in swings]
    arrays = {
        name: np.concatenate([getattr(part, name) for part in parts], axis=int(name == "stribeck"))
        for name, value in vars(parts[0]).items()
        if isinstance(value, np.ndarray)
    }
    return replace(parts[0], **arrays, reported=all(part.reported for part in parts))


def _without_constant_signals(robot: RobotModel, recording: Recording) -> Recording:
    """Remove torques or velocities that are constant in a swing: some drivers report zeros instead."""
    swinging, joints = list(swinging_joints(robot, motor_trial(recording))), recording.phase(Phase.SWING).joints
    constant = {
        name: None
        for name in ("velocity", "torque")
        if (column := getattr(joints, name)) is not None and (np.ptp(column[:, swinging], axis=0) == 0).any()
    }
    return replace(recording, joints=replace(recording.joints, **constant)) if constant else recording


def _samples_of(
    robot: RobotModel, recording: Recording, time_scale: float, delays: tuple[FloatArray, FloatArray] | None
) -> MotorSamples:
    """Average the steady part of one swing."""
    trial, steady = motor_trial(recording), recording.phase(Phase.SWING)
    joints, spacing = steady.joints, SPACING * time_scale
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
    near = _near_gaps(time, at, spacing) | _near_gaps(time, steady.imu.time, spacing)
    torque, rate = joints.torque, np.zeros_like(joints.position)
    if trial.kp is not None and trial.kd is not None:
        _, rate = command_at(recording, at - NOMINAL_DELAY)
        if torque is None:
            damped = velocity if joints.velocity is None else joints.velocity
            torque = law_torque(recording, joints, damped, NOMINAL_DELAY)
    if torque is None:
        raise RecordingError("the recording has neither joint torques nor the gains to compute them")
    if delays is not None and joints.velocity is not None:
        share = 151 / 315 * float(np.median(np.diff(at))) / spacing  # of a sample's variance in an average
        torque = _by_law(torque, law_torque(recording, joints, joints.velocity, delays[0]), average[~near], share)
    force, base_turning, turning_rate = _base_motion(robot, steady, spacing, rests=trial.leg is None)
    speeds = np.hstack([np.zeros_like(force), base_turning, velocity])
    regressor, _ = regressors_and_twists(robot, position(at), speeds, np.hstack([force, turning_rate, acceleration]))
    turning = np.tanh(velocity / _STICTION_SPEED)
    sign, stribeck = average @ turning, stribeck_terms(average, turning, velocity)
    slides = np.zeros_like(sign)
    swinging = list(swinging_joints(robot, trial))
    slides[:, swinging] = np.abs(sign[:, swinging]) > _SLIDES
    slides[near] = 0.0
    regressor = _each(average, regressor[:, 6:])
    acceleration = average @ acceleration
    return MotorSamples(
        time, regressor, _spin(robot, regressor) - acceleration, average @ torque, sign, average @ velocity, acceleration,
        stribeck, average @ rate, slides, control_period(recording), trial.kp or 0.0, joints.torque is not None, delays,
    )  # fmt: skip


def _near_gaps(time: FloatArray, samples: FloatArray, spacing: float) -> NDArray[np.bool_]:
    """Return an (m,) mask of times near gaps between samples that are longer than a spacing [s]."""
    steps = np.diff(samples)
    gaps = np.flatnonzero(steps > max(spacing, _PER_KNOT * float(np.median(steps))))
    before, behind = samples[gaps, None] - _NEAR * spacing, samples[gaps + 1, None] + _NEAR * spacing
    return np.any((time > before) & (time < behind), axis=0)


def _by_law(reported: FloatArray, law: FloatArray, average: csr_array, share: float) -> FloatArray:
    """Return (n, nj) torques: the law's, scaled to reported ones, of motors that obey it; else the reported ones [Nm].

    Args:
        average: averaging matrix, applied before the comparison.
        share: ratio of an average's noise variance to that of a sample.
    """
    mean = reported.mean(axis=0)
    reported, law = reported - mean, law - law.mean(axis=0)
    law *= (law * reported).sum(axis=0) / np.maximum((law**2).sum(axis=0), np.finfo(float).tiny)
    left, whole = (np.mean((average @ part) ** 2, axis=0) for part in (reported - law, reported))
    noise = share * np.var(np.diff(reported - law, axis=0), axis=0) / 2
    return mean + np.where(left - noise < _LAW_TOLERANCE**2 * whole, law, reported)


def averages(time: FloatArray, at: FloatArray, spacing: float) -> csr_array:
    """Return the (m, n) matrix that averages n samples at m times, weighted by a cubic B-spline of a knot spacing [s]."""
    first, last = np.searchsorted(time, at - 2 * spacing), np.searchsorted(time, at + 2 * spacing)
    rows = np.repeat(np.arange(len(at)), last - first)
    counted = [np.arange(begin, end, dtype=np.intp) for begin, end in zip(first.tolist(), last.tolist(), strict=True)]
    columns: NDArray[np.intp] = np.concatenate(counted)
    away = np.abs(time[columns] - at[rows]) / spacing
    weights = np.asarray(np.where(away < 1, 2 / 3 - away**2 + away**3 / 2, (2 - away) ** 3 / 6), dtype=float)
    weights /= np.bincount(rows, weights, len(at))[rows]
    return csr_array((weights, (rows, columns)), shape=(len(at), len(time)))


def control_period(recording: Recording) -> float:
    """Return the time between commands [s]."""
    assert recording.commands is not None
    return float(np.median(np.diff(recording.commands.time)))


def _base_motion(robot: RobotModel, steady: Recording, spacing: float, rests: bool) -> tuple[FloatArray, ...]:
    """Return the motion of the base at n joint samples, in base axes.

    Args:
        rests: True for a lying robot, whose base has no gyroscope noise; False for one on three feet.

    Returns:
        (n, 3) specific force of the base frame's origin [m/s2], angular velocity [rad/s] and acceleration [rad/s2].
    """
    imu, to_base = steady.imu, np.array(robot.imu_in_base.rotation).T
    at = np.clip(steady.joints.time, imu.time[0], imu.time[-1])
    knot = max(spacing, _PER_KNOT * float(np.median(np.diff(imu.time))))
    force = fit_spline(imu.time, imu.acceleration_in_imu, knot).spline(at) @ to_base
    if rests:
        return force, np.zeros_like(force), np.zeros_like(force)
    gyroscope = fit_spline(imu.time, imu.angular_velocity_in_imu, knot).spline
    turning, turning_rate = gyroscope(at) @ to_base, gyroscope.derivative()(at) @ to_base
    arm = np.array(robot.imu_in_base.translation)
    force = force - np.cross(turning_rate, arm) - np.cross(turning, np.cross(turning, arm))
    return force, turning, turning_rate


def _each(average: csr_array, regressor: FloatArray) -> FloatArray:
    """Return (m, nj, k) averages of an (n, nj, k) regressor that is mostly zero."""
    nonzero = np.abs(regressor).max(axis=0) > 0
    averaged = np.zeros((average.shape[0], *regressor.shape[1:]))
    averaged[:, nonzero] = average @ regressor[:, nonzero]
    return averaged


def _spin(robot: RobotModel, regressor: FloatArray) -> FloatArray:
    """Return (n, nj) joint torques of unit inertias about the joints' axes, of driven links minus carrying links."""
    model = robot.pinocchio
    torque = np.zeros(regressor.shape[:2])
    for joint in (joint for leg in robot.legs.values() for joint in leg.joint_ids):
        axis = joint_axis(model, joint)
        torque += _about(regressor, joint, axis)
        torque -= _about(regressor, model.parents[joint], model.jointPlacements[joint].rotation @ axis)
    return torque


def _about(regressor: FloatArray, joint: int, axis: FloatArray) -> FloatArray:
    """Return (n, nj) torques of a unit inertia about an axis of a link."""
    x, y, z = axis
    inertia = np.array([x * x, x * y, y * y, x * z, y * z, z * z])  # as Pinocchio orders it: xx, xy, yy, xz, yz, zz
    start = 10 * (joint - 1)
    return np.asarray(regressor[:, :, start + 4 : start + 10] @ inertia, dtype=float)
