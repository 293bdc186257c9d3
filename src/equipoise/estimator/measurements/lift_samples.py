"""Smoothed samples of a lift trial: the interval on two feet, and the rest before it.

Contact sensors are not needed: encoders and gyroscope determine when both lifted feet were off the floor.

All readings are averaged over time with the same weights. The tilt equation combines gyroscope, accelerometer and encoders,
whose bandwidths differ: an IMU has a low-pass filter, encoders have none, and velocity readings stiffen a spline. A fast
motion would appear as a momentum. Below some ten hertz all agree, except for a delay. Without the average, moments of inertia
were 2 to 6 % low in simulation, with it 0 to 1 %.

In a walk, legs and forces change within the time of the average, and a mean of products is not the product of means. The terms
of the equation are averaged there in place of the readings: the CoM of a trotting A1 was 0.5 mm too high, Iyy 1 % too low.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar, TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError
from equipoise.estimator.measurements.leg_motion import LegChains
from equipoise.estimator.measurements.smoothing import fit_spline, mean_about
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.recording.runs import true_runs
from equipoise.robot.model import DIAGONALS, LEG_NAMES, PAIRS, RobotModel
from equipoise.robot.stance import Stance

# The bandwidth of sensors does not depend on a robot's size: these are the same on all robots.
REACH = 0.03  # [s] to either side: interval of the mean; it halves 19 Hz
KNOT = 0.015  # [s] between the knots of the splines through readings
POSE_KNOT = 0.025
"""[s] between the knots of the splines through poses of the base, whose derivatives stand in for an IMU's readings."""
_POSE_PERIOD = 0.005  # [s] at which the noise of poses is sampled: their density alone matters

# On an A1; lengths and times are multiplied by those of the stance's scale.
_CLEAR = 2.5e-3  # [m] that lifted feet must be above the floor
_STEP = 0.010  # [s]
_SHORTEST = 0.06  # [s]
_LONGEST_GAP = 0.02  # [s] without a sample
_FEWEST = 10  # samples
_OFFSETS, _WEIGHTS = mean_about(REACH)
_BETWEEN = float(_OFFSETS[1] - _OFFSETS[0])  # [s] between the readings of a mean of terms
_PAD = 0.06  # [s] fitted beyond either end of the interval on two feet, where a spline is less accurate


@dataclass(frozen=True, eq=False)
class LiftSamples:
    """Samples on two feet of one lift or step. The gyroscope's bias is subtracted.

    Attributes:
        pair: name of the stance feet, a diagonal in a lift.
        start: time of the first sample [s].
        step: time between rows of the equation [s].
        reading_step: time between readings [s].
        average: (rows, n) weights of the means over time that the rows are; None: the readings are means, one for each row.
        joint_position, joint_velocity, joint_acceleration: (n, nj) joint positions and their derivatives, smoothed [rad],
            [rad/s], [rad/s2].
        angular_velocity_in_imu, angular_acceleration_in_imu: (n, 3) angular velocity and acceleration of the IMU,
            smoothed [rad/s], [rad/s2].
        acceleration_in_imu: (n, 3) specific force at the IMU, smoothed [m/s2].
        up_in_imu: (n, 3) upward direction, from the accelerometer at rest and the gyroscope since.
        velocity_noise: (rows, rows) covariance of any joint's smoothed velocity [rad2/s2].
        angular_velocity_noise: (rows, rows) covariance of any axis' smoothed angular velocity [rad2/s2].
        acceleration_noise: (rows, rows) covariance of any axis' smoothed specific force [m2/s4].
        when: time since the middle of the run, divided by the run's duration.
        heading: rotation of the robot to its left since the start of the run [rad].
    """

    pair: str
    start: float
    step: float
    joint_position: FloatArray
    joint_velocity: FloatArray
    joint_acceleration: FloatArray
    angular_velocity_in_imu: FloatArray
    angular_acceleration_in_imu: FloatArray
    acceleration_in_imu: FloatArray
    up_in_imu: FloatArray
    velocity_noise: FloatArray
    angular_velocity_noise: FloatArray
    acceleration_noise: FloatArray
    when: float = 0.0
    heading: float = 0.0
    average: FloatArray | None = None
    averages_terms: ClassVar[bool] = False

    @property
    def rows(self) -> int:
        """Number of rows of the equation."""
        return len(self.acceleration_noise)

    @property
    def reading_step(self) -> float:
        return self.step if self.average is None else _BETWEEN

    def means(self, readings: FloatArray) -> FloatArray:
        """Return the (rows, ...) means of (n, ...) readings, or of their derivatives."""
        return readings if self.average is None else self.average @ readings

    @property
    def stance_feet(self) -> tuple[int, int]:
        """Indices of the left and the right stance foot: the support line's direction runs from right to left.

        Of two feet on one side, the front one counts as left.
        """
        left, right = sorted(PAIRS[self.pair], key=lambda leg: leg[1])
        return LEG_NAMES.index(left), LEG_NAMES.index(right)


