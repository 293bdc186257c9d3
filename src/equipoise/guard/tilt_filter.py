"""Complementary filter of the vertical direction, for the guard, not for the estimate."""

from __future__ import annotations

import math
from collections.abc import Sequence

from equipoise.conventions import GRAVITY, FloatArray
from equipoise.platform.platform import RobotState
from equipoise.robot.floor import Vector

_TIME = 0.5  # [s] with which the accelerometer corrects the gyroscope
_GRAVITY_TOLERANCE = 2.5  # [m/s2]; readings beyond it contain other accelerations


class TiltFilter:
    """Complementary filter of gyroscope and accelerometer. It uses plain floats: NumPy takes five times as long for three.

    Args:
        rotation_imu_to_base: (3, 3) rotation matrix from IMU axes to base axes.

    Attributes:
        tilt: angle of the base's z axis from up [rad]; 0 before the first sample.
        largest: largest tilt so far [rad].
    """

    def __init__(self, rotation_imu_to_base: FloatArray) -> None:
        self._base_axes_in_imu: list[list[float]] = rotation_imu_to_base.tolist()
        self._up: Vector | None = None
        self._time = 0.0
        self.tilt = self.largest = 0.0

    def update(self, sample: RobotState) -> float:
        """Add a sample; return the tilt [rad]."""
        ax, ay, az = sample.acceleration_in_imu.tolist()
        size = math.hypot(ax, ay, az)
        plausible = abs(size - GRAVITY) < _GRAVITY_TOLERANCE
        if self._up is None:
            if not plausible:
                return self.tilt
            x, y, z = ax, ay, az
        else:
            step = min(max(sample.time - self._time, 0.0), _TIME)
            x, y, z = _turned(self._up, sample.angular_velocity_in_imu.tolist(), step)
            if plausible:
                share = step / _TIME
                x, y, z = (x + share * (ax / size - x), y + share * (ay / size - y), z + share * (az / size - z))
        length = max(math.hypot(x, y, z), 1e-9)
        self._up = x, y, z = x / length, y / length, z / length
        self._time = sample.time
        self.tilt = _angle(self._up, self._base_axes_in_imu[2])
        self.largest = max(self.largest, self.tilt)
        return self.tilt

    def lean(self, floor_in_base: Vector) -> float:
        """Return the base's angle from a level floor under its feet, or from level if that is smaller [rad].

        The second case is a robot that lies on its belly.

        Args:
            floor_in_base: (3,) upward unit normal of the floor, in base axes.
        """
        if self._up is None:
            return 0.0
        nx, ny, nz = floor_in_base
        normal = [nx * x + ny * y + nz * z for x, y, z in zip(*self._base_axes_in_imu, strict=True)]
        return min(self.tilt, _angle(self._up, normal))


def _angle(a: Sequence[float], b: Sequence[float]) -> float:
    """Return the angle between two unit vectors [rad]."""
    return math.acos(min(max(a[0] * b[0] + a[1] * b[1] + a[2] * b[2], -1.0), 1.0))


def _turned(up: Vector, rate: list[float], step: float) -> Vector:
    """Return a fixed world direction in a frame that has turned at a rate [rad/s] for a step [s]."""
    (x, y, z), (wx, wy, wz) = up, rate
    return x + step * (y * wz - z * wy), y + step * (z * wx - x * wz), z + step * (x * wy - y * wx)
