"""IMU samples from the pose of the base, for logs of motion capture or a state estimator without an accelerometer.

Quintic splines through position and quaternion are differentiated. The noise of the poses, by their residuals, determines
the weights in the estimate: differentiation amplifies it at high frequencies.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from equipoise.conventions import GRAVITY, FloatArray
from equipoise.errors import RecordingError
from equipoise.estimator.measurements.lift_samples import POSE_KNOT
from equipoise.estimator.measurements.smoothing import fit_spline
from equipoise.logs.raw_log import RawImu
from equipoise.logs.repeats import increasing, repeated_rows
from equipoise.robot.model import RobotModel

_STEP = 0.008  # [s] between samples without a gyroscope
_FEWEST = 2.0  # poses per knot
_LONGEST_GAP, _SHORTEST, _ENDS = 3, 20, 2  # knots; second derivatives are least accurate at the ends of a piece
_UNIT = 0.02  # by which a quaternion's norm may differ from one


def imu_of_poses(
    robot: RobotModel,
    time: FloatArray,
    position: FloatArray,
    quat_wxyz: FloatArray,
    angular_velocity_in_imu: FloatArray | None = None,
) -> tuple[RawImu, str]:
    """Return the samples that an IMU at the place of the robot's would have, and a message on their noise.

    Args:
        time: (n,) times of the poses [s]; those that do not increase are left out, as are poses that repeat.
        position: (n, 3) positions of the base's origin in a world whose z axis points up [m]; NaN where there is none.
        quat_wxyz: (n, 4) rotations of the base's axes to the world's.
        angular_velocity_in_imu: (n, 3) readings of a gyroscope [rad/s], at whose increasing times the samples are, or None.

    Raises:
        RecordingError: the quaternions are not normalized, or there are too few poses without a gap.
    """
    times, position, quat_wxyz = _valid(time, position, quat_wxyz)
    rotation = Rotation.from_quat(np.roll(quat_wxyz, -1, axis=1))
    position = position + rotation.apply(np.array(robot.imu_in_base.translation))
    imu = (rotation * Rotation.from_matrix(np.array(robot.imu_in_base.rotation))).as_quat()
    turns = np.sign((imu[1:] * imu[:-1]).sum(axis=1))  # q and -q are the same rotation
    imu[1:] *= np.cumprod(np.where(turns == 0, 1.0, turns))[:, None]
    period = float(np.median(np.diff(times)))
    if period > (slowest := POSE_KNOT / _FEWEST):
        raise RecordingError(
            f"the log has {1 / period:.0f} poses of the base a second; at least {1 / slowest:.0f} are needed: record faster"
        )
    rows = increasing(time)
    stamps = time[rows]
    found: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    variances: list[tuple[float, float]] = []
    for piece in np.split(np.arange(len(times)), np.flatnonzero(np.diff(times) > _LONGEST_GAP * POSE_KNOT) + 1):
        start, end = (float(times[row]) + later * POSE_KNOT for row, later in ((piece[0], _ENDS), (piece[-1], -_ENDS)))
        if end - start > _SHORTEST * POSE_KNOT:
            at = stamps[(stamps >= start) & (stamps <= end)]
            if angular_velocity_in_imu is None:
                at = np.arange(start, end, _STEP)
            samples, noise = _differentiated(times[piece], position[piece], imu[piece], at)
            found.append(samples)
            variances.append(noise)
    if not found:
        needed = (_SHORTEST + 2 * _ENDS) * POSE_KNOT
        raise RecordingError(f"no {needed:.1f} s of the base's poses are without a gap; record without dropouts")
    at, turning, force = (np.concatenate(part) for part in zip(*found, strict=True))
    of_position, of_angle = np.sqrt(np.median(variances, axis=0)).tolist()
    message = (
        f"no accelerometer: specific force from the base's pose, which has noise of {1e3 * of_position:.2g} mm and "
        f"{1e3 * of_angle:.2g} mrad about a spline"
    )
    if angular_velocity_in_imu is not None:
        turning = angular_velocity_in_imu[rows[np.searchsorted(stamps, at)]]
        of_angle = 0.0
    density = np.sqrt(period) * np.array([of_position, of_angle])
    return RawImu(at, turning, force, pose_noise=np.tile(density, (len(at), 1))), message


def _valid(time: FloatArray, position: FloatArray, quat_wxyz: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the usable poses."""
    poses = np.column_stack([position, quat_wxyz])
    rows = increasing(np.where(np.isfinite(poses).all(axis=1), time, np.nan))
    if len(rows) < 2:
        raise RecordingError(f"the log has {len(rows)} poses of the base, and needs some seconds of them")
    rows = rows[~repeated_rows([poses[rows]])]
    norm = np.linalg.norm(quat_wxyz[rows], axis=1)
    if abs(usual := float(np.median(norm)) - 1) > _UNIT:
        raise RecordingError(f"the base's quaternions have a norm of {1 + usual:.3g}; it must be 1")
    rows = rows[np.abs(norm - 1) < _UNIT]
    return time[rows], position[rows], quat_wxyz[rows]


def _differentiated(
    time: FloatArray, position: FloatArray, quat_xyzw: FloatArray, at: FloatArray
) -> tuple[tuple[FloatArray, FloatArray, FloatArray], tuple[float, float]]:
    """Return times, angular velocities and specific forces from poses without a gap, and variances of position and angle.

    With a quaternion q of the body's axes, its angular velocity is twice the vector part of the conjugate of q times dq/dt.
    """
    poses = np.hstack([position, quat_xyzw])
    fit = fit_spline(time, poses, POSE_KNOT)
    quaternion, rate = fit.at(at)[:, 3:], fit.at(at, derivative=1)[:, 3:]
    vector, scalar = quaternion[:, :3], quaternion[:, 3:]
    turning = 2 * (scalar * rate[:, :3] - rate[:, 3:] * vector - np.cross(vector, rate[:, :3]))
    turning /= (quaternion**2).sum(axis=1, keepdims=True)
    force = fit.at(at, derivative=2)[:, :3] + np.array([0.0, 0.0, GRAVITY])
    degrees_of_freedom = 3 * max(len(time) - fit.factor.shape[1], 1)  # a quaternion has three, and half the angle
    of_position, of_quaternion = ((part**2).sum() / degrees_of_freedom for part in np.hsplit(poses - fit.at(time), [3]))
    return (at, turning, Rotation.from_quat(quaternion).inv().apply(force)), (of_position, 4 * of_quaternion)