class StepSamples(LiftSamples):
    """Samples on two feet of one step of a walk."""

    averages_terms = True


L = TypeVar("L", bound=LiftSamples)


def read_lift(
    robot: RobotModel, legs: LegChains, recording: Recording, diagonal: str, stance: Stance, gyro_bias: FloatArray
) -> LiftSamples:
    """Read the samples on two feet of a lift trial.

    Args:
        robot: model of the robot.
        legs: leg chains of the robot.
        recording: recording with phases "rest", "unload" and "lower".
        diagonal: diagonal that the robot stood on.
        stance: nominal stance of the robot.
        gyro_bias: (3,) bias of the gyroscope, in the IMU frame [rad/s].

    Raises:
        RecordingError: the feet did not leave the floor, or samples are missing.
    """
    clock = stance.scale.time
    rest = recording.phase(Phase.REST)
    moving = recording.phase(Phase.REST, until=Phase.LOWER)
    imu, joints = moving.imu, moving.joints
    rest_acceleration = rest.imu.acceleration_in_imu.mean(axis=0)
    gyro = imu.angular_velocity_in_imu - gyro_bias
    path = attitudes(imu.time, gyro)
    up_in_imu = path.inv().apply(rest_acceleration / np.linalg.norm(rest_acceleration))
    up = at_times(joints.time, imu.time, up_in_imu @ np.array(robot.imu_in_base.rotation).T)
    window = _time_on_two_feet(legs, rest, moving, up, diagonal, _CLEAR * stance.scale.length)
    if window is None:
        raise RecordingError("the lifted feet did not leave the floor")
    noise = SensorNoise.of(rest, _white_noise, _LEAST)
    return on_two_feet(moving, diagonal, window, gyro, up_in_imu, noise, clock, _SHORTEST, LiftSamples)


@dataclass(frozen=True)
class SensorNoise:
    """Standard deviations of the white noise of the sensors.

    Attributes:
        encoder: noise of joint positions [rad].
        velocity: noise of joint velocities; infinite without velocities [rad/s].
        gyroscope: noise of an axis [rad/s].
        accelerometer: noise of an axis [m/s2].
    """

    encoder: float
    velocity: float
    gyroscope: float
    accelerometer: float

    @classmethod
    def of(cls, recording: Recording, spread: Callable[[FloatArray], float], least: SensorNoise) -> SensorNoise:
        """Estimate the noise of the sensors of a recording.

        Args:
            spread: function that returns the standard deviation of the white noise in (n, k) samples.
            least: lower limits.
        """
        joints, imu = recording.joints, recording.imu
        return cls(
            max(spread(joints.position), least.encoder),
            np.inf if joints.velocity is None else max(spread(joints.velocity), least.velocity),
            max(spread(imu.angular_velocity_in_imu), least.gyroscope),
            max(spread(imu.acceleration_in_imu), least.accelerometer),
        )


_LEAST = SensorNoise(2e-5, 2e-3, 2e-4, 5e-3)  # quantised or simulated sensors may be noise-free at rest


def on_two_feet(
    moving: Recording,
    pair: str,
    window: tuple[float, float],
    gyro: FloatArray,
    up_in_imu: FloatArray,
    noise: SensorNoise,
    clock: float,
    shortest: float,
    kind: type[L],
) -> L:
    """Return smoothed samples of an interval on two feet.

    Args:
        moving: recording of the interval and the time around it.
        pair: name of the two feet.
        window: first and last time with the other two off the floor [s].
        gyro: (n, 3) angular velocity at the IMU's samples, minus the bias [rad/s].
        up_in_imu: (n, 3) upward direction at the IMU's samples.
        noise: noise of the sensors.
        clock: time scale of the robot, relative to an A1.
        shortest: minimum time between the means at both ends, on an A1 [s].
        kind: type of the returned samples.

    Raises:
        RecordingError: samples are missing, or the time is too short.
    """
    imu, joints = moving.imu, moving.joints
    low, high = window[0] - _PAD * clock, window[1] + _PAD * clock
    joint_part = (joints.time >= low) & (joints.time <= high)
    imu_part = (imu.time >= low) & (imu.time <= high)
    streams = [joints.time[joint_part], imu.time[imu_part]]
    if min(map(len, streams)) <= _FEWEST:
        raise RecordingError("samples are missing")
    step = _STEP * clock
    start = max(window[0], *(float(stream[0]) for stream in streams)) + REACH
    end = min(window[1], *(float(stream[-1]) for stream in streams)) - REACH
    if end - start < shortest * clock:
        raise RecordingError(f"two feet were up for only {max(0.0, window[1] - window[0]):.2f} s")
    stride = max(1, round(step / _BETWEEN))
    step = stride * _BETWEEN if kind.averages_terms else step
    time: FloatArray = np.asarray(start + step * np.arange(int((end - start) / step + 1e-9) + 1), dtype=float)
    longest = max(float(np.diff(stream).max()) for stream in streams)
    if longest > _LONGEST_GAP * clock:
        raise RecordingError(f"samples are missing for {longest * 1000:.0f} ms")
    position = fit_spline(
        joints.time[joint_part], joints.position[joint_part], KNOT,
        None if joints.velocity is None else joints.velocity[joint_part], noise.encoder / noise.velocity,
        REACH,
    )  # fmt: skip
    readings = np.hstack([gyro, imu.acceleration_in_imu])[imu_part]  # same sample times: one fit
    of_imu = fit_spline(imu.time[imu_part], readings, KNOT, reach=REACH)
    imu_noise = of_imu.noise(time)
    turning_noise, force_noise = noise.gyroscope**2 * imu_noise, noise.accelerometer**2 * imu_noise
    if imu.pose_noise is not None:
        of_position, of_angle = imu.pose_noise[imu_part].mean(axis=0)
        force_noise = _noise_of_poses(time, of_position, 2)
        turning_noise = _noise_of_poses(time, of_angle, 1) if of_angle else turning_noise
    velocity_noise, average = noise.encoder**2 * position.noise(time, derivative=1), None
    if kind.averages_terms:
        average, time = _means_of_terms(time, stride)
        position, of_imu = replace(position, reach=0.0), replace(of_imu, reach=0.0)
    angular_velocity, acceleration = np.hsplit(of_imu.at(time), 2)
    return kind(
        pair,
        float(start),
        step,
        position.at(time),
        position.at(time, derivative=1),
        position.at(time, derivative=2),
        angular_velocity,
        of_imu.at(time, derivative=1)[:, :3],
        acceleration,
        at_times(time, imu.time, up_in_imu),
        velocity_noise,
        turning_noise,
        force_noise,
        average=average,
    )


