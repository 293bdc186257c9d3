"""What legs that swing in the air say of their motors.

Each is a chain that hangs from a body whose specific force the accelerometer reads. That body rests if the robot lies; if it
stands on its other feet it sways a little, and the gyroscope measures how. With Y the inverse-dynamics regressor of a leg's
links, whose parameters are pi, each joint obeys

    tau = kappa (Y(q, v, a) pi + F_c sgn(v) + F_v v + A a + B s) + o + kp lag v_cmd,    kappa = 1 / g,

tau being the torque as reported, g the true torque over it, o its offset. Where the data want it friction grows toward rest
(`stribeck.py`), by another term in the bracket. A rotor that turns N times as fast as its joint in
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

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.sparse import csr_array

from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError
from equipoise.estimator.measurements.smoothing import fit_spline
from equipoise.estimator.motors.delay import (
    THOUGHT_DELAY,
    command_at,
    joints_that_swing,
    law_torque,
    motor_trial,
    position_loop_delays,
)
from equipoise.estimator.motors.stribeck import SPEEDS, stribeck_terms
from equipoise.recording.phases import Phase
from equipoise.recording.recording import ImuStream, Recording
from equipoise.robot.model import RobotModel
from equipoise.robot.tree import joint_axis

SPACING = 0.02  # between the averages of all terms [s] on an A1
_KNOT = 0.01  # of the positions' spline [s] on an A1: accelerations are averaged after it
_PER_KNOT = 4  # samples at least, of positions or of velocities
_STICTION_SPEED = 0.01  # [rad/s]: sgn(v) = tanh(v / v_0)
_SPEED_WEIGHT = 0.01  # noise of an encoder over that of its speed [s]
_SLIDES = 0.95  # averaged |sgn(v)| from which on a joint slid all the time
_FEWEST = 50  # averages
_NEAR = 6  # spacings from a gap in the samples: splines do not know what happens in it, and bend around it
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
        stribeck: (speeds, n, nj) averaged friction that is one at rest and falls with the speed, as of `stribeck_terms`.
        command_rate: (n, nj) rates of the position targets that torques obey [rad/s]; zero where gains are not known.
        slides: (n, nj) whether a joint slid all the time about an average, and was there to swing: 1 or 0.
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
    stribeck: FloatArray
    command_rate: FloatArray
    slides: FloatArray
    period: float
    kp: float
    reported: bool
    delays: tuple[FloatArray, FloatArray] | None

    def terms(self, stribeck_speed: float | None = None) -> dict[str, FloatArray]:
        """(n, nj) torques of a joint whose friction, rotor inertia, ... is one, by name; with the friction that falls with
        one of `SPEEDS` [rad/s], or without.
        """
        terms = {"coulomb_friction": self.sign, "viscous_friction": self.velocity, "armature": self.acceleration}
        return terms if stribeck_speed is None else terms | {"stribeck": self.stribeck[SPEEDS.index(stribeck_speed)]}


def motor_samples(robot: RobotModel, swings: Sequence[Recording], time_scale: float) -> MotorSamples:
    """Averages of the steady parts of swings.

    Args:
        swings: recordings in which all joints swing between them.
        time_scale: factor on times, of the robot's scale; one on an A1.

    Raises:
        RecordingError: one is too short, or has neither torques nor gains.
    """
    swings = [_as_reported(robot, recording) for recording in swings]
    delays = position_loop_delays(robot, swings, time_scale)
    parts = [_samples_of(robot, recording, time_scale, delays) for recording in swings]
    arrays = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in (
            "time", "regressor", "spin", "torque", "sign", "velocity", "acceleration", "command_rate", "slides",
        )
    }  # fmt: skip
    stribeck = np.concatenate([part.stribeck for part in parts], axis=1)
    return replace(parts[0], **arrays, stribeck=stribeck, reported=all(part.reported for part in parts))


def _as_reported(robot: RobotModel, recording: Recording) -> Recording:
    """Without torques or velocities that do not change in a swing: some drivers fill what they do not know with zeros."""
    swinging, joints = list(joints_that_swing(robot, motor_trial(recording))), recording.phase(Phase.SWING).joints
    dead = {
        name: None
        for name in ("velocity", "torque")
        if (column := getattr(joints, name)) is not None and (np.ptp(column[:, swinging], axis=0) == 0).any()
    }
    return replace(recording, joints=replace(recording.joints, **dead)) if dead else recording


def _samples_of(
    robot: RobotModel, recording: Recording, time_scale: float, delays: tuple[FloatArray, FloatArray] | None
) -> MotorSamples:
    """Of one swing."""
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
        _, rate = command_at(recording, at - THOUGHT_DELAY)
        if torque is None:
            damped = velocity if joints.velocity is None else joints.velocity
            torque = law_torque(recording, joints, damped, THOUGHT_DELAY)
    if torque is None:
        raise RecordingError("the recording has no joint torques, and no gains from which they would follow")
    if delays is not None and joints.velocity is not None:
        share = 151 / 315 * float(np.median(np.diff(at))) / spacing  # of a sample's variance in an average
        torque = _by_law(torque, law_torque(recording, joints, joints.velocity, delays[0]), average[~near], share)
    base = (
        _base_at_rest(robot, steady, spacing) if trial.leg is None else _base_that_excitations(robot, steady, spacing)
    )
    regressor = _regressors(robot, position(at), velocity, acceleration, base)
    turning = np.tanh(velocity / _STICTION_SPEED)
    sign, stribeck = average @ turning, stribeck_terms(average, turning, velocity)
    slides = np.zeros_like(sign)
    swinging = list(joints_that_swing(robot, trial))
    slides[:, swinging] = np.abs(sign[:, swinging]) > _SLIDES
    slides[near] = 0.0
    regressor = _each(average, regressor)
    acceleration = average @ acceleration
    return MotorSamples(
        time, regressor, _spin(robot, regressor) - acceleration, average @ torque, sign, average @ velocity, acceleration,
        stribeck, average @ rate, slides, control_period(recording), trial.kp or 0.0, joints.torque is not None, delays,
    )  # fmt: skip


def _near_gaps(time: FloatArray, samples: FloatArray, spacing: float) -> NDArray[np.bool_]:
    """(m,) which of m times are near a time without samples, longer than a spacing [s]."""
    steps = np.diff(samples)
    gaps = np.flatnonzero(steps > max(spacing, _PER_KNOT * float(np.median(steps))))
    before, behind = samples[gaps, None] - _NEAR * spacing, samples[gaps + 1, None] + _NEAR * spacing
    return np.any((time > before) & (time < behind), axis=0)


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


@dataclass(frozen=True, eq=False)
class _BaseMotion:
    """What the base does at n joint samples, in its own axes.

    Attributes:
        force: (n, 3) specific force of the base frame's origin [m/s2].
        turning, turning_faster: (n, 3) its angular velocity [rad/s] and acceleration [rad/s2].
    """

    force: FloatArray
    turning: FloatArray
    turning_faster: FloatArray


def _base_at_rest(robot: RobotModel, steady: Recording, spacing: float) -> _BaseMotion:
    """Of a robot that lies: what its gyroscope says is noise."""
    at, imu = steady.joints.time, steady.imu
    force = fit_spline(imu.time, imu.acceleration_in_imu, _imu_knot(imu, spacing)).spline(
        np.clip(at, imu.time[0], imu.time[-1])
    )
    none = np.zeros_like(force)
    return _BaseMotion(force @ np.array(robot.imu_in_base.rotation).T, none, none)


def _imu_knot(imu: ImuStream, spacing: float) -> float:
    """[s]."""
    return max(spacing, _PER_KNOT * float(np.median(np.diff(imu.time))))


def _base_that_excitations(robot: RobotModel, steady: Recording, spacing: float) -> _BaseMotion:
    """Of a robot that stands on three feet; the accelerometer is not where the base frame is."""
    rest, imu, pose = _base_at_rest(robot, steady, spacing), steady.imu, robot.imu_in_base
    at = np.clip(steady.joints.time, imu.time[0], imu.time[-1])
    gyroscope = fit_spline(imu.time, imu.angular_velocity_in_imu, _imu_knot(imu, spacing)).spline
    to_base, arm = np.array(pose.rotation).T, np.array(pose.translation)
    turning, faster = gyroscope(at) @ to_base, gyroscope.derivative()(at) @ to_base
    force = rest.force - np.cross(faster, arm) - np.cross(turning, np.cross(turning, arm))
    return _BaseMotion(force, turning, faster)


def _regressors(
    robot: RobotModel, position: FloatArray, velocity: FloatArray, acceleration: FloatArray, base: _BaseMotion
) -> FloatArray:
    """Pinocchio's regressors without gravity, which the base's specific force has in it; in a frame that flies along."""
    model = robot.pinocchio.copy()
    model.gravity.linear = np.zeros(3)
    data, here = model.createData(), np.zeros(3)
    rows = zip(position, velocity, acceleration, base.force, base.turning, base.turning_faster, strict=True)
    regressors = [
        pin.computeJointTorqueRegressor(
            model, data, robot.configuration(q), np.concatenate([here, w, v]), np.concatenate([f, faster, a])
        )[6:]
        for q, v, a, f, w, faster in rows
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
