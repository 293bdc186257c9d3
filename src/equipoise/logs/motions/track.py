"""A long recording on one clock: means of joint and IMU samples over short, equal steps.

Joints and IMU may have different rates and uneven samples: a mean over a step is a difference of the signal's integral.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.estimator.measurements.smoothing import noise_in_motion
from equipoise.recording.recording import Recording
from equipoise.robot.model import RobotModel

_AT_ONCE = 4096  # [steps]
STEP = 0.01
"""[s] on an A1: short against every motion of interest, long enough to average a fast log's noise."""


@dataclass(frozen=True, eq=False)
class Track:
    """Means of a recording over n equal steps.

    Attributes:
        time: (n,) times of the steps' middles [s].
        step: duration of a step [s].
        joint_position: (n, nj) joint positions [rad].
        angular_velocity_in_base: (n, 3) angular velocity of the base as sensed, in its own axes [rad/s].
        acceleration_in_base: (n, 3) specific force at the IMU, in base axes [m/s2].
        joint_torque: (n, nj) joint torques [Nm], or None.
        gyro_noise: standard deviation of the steps' angular velocity, per axis [rad/s].
        encoder_noise: standard deviation of the steps' joint positions [rad].
    """

    time: FloatArray
    step: float
    joint_position: FloatArray
    angular_velocity_in_base: FloatArray
    acceleration_in_base: FloatArray
    joint_torque: FloatArray | None
    gyro_noise: float
    encoder_noise: float

    @classmethod
    def of(cls, robot: RobotModel, recording: Recording, time_scale: float) -> Track:
        """Make a track of the time that joints and IMU share; empty if that is shorter than two steps.

        Args:
            time_scale: factor on times, of the robot's scale; one on an A1.
        """
        joints, imu, step = recording.joints, recording.imu, STEP * time_scale
        start, end = max(joints.time[0], imu.time[0]), min(joints.time[-1], imu.time[-1])
        count = max(1, int((end - start) / step + 1e-9) + 1)
        edges: FloatArray = np.asarray(start + step * np.arange(count), dtype=float)
        to_base = np.array(robot.imu_in_base.rotation).T
        return cls(
            (edges[1:] + edges[:-1]) / 2,
            step,
            means(joints.time, joints.position, edges),
            means(imu.time, imu.angular_velocity_in_imu, edges) @ to_base,
            means(imu.time, imu.acceleration_in_imu, edges) @ to_base,
            None if joints.torque is None else means(joints.time, joints.torque, edges),
            _noise_of_means(imu.time, imu.angular_velocity_in_imu, step),
            _noise_of_means(joints.time, joints.position, step),
        )

    def without_bias(self, gyro_bias: FloatArray) -> Track:
        """Return the track with a (3,) bias in base axes subtracted from the angular velocity [rad/s]."""
        return replace(self, angular_velocity_in_base=self.angular_velocity_in_base - gyro_bias)

    def part(self, steps: slice) -> Track:
        """Return some of the steps."""
        values: dict[str, Any] = vars(self)
        return replace(self, **{name: each[steps] for name, each in values.items() if isinstance(each, np.ndarray)})

    def indices(self, start: float, end: float) -> slice:
        """Return the steps whose middles are within start <= time < end [s]."""
        first, last = np.searchsorted(self.time, [start, end])
        return slice(int(first), int(last))


def at_once(count: int) -> list[slice]:
    """Return slices of some thousand steps: the arrays of `LegChains.motion` for many minutes would fill the memory."""
    return [slice(first, first + _AT_ONCE) for first in range(0, count, _AT_ONCE)]


def integral(time: FloatArray, values: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """Return a function that returns the (n, k) integrals of (m, k) linearly interpolated samples up to n times."""
    # Contiguous, as `interp` would make them each time.
    integrals, half_steps = np.zeros(values.T.shape), np.diff(time) / 2
    np.cumsum((values[1:] + values[:-1]).T * half_steps, axis=1, out=integrals[:, 1:])

    def at(when: FloatArray) -> FloatArray:
        columns: list[FloatArray] = [np.interp(when, time, column) for column in integrals]
        return np.column_stack(columns)

    return at


def means(time: FloatArray, values: FloatArray, edges: FloatArray) -> FloatArray:
    """Return (n - 1, k) means of (m, k) samples between n edges, which should not be closer together than the samples."""
    # Column by column, to save memory.
    parts = [np.diff(integral(time, column[:, None])(edges), axis=0) for column in values.T]
    return np.hstack(parts) / np.diff(edges)[:, None]


def _noise_of_means(time: FloatArray, values: FloatArray, step: float) -> float:
    """Return the std of white noise in a step's mean: the median over columns, without motion."""
    if len(time) < 8:
        return 0.0
    return noise_in_motion(values) / np.sqrt(max(1.0, step / float(np.median(np.diff(time)))))
