"""Angular velocity from a fused orientation, for logs without a gyroscope.

It is the weaker of the two: the filter's output is smoothed, delayed and pulled towards the accelerometer's vertical, which
is wrong while a body tips.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError
from equipoise.logs.repeats import increasing

_UNIT = 0.02  # by which a quaternion's norm may differ from one
# Median angle between the orientation's vertical and the accelerometer's: filters agree within a degree or two.
_LEVEL = np.radians(15)
# Smaller angles are not significant; another order that leaves less than this fraction is better, and not by chance.
_SIGNIFICANT, _BETTER = np.radians(1), 0.6


def angular_velocity_of(time: FloatArray, quat_wxyz: FloatArray, acceleration_in_imu: FloatArray) -> FloatArray:
    """Return (n, 3) angular velocity in the IMU's axes, over two steps each [rad/s]; NaN where it is not determined.

    Args:
        time: (n,) times [s].
        quat_wxyz: (n, 4) orientation of the IMU in the world frame.
        acceleration_in_imu: (n, 3) specific force [m/s2], which verifies the orientation.

    Raises:
        RecordingError: the quaternions are not normalized, in another order, or of the inverse rotation.
    """
    valid = np.isfinite(time) & np.isfinite(quat_wxyz).all(axis=1) & np.isfinite(acceleration_in_imu).all(axis=1)
    norm = np.linalg.norm(quat_wxyz, axis=1)
    usual = float(np.median(norm[valid])) if valid.any() else 1.0
    if abs(usual - 1) > _UNIT:
        raise RecordingError(f"the orientation's quaternions have a norm of {usual:.3g}; it must be 1, and w the first")
    valid &= np.abs(norm - 1) < _UNIT  # some drivers log zeros until their filter runs
    rows = increasing(np.where(valid, time, np.nan))
    if len(rows) < 3:
        raise RecordingError(
            f"the log has no gyroscope, and its orientation is valid in {len(rows)} samples: log the raw gyroscope"
        )
    _check_orientation(quat_wxyz[rows], acceleration_in_imu[rows])
    found = np.full((len(time), 3), np.nan)
    found[rows] = _angular_velocity(time[rows], _rotations(quat_wxyz[rows]))
    return found


def _angular_velocity(time: FloatArray, rotation: Rotation) -> FloatArray:
    angle = (rotation[:-1].inv() * rotation[1:]).as_rotvec()
    steps = np.diff(time)
    total = np.concatenate([angle[:1], angle[:-1] + angle[1:], angle[-1:]])
    return total / np.concatenate([steps[:1], steps[:-1] + steps[1:], steps[-1:]])[:, None]


def _check_orientation(quat_wxyz: FloatArray, acceleration_in_imu: FloatArray) -> None:
    angle = angle_from_up(quat_wxyz, acceleration_in_imu)
    turned = np.roll(quat_wxyz, 1, axis=1)  # as if w were the last
    inverse = quat_wxyz * [1, -1, -1, -1]
    cures = {"is w the last?": turned, "is it the inverse rotation?": inverse}
    left, question = min((angle_from_up(cured, acceleration_in_imu), question) for question, cured in cures.items())
    # For a robot that hardly leans and faces forward, the vertical is almost right in the wrong order, too.
    if angle < _LEVEL and not (angle > _SIGNIFICANT and left < _BETTER * angle):
        return
    raise RecordingError(
        f"the orientation's vertical is {np.degrees(angle):.0f} deg off the accelerometer's: it must be that of the IMU in "
        f"the world, z up, quaternions w x y z{f' ({question})' if left < min(_LEVEL, angle) else ''}"
    )


def quaternions_of(angles: FloatArray) -> FloatArray:
    """Return (n, 4) quaternions, w first, of (n, 3) roll, pitch and yaw [rad]."""
    return np.roll(Rotation.from_euler("ZYX", angles[:, ::-1]).as_quat(), 1, axis=1)


def angle_from_up(quat_wxyz: FloatArray, acceleration_in_imu: FloatArray) -> float:
    """Return the median angle between the vertical of (n, 4) orientations and of (n, 3) specific force [rad]."""
    up = acceleration_in_imu / np.maximum(np.linalg.norm(acceleration_in_imu, axis=1), 1e-9)[:, None]
    vertical = _rotations(quat_wxyz).inv().apply(np.array([0.0, 0.0, 1.0]))
    return float(np.median(np.arccos(np.clip((vertical * up).sum(axis=1), -1, 1))))


def _rotations(quat_wxyz: FloatArray) -> Rotation:
    return Rotation.from_quat(np.roll(quat_wxyz, -1, axis=1))  # which wants w last
