"""Samples on two feet of every step of a walk, in the form of lift samples.

The tilt equation needs neither rest nor attitude: contact forces never have a moment about the line of two standing feet, and
the accelerometer measures gravity and motion together. The upward direction only determines the contact points and the feet
in the air. It is the mean of the specific force over more than a step, propagated by the gyroscope.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.ndimage import gaussian_filter1d

from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError
from equipoise.estimator.measurements.leg_motion import cross_matrix
from equipoise.estimator.measurements.lift_samples import SensorNoise, StepSamples, attitudes, on_two_feet
from equipoise.estimator.measurements.smoothing import noise_in_motion
from equipoise.recording.recording import Recording
from equipoise.recording.trials import WalkTrial
from equipoise.robot.stance import Stance

# On an A1; times are multiplied by that of the stance's scale.
CONTEXT = 1.0
"""Time over which the upward direction is averaged to find steps [s]."""
MARGIN = 4.0
"""Time around a walk that is read with it [s]; half of it is the reach of the upward direction's mean.

Accelerations that last longer than the mean shift the contact points of round feet, and raise the estimated CoM by up to the
feet's radius: 1 mm on an A1 that changes its speed within 7 s and averages over 0.5 s.
"""
_SHORTEST = 0.02  # [s] between the means at both ends
_FEWEST = 8  # samples
# With foot impacts, perfect sensors fit no better than these, in two engines: [rad], [rad/s], [rad/s], [m/s2].
_ORDINARY = SensorNoise(1e-4, 0.02, 2e-3, 0.04)
_LONGEST_PIECE = 20.0  # [s]
_USUAL_BIAS = 0.01  # [rad/s] of a gyroscope
_MEAN_ACCELERATION = 0.03  # of gravity, over a second


def up_between_steps(
    time: FloatArray, angular_velocity: FloatArray, acceleration: FloatArray, reach: float
) -> tuple[FloatArray, FloatArray]:
    """Estimate the upward direction of a walking robot, whose mean acceleration over some steps is zero.

    Args:
        time: (n,) times, about evenly spaced [s].
        angular_velocity: (n, 3) gyroscope readings minus their bias [rad/s].
        acceleration: (n, 3) specific force, in the same axes [m/s2].
        reach: standard deviation of the mean's weights over time [s].

    Returns:
        (n, 3) upward directions, and (n,) rotations to the left about them since the first sample [rad].
    """
    path = attitudes(time, angular_velocity).as_matrix()
    force = np.einsum("nij,nj->ni", path, acceleration)
    force = gaussian_filter1d(force, reach / float(np.median(np.diff(time))), axis=0, mode="reflect")
    up: FloatArray = np.einsum("nji,nj->ni", path, force / np.linalg.norm(force, axis=1, keepdims=True))
    turning = np.einsum("ni,ni->n", angular_velocity, up)
    return up, np.asarray(cumulative_trapezoid(turning, time, initial=0), dtype=float)


def gyro_bias_of_walks(walks: Sequence[tuple[FloatArray, FloatArray, FloatArray]]) -> FloatArray:
    """Estimate the (3,) gyroscope bias from the direction of gravity, over walks without a rest [rad/s].

    The estimate is of first order in the bias, which rotates the integrated direction of gravity away from its mean. The
    component about the vertical is not observable, and its prior keeps it near zero.

    Args:
        walks: times, uncorrected angular velocities and specific forces of each, see `up_between_steps`.
    """
    information, moment = np.eye(3) / _USUAL_BIAS**2, np.zeros(3)
    for time, angular_velocity, acceleration in _pieces(walks):
        path = attitudes(time, angular_velocity).as_matrix()
        force: FloatArray = np.einsum("nij,nj->ni", path, acceleration)
        force = force / np.linalg.norm(force.mean(axis=0))
        turned = cumulative_trapezoid(path, time, axis=0, initial=0)
        # R f is R_true f_true rotated by the integral of R b: u = u0 + (integral of R b) x u0.
        columns = -cross_matrix(force.mean(axis=0)) @ turned
        columns = columns - columns.mean(axis=0)
        off = force - force.mean(axis=0)
        weight = 1 / _MEAN_ACCELERATION**2 * float(np.median(np.diff(time))) / CONTEXT
        information += weight * np.einsum("nij,nik->jk", columns, columns)
        moment += weight * np.einsum("nij,ni->j", columns, off)
    return np.asarray(np.linalg.solve(information, moment), dtype=float)


def _pieces(walks: Sequence[tuple[FloatArray, FloatArray, FloatArray]]) -> Iterator[tuple[FloatArray, ...]]:
    """Split walks into pieces short enough for the first order in the bias."""
    for walk in walks:
        count = max(1, round(float(walk[0][-1] - walk[0][0]) / _LONGEST_PIECE)) if len(walk[0]) else 0
        yield from zip(*(np.array_split(column, count) for column in walk), strict=True) if count else ()


def read_walk(recording: Recording, trial: WalkTrial, stance: Stance, gyro_bias: FloatArray) -> list[StepSamples]:
    """Return the samples on two feet of every readable step.

    Args:
        recording: recording of the walk and of some time around it.
        trial: trial of the recording.
        stance: nominal stance of the robot.
        gyro_bias: (3,) bias of the gyroscope, in the IMU frame [rad/s].

    Raises:
        RecordingError: no step can be read.
    """
    joints, imu, clock = recording.joints, recording.imu, stance.scale.time
    if min(len(joints.time), len(imu.time)) < _FEWEST:
        raise RecordingError("samples are missing")
    gyro = imu.angular_velocity_in_imu - gyro_bias
    up_in_imu, turned = up_between_steps(imu.time, gyro, imu.acceleration_in_imu, MARGIN / 2 * clock)
    noise = SensorNoise.of(recording, noise_in_motion, _ORDINARY)
    steps: list[StepSamples] = []
    reasons: list[str] = []
    for step in trial.steps:
        window = step.start, step.end
        try:
            steps.append(
                on_two_feet(recording, step.pair, window, gyro, up_in_imu, noise, clock, _SHORTEST, StepSamples)
            )
        except RecordingError as error:
            reasons.append(str(error))
    if not steps:
        raise RecordingError(reasons[0] if reasons else "the walk has no steps")
    begin = float(np.interp(trial.steps[0].start, imu.time, turned))
    turns = [float(np.interp(step.start, imu.time, turned)) - begin for step in steps]
    return [replace(step, heading=trial.heading + turn) for step, turn in zip(steps, turns, strict=True)]
