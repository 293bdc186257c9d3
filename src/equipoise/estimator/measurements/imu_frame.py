"""What an IMU is: mounted a little askew, with axes that have gains of their own and, in the gyroscope, directions.

The true angular velocity is (1 - E) times the one that is read: E has the gains' errors in its diagonal and the misalignment
beside it. An attitude R to that at rest, which was integrated from readings w, is off by the small rotation phi:

    R_true = exp(-phi x) R,    phi(t) = integral of R (E w + b),

with b what the gyroscope's bias differs by from that of the whole run.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from equipoise.conventions import FloatArray
from equipoise.estimator.measurements.leg_motion import cross_matrix
from equipoise.estimator.measurements.traced import Traced, contract, turned
from equipoise.estimator.unknowns import TracedValues

GYRO = ("gyro_drift", "gyro_gain", "gyro_misalignment")
ACCELEROMETER = ("accelerometer_bias", "accelerometer_drift", "accelerometer_gain")
_GAINS = np.eye(3)[:, :, None] * np.eye(3)
_MISALIGNMENT = np.zeros((3, 3, 6))
for _number, _place in enumerate(((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))):
    _MISALIGNMENT[(*_place, _number)] = 1.0
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
    by_tilt = rotation_imu_to_base @ cross_matrix(left_jacobian(vector).T) @ tilt
    whole = np.broadcast_to((rotation_imu_to_base @ tilt)[..., None], (3, 3, imu_tilt.value.shape[1]))
    return Traced(whole, (imu_tilt, lambda g: np.einsum("ijn,kij->kn", g, by_tilt)))


def specific_force(values: TracedValues, read: FloatArray, when: FloatArray | float = 0.0) -> Traced:
    """(3, n) specific force, of what the accelerometer reads [m/s2].

    Args:
        when: time since the middle of the run over the run's duration.
    """
    bias = values["accelerometer_bias"] + values["accelerometer_drift"] * when
    return (read - bias) / (1.0 + values["accelerometer_gain"])


def gyro_error(values: TracedValues) -> Traced:
    """(3, 3, n) E: what is read of an angular velocity beside the true one."""
    gains = contract("ijk,k...->ij...", _GAINS, values["gyro_gain"])
    return gains + contract("ijk,k...->ij...", _MISALIGNMENT, values["gyro_misalignment"])


def angular_velocity(values: TracedValues, read: FloatArray) -> Traced:
    """(3, n) angular velocity, or its rate of change, of what the gyroscope reads less its bias, in the IMU frame."""
    return read - turned(gyro_error(values), read)


def turned_by(error: Traced, turns: FloatArray) -> Traced:
    """(3, n) small rotations phi of attitudes.

    Args:
        turns: (3, 3, 3, n) integrals of R_ij w_k.
    """
    return contract("ijk...,jk...->i...", turns, error)


def turns_of(rotation: Rotation) -> FloatArray:
    """(3, 3, 3) integral of R_ij w_k of a turn about one axis, of the whole turn."""
    vector = rotation.as_rotvec()
    return left_jacobian(vector)[:, :, None] * vector


def mean_rotation(rotation: Rotation) -> FloatArray:
    """(3, 3) mean over time of a turn about one axis at a constant rate."""
    return left_jacobian(rotation.as_rotvec())


def left_jacobian(vector: FloatArray) -> FloatArray:
    """(3, 3) turn that a change of a rotation vector adds in front: sum of K^m / (m + 1)! (Sola 2018, equation 145)."""
    across = cross_matrix(vector)
    term = total = np.eye(3)
    for order in range(2, _TERMS):
        term = term @ across / order
        total = total + term
    return total
