"""From the IMU's axes to the base's, for an IMU that is mounted a little askew."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from equipoise.conventions import FloatArray
from equipoise.precise.measurements.leg_motion import cross_matrix
from equipoise.precise.measurements.traced import Traced

_TERMS = 20  # of the series below: exact to rounding up to a turn of two radians


def mounting(rotation_imu_to_base: FloatArray, imu_tilt: FloatArray) -> FloatArray:
    """(3, 3) the IMU's rotation to the base as it is.

    Args:
        rotation_imu_to_base: (3, 3) rotation from the IMU frame to the base frame, as it should be.
        imu_tilt: (3,) rotation vector of the IMU in the frame where it should be [rad].
    """
    return rotation_imu_to_base @ Rotation.from_rotvec(imu_tilt).as_matrix()


def traced_mounting(rotation_imu_to_base: FloatArray, imu_tilt: Traced) -> Traced:
    """(3, 3, n) the same in an equation, of a (3, n) input: one rotation vector, laid out once per sample."""
    vector = imu_tilt.value[:, 0].copy()
    tilt = Rotation.from_rotvec(vector).as_matrix()
    turned = np.array([cross_matrix(column) for column in _left_jacobian(vector).T])
    by_tilt = rotation_imu_to_base @ turned @ tilt
    whole = np.broadcast_to((rotation_imu_to_base @ tilt)[..., None], (3, 3, imu_tilt.value.shape[1]))
    return Traced(whole, (imu_tilt, lambda g: np.einsum("ijn,kij->kn", g, by_tilt)))


def _left_jacobian(vector: FloatArray) -> FloatArray:
    """(3, 3) turn that a change of a rotation vector adds in front: sum of K^m / (m + 1)! (Sola 2018, equation 145)."""
    across = cross_matrix(vector)
    term = total = np.eye(3)
    for order in range(2, _TERMS):
        term = term @ across / order
        total = total + term
    return total
