"""Which way is up, from the gyroscope and slowly from the accelerometer: for a guard, not for an estimate."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from equipoise.platforms.platform import RobotState

FloatArray = NDArray[np.float64]

_TIME = 0.5  # [s] with which the accelerometer corrects the gyroscope
_GRAVITY, _BELIEVED = 9.81, 2.5  # [m/s2]; an accelerometer that reads something else feels a push, not gravity


class TiltWatch:
    """A complementary filter.

    Args:
        rotation_imu_to_base: (3, 3).

    Attributes:
        tilt: of the base's z axis from up [rad].
        largest: so far.
    """

    def __init__(self, rotation_imu_to_base: FloatArray) -> None:
        self._base_z_in_imu = rotation_imu_to_base[2]
        self._up: FloatArray | None = None
        self._time = 0.0
        self.tilt = self.largest = 0.0

    def feel(self, sample: RobotState) -> float:
        """Take a sample in; returns the tilt [rad]."""
        size = float(np.linalg.norm(sample.acceleration))
        if self._up is None:
            self._up = sample.acceleration / max(size, 1e-6)
        else:
            step = min(max(sample.time - self._time, 0.0), _TIME)
            self._up = self._up + step * _cross(self._up, sample.angular_velocity)
            if abs(size - _GRAVITY) < _BELIEVED:
                self._up = self._up + step / _TIME * (sample.acceleration / size - self._up)
            self._up = self._up / np.linalg.norm(self._up)
        self._time = sample.time
        self.tilt = float(np.arccos(np.clip(self._up @ self._base_z_in_imu, -1, 1)))
        self.largest = max(self.largest, self.tilt)
        return self.tilt


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """NumPy's own takes 20 us."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
