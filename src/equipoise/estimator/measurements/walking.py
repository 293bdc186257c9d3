"""Walking as the Bayesian estimators read it: every step's time on two feet, as that of a lift.

The tilt equation needs no rest and no attitude: contact forces have no moment about the line of two standing feet, whatever
the robot does, and the accelerometer feels gravity and motion in one. Up is needed only to say where on its sphere a foot
touches the floor, and which feet are off it: the mean of the specific force over more than a step, carried by the gyroscope.
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
"""[s] around a walk, that its readings of up are means over."""
_SHORTEST = 0.02  # [s] between the means at both ends
_FEWEST = 8  # samples
# Perfect sensors of a robot whose feet land fit no better than ordinary ones, in two engines: [rad], [rad/s], [rad/s], [m/s2].
_ORDINARY = SensorNoise(1e-4, 0.02, 2e-3, 0.04)
_LONGEST_PIECE = 20.0  # [s]
_USUAL_BIAS = 0.01  # [rad/s] of a gyroscope
_SPEEDING_UP = 0.03  # of gravity, over a second


def up_between_steps(
    time: FloatArray, angular_velocity: FloatArray, acceleration: FloatArray, reach: float
) -> tuple[FloatArray, FloatArray]:
    """Direction against gravity of something that walks: what it is accelerated by is nothing, over some steps.

    Args:
        time: (n,) times, about evenly spaced [s].
        angular_velocity: (n, 3) by the gyroscope, less its bias [rad/s].
        acceleration: (n, 3) specific force, in the same axes [m/s2].
        reach: standard deviation of the mean's weights over time [s].

    Returns:
        (n, 3) directions against gravity, and (n,) how far it has turned about them since the first one, to its left [rad].
    """
    path = attitudes(time, angular_velocity).as_matrix()
    felt = np.einsum("nij,nj->ni", path, acceleration)
    felt = gaussian_filter1d(felt, reach / float(np.median(np.diff(time))), axis=0, mode="nearest")
    up: FloatArray = np.einsum("nji,nj->ni", path, felt / np.linalg.norm(felt, axis=1, keepdims=True))
    turning = np.einsum("ni,ni->n", angular_velocity, up)
    return up, np.asarray(cumulative_trapezoid(turning, time, initial=0), dtype=float)


def gyro_bias_of_walks(walks: Sequence[tuple[FloatArray, FloatArray, FloatArray]]) -> FloatArray:
    """(3,) bias with which what the gyroscope carries stays with gravity, over walks in which nothing stands still [rad/s].

    To first order in the bias: it turns what is carried from the middle of a walk away from the mean. What it is about the
    vertical no walk tells, and it is drawn to zero.

    Args:
        walks: times, angular velocities and specific forces of each, as of `up_between_steps`, the first without its bias.
    """
    information, moment = np.eye(3) / _USUAL_BIAS**2, np.zeros(3)
    for time, angular_velocity, acceleration in _pieces(walks):
        path = attitudes(time, angular_velocity).as_matrix()
        felt: FloatArray = np.einsum("nij,nj->ni", path, acceleration)
        felt = felt / np.linalg.norm(felt.mean(axis=0))
        turned = cumulative_trapezoid(path, time, axis=0, initial=0)
        # R f is R_true f_true turned by the integral of R b: u = u0 + (integral of R b) x u0.
        columns = -cross_matrix(felt.mean(axis=0)) @ turned
        columns = columns - columns.mean(axis=0)
        off = felt - felt.mean(axis=0)
        weight = 1 / _SPEEDING_UP**2 * float(np.median(np.diff(time))) / CONTEXT
        information += weight * np.einsum("nij,nik->jk", columns, columns)
        moment += weight * np.einsum("nij,ni->j", columns, off)
    return np.asarray(np.linalg.solve(information, moment), dtype=float)


def _pieces(walks: Sequence[tuple[FloatArray, FloatArray, FloatArray]]) -> Iterator[tuple[FloatArray, ...]]:
    """Short enough for the first order in the bias."""
    for walk in walks:
        count = max(1, round(float(walk[0][-1] - walk[0][0]) / _LONGEST_PIECE)) if len(walk[0]) else 0
        yield from zip(*(np.array_split(column, count) for column in walk), strict=True) if count else ()


def read_walk(recording: Recording, trial: WalkTrial, stance: Stance, gyro_bias: FloatArray) -> list[StepSamples]:
    """Every step's time on two feet that can be read.

    Args:
        recording: recording of the walk and of some time around it.
        trial: trial that the recording is of.
        stance: nominal stance of the robot.
        gyro_bias: (3,) bias of the gyroscope, in the IMU frame [rad/s].

    Raises:
        RecordingError: no step can be read.
    """
    joints, imu, clock = recording.joints, recording.imu, stance.scale.time
    if min(len(joints.time), len(imu.time)) < _FEWEST:
        raise RecordingError("samples are missing")
    gyro = imu.angular_velocity_in_imu - gyro_bias
    up_in_imu, turned = up_between_steps(imu.time, gyro, imu.acceleration_in_imu, CONTEXT / 2 * clock)
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
        raise RecordingError(reasons[0] if reasons else "no step in it")
    begin = float(np.interp(trial.steps[0].start, imu.time, turned))
    turns = [float(np.interp(step.start, imu.time, turned)) - begin for step in steps]
    return [replace(step, heading=trial.heading + turn) for step, turn in zip(steps, turns, strict=True)]
