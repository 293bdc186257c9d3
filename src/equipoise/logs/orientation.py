"""A fused orientation where a log has no gyroscope: how it turns is the angular velocity.

It is the weaker sensor of the two: what a filter made of gyroscope and accelerometer is smooth and late, and pushed towards
the accelerometer's idea of up, which is wrong while a body tips.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError

_UNIT = 0.02  # by which a quaternion's norm may differ from one
# Between the orientation's up and the accelerometer's, the median: filters agree to a degree or two.
_LEVEL = np.radians(15)
# Less says nothing; another order that leaves less than this part of it is better, and not by chance.
_TOLD, _BETTER = np.radians(1), 0.6


def angular_velocity_of(time: FloatArray, quat_wxyz: FloatArray, acceleration_in_imu: FloatArray) -> FloatArray:
    """(n, 3) angular velocity in the IMU's axes, over two steps each [rad/s]; not a number where there is none.

    Args:
        time: (n,) times [s].
        quat_wxyz: (n, 4) orientation of the IMU in the room.
        acceleration_in_imu: (n, 3) specific force [m/s2], which says whether it is one.

    Raises:
        RecordingError: the quaternions are none, or are in another order or of the inverse rotation.
    """
    known = np.isfinite(time) & np.isfinite(quat_wxyz).all(axis=1) & np.isfinite(acceleration_in_imu).all(axis=1)
    norm = np.linalg.norm(quat_wxyz, axis=1)
    usual = float(np.median(norm[known])) if known.any() else 1.0
    if abs(usual - 1) > _UNIT:
        raise RecordingError(f"the orientation's quaternions have a norm of {usual:.3g}; it must be 1, and w the first")
    known &= np.abs(norm - 1) < _UNIT  # some drivers log zeros until their filter runs
    latest = np.maximum.accumulate(np.where(known, time, -np.inf))
    known[1:] &= time[1:] > latest[:-1]
    if known.sum() < 3:
        raise RecordingError(
            f"the log has no gyroscope, and its orientation is known in {known.sum()} samples: log the raw one"
        )
    _check_orientation(quat_wxyz[known], acceleration_in_imu[known])
    found = np.full((len(time), 3), np.nan)
    found[known] = _turning(time[known], _rotations(quat_wxyz[known]))
    return found


def _turning(time: FloatArray, rotation: Rotation) -> FloatArray:
    angle = (rotation[:-1].inv() * rotation[1:]).as_rotvec()
    steps = np.diff(time)
    total = np.concatenate([angle[:1], angle[:-1] + angle[1:], angle[-1:]])
    return total / np.concatenate([steps[:1], steps[:-1] + steps[1:], steps[-1:]])[:, None]


def _check_orientation(quat_wxyz: FloatArray, acceleration_in_imu: FloatArray) -> None:
    angle = angle_from_up(quat_wxyz, acceleration_in_imu)
    turned = np.roll(quat_wxyz, 1, axis=1)  # as if w were the last
    inverse = quat_wxyz * [1, -1, -1, -1]
    cures = {"is w the last?": turned, "is it of the room in the IMU?": inverse}
    left, question = min((angle_from_up(cured, acceleration_in_imu), question) for question, cured in cures.items())
    # Of a robot that hardly leans and faces forward, up is almost right in the wrong order, too.
    if angle < _LEVEL and not (angle > _TOLD and left < _BETTER * angle):
        return
    raise RecordingError(
        f"the orientation's idea of up is {np.degrees(angle):.0f} deg off the accelerometer's: it must be that of the IMU in "
        f"the room, z up, quaternions w x y z{f' ({question})' if left < min(_LEVEL, angle) else ''}"
    )


def quaternions_of(angles: FloatArray) -> FloatArray:
    """(n, 4) quaternions, w first, of (n, 3) roll, pitch and yaw [rad]."""
    return np.roll(Rotation.from_euler("ZYX", angles[:, ::-1]).as_quat(), 1, axis=1)


def angle_from_up(quat_wxyz: FloatArray, acceleration_in_imu: FloatArray) -> float:
    """Median angle between (n, 4) orientations' idea of up and that of (n, 3) specific force [rad]."""
    up = acceleration_in_imu / np.maximum(np.linalg.norm(acceleration_in_imu, axis=1), 1e-9)[:, None]
    said = _rotations(quat_wxyz).inv().apply(np.array([0.0, 0.0, 1.0]))
    return float(np.median(np.arccos(np.clip((said * up).sum(axis=1), -1, 1))))


def _rotations(quat_wxyz: FloatArray) -> Rotation:
    return Rotation.from_quat(np.roll(quat_wxyz, -1, axis=1))  # which wants w last