def _means_of_terms(time: FloatArray, stride: int) -> tuple[FloatArray, FloatArray]:
    """Return the weights of means about (rows,) times, and the times of the readings that they take, `stride` to a row."""
    readings = np.arange(stride * (len(time) - 1) + len(_WEIGHTS))
    average = np.zeros((len(time), len(readings)))
    for row, weights in enumerate(average):
        weights[row * stride : row * stride + len(_WEIGHTS)] = _WEIGHTS
    return average, time[0] + _OFFSETS[0] + _BETWEEN * readings


def _noise_of_poses(time: FloatArray, density: float, derivative: int) -> FloatArray:
    """Return the (n, n) covariance of a smoothed derivative of poses with white noise of a density."""
    around = np.arange(time[0] - _PAD, time[-1] + _PAD, _POSE_PERIOD)
    spline = fit_spline(around, np.zeros((len(around), 1)), POSE_KNOT, reach=REACH)
    return density**2 / _POSE_PERIOD * spline.noise(time, derivative)


def _white_noise(samples: FloatArray) -> float:
    """Return the standard deviation of white noise in samples at rest, the median over columns."""
    return float(np.median(np.diff(samples, axis=0).std(axis=0)) / np.sqrt(2))


def attitudes(time: FloatArray, angular_velocity: FloatArray) -> Rotation:
    """Integrate an angular velocity to n rotations from a body's axes at each time to its axes at the first.

    Args:
        time: (n,) times [s].
        angular_velocity: (n, 3) angular velocity of the body, in its own axes [rad/s].
    """
    steps = Rotation.from_rotvec(
        (angular_velocity[1:] + angular_velocity[:-1]) / 2 * np.diff(time)[:, None]
    ).as_matrix()
    matrices = np.empty((len(time), 3, 3))
    matrices[0] = np.eye(3)
    for now, step, then in zip(matrices, steps, matrices[1:], strict=False):
        np.dot(now, step, out=then)  # twice as fast as "@"
    return Rotation.from_matrix(matrices)


def at_times(time: FloatArray, sampled: FloatArray, vectors: FloatArray) -> FloatArray:
    """Interpolate vectors linearly from their sample times to n times; returns (n, k)."""
    return np.column_stack([np.interp(time, sampled, vectors[:, column]) for column in range(vectors.shape[1])])


def _time_on_two_feet(
    legs: LegChains, rest: Recording, moving: Recording, up: FloatArray, diagonal: str, clear: float
) -> tuple[float, float] | None:
    """Return the first and last time of the longest interval with both lifted feet off the floor.

    Args:
        up: (n, 3) upward direction in the base frame, at each joint sample.
        clear: minimum height of a lifted foot above the floor [m].
    """
    time = moving.joints.time
    before = legs.feet(rest.joints.position.mean(axis=0)[None])[0] @ up[0]
    heights = np.einsum("nli,ni->nl", legs.feet(moving.joints.position), up) - before
    standing = np.array([leg in DIAGONALS[diagonal] for leg in LEG_NAMES])
    up_in_air = heights[:, ~standing].min(axis=1) > heights[:, standing].mean(axis=1) + clear
    runs = true_runs(up_in_air)
    if not runs:
        return None
    first, last = max(runs, key=lambda run: run[1] - run[0])
    return float(time[first]), float(time[last - 1])
