"""IMU error model: mounting, biases, a gain per axis and misaligned gyroscope axes.

The true angular velocity is (1 - E) times the reading. E has the gain errors on its diagonal and the misalignment off it.
An attitude R relative to that at rest, integrated from readings w, has an error of the small rotation phi:

    R_true = exp(-phi x) R,    phi(t) = integral of R (E w + b),

where b is the gyroscope's bias minus that of the whole run.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
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


def mounting(rotation_imu_to_base: FloatArray, imu_tilt: FloatArray) -> FloatArray:
    """Return the actual (3, 3) rotation from the IMU frame to the base frame.

    Args:
        rotation_imu_to_base: (3, 3) nominal rotation from the IMU frame to the base frame.
        imu_tilt: (3,) rotation vector of the IMU in its nominal frame [rad].
    """
    return rotation_imu_to_base @ Rotation.from_rotvec(imu_tilt).as_matrix()


def traced_mounting(rotation_imu_to_base: FloatArray, imu_tilt: Traced) -> Traced:
    """Return the (3, 3, n) `mounting` in an equation, from a (3, n) input: one rotation vector, repeated per sample."""
    vector = imu_tilt.value[:, 0].copy()
    tilt = Rotation.from_rotvec(vector).as_matrix()
    by_tilt = rotation_imu_to_base @ cross_matrix(left_jacobian(vector).T) @ tilt
    whole = np.broadcast_to((rotation_imu_to_base @ tilt)[..., None], (3, 3, imu_tilt.value.shape[1]))
    return Traced(whole, (imu_tilt, lambda g: np.einsum("ijn,kij->kn", g, by_tilt)))


def specific_force(values: TracedValues, read: FloatArray, when: FloatArray | float = 0.0) -> Traced:
    """Return the (3, n) specific force from accelerometer readings [m/s2].

    Args:
        when: time since the middle of the run, divided by the run's duration.
    """
    bias = values["accelerometer_bias"] + values["accelerometer_drift"] * when
    return (read - bias) / (1.0 + values["accelerometer_gain"])


def gyro_error(values: TracedValues) -> Traced:
    """Return the (3, 3, n) error matrix E of the gyroscope."""
    gains = contract("ijk,k...->ij...", _GAINS, values["gyro_gain"])
    return gains + contract("ijk,k...->ij...", _MISALIGNMENT, values["gyro_misalignment"])


def angular_velocity(values: TracedValues, read: FloatArray) -> Traced:
    """Return the (3, n) angular velocity, or its rate, in the IMU frame, from gyroscope readings minus their bias."""
    return read - turned(gyro_error(values), read)


def turned_by(error: Traced, turns: FloatArray) -> Traced:
    """Return (3, n) small rotations phi of attitudes.

    Args:
        turns: (3, 3, 3, n) integrals of R_ij w_k.
    """
    return contract("ijk...,jk...->i...", turns, error)


def turns_of(rotation: Rotation) -> FloatArray:
    """Return the (3, 3, 3) integral of R_ij w_k over a rotation about one axis."""
    vector = rotation.as_rotvec()
    return left_jacobian(vector)[:, :, None] * vector


def mean_rotation(rotation: Rotation) -> FloatArray:
    """Return the (3, 3) mean over time of a rotation about one axis at a constant rate."""
    return left_jacobian(rotation.as_rotvec())


def left_jacobian(vector: FloatArray) -> FloatArray:
    """Return the (3, 3) left Jacobian of a rotation vector (Sola 2018, equation 145)."""
    return np.array(pin.Jexp3(vector)).T
