"""IMU samples from the pose of the base, for logs of motion capture or a state estimator without an accelerometer.

Quintic splines through position and quaternion are differentiated. Between two knots they have one free coefficient, so that
samples little closer than knots carry independent noise, as those of an IMU: differences of samples then show this noise to
the estimator, which weights the samples by it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from equipoise.conventions import GRAVITY, FloatArray
from equipoise.errors import RecordingError
from equipoise.estimator.measurements.smoothing import fit_spline
from equipoise.logs.repeats import repeated_rows
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import nominal_stance

# [s] on an A1. Between samples there may be 20 ms, and motions on two feet have up to 20 Hz.
_KNOT, _STEP = 0.018, 0.012
_FEWEST = 2.0  # poses per knot
_LONGEST_GAP, _SHORTEST = 3, 20  # knots
_ENDS = 2  # knots at either end of a piece, where second derivatives are least accurate
_UNIT = 0.02  # by which a quaternion's norm may differ from one


@dataclass(frozen=True, eq=False)
class DerivedImu:
    """Samples of an IMU at the place of the robot's, computed from poses of the base.

    Attributes:
        time: (n,) times [s].
        angular_velocity_in_imu: (n, 3) angular velocity [rad/s].
        acceleration_in_imu: (n, 3) specific force [m/s2].
        position_noise, angle_noise: standard deviations of the poses about their spline, per axis [m], [rad].
        acceleration_noise: resulting standard deviation of the specific force, per axis [m/s2].
    """

    time: FloatArray
    angular_velocity_in_imu: FloatArray
    acceleration_in_imu: FloatArray
    position_noise: float
    angle_noise: float
    acceleration_noise: float

    @property
    def message(self) -> str:
        """Return a message on the source of the samples, and their noise."""
        return (
            f"specific force from the base's pose, with noise of {self.acceleration_noise:.2g} m/s2; the poses have noise of "
            f"{1e3 * self.position_noise:.2g} mm and {1e3 * self.angle_noise:.2g} mrad about a spline"
        )


def imu_of_poses(robot: RobotModel, time: FloatArray, position: FloatArray, quat_wxyz: FloatArray) -> DerivedImu:
    """Return the samples that an IMU at the place of the robot's would have.

    Args:
        time: (n,) times of the poses [s]; those that do not increase are left out, as are poses that repeat.
        position: (n, 3) positions of the base's origin in a world whose z axis points up [m]; NaN where there is none.
        quat_wxyz: (n, 4) rotations of the base's axes to the world's.

    Raises:
        RecordingError: the quaternions are not normalized, or there are too few poses without a gap.
    """
    time, position, quat_wxyz = _valid(time, position, quat_wxyz)
    rotation = Rotation.from_quat(np.roll(quat_wxyz, -1, axis=1))
    position = position + rotation.apply(np.array(robot.imu_in_base.translation))
    imu = (rotation * Rotation.from_matrix(np.array(robot.imu_in_base.rotation))).as_quat()
    turns = np.sign((imu[1:] * imu[:-1]).sum(axis=1))  # q and -q are the same rotation
    imu[1:] *= np.cumprod(np.where(turns == 0, 1.0, turns))[:, None]
    clock = nominal_stance(robot).scale.time
    knot = max(_KNOT * clock, _FEWEST * float(np.median(np.diff(time))))
    pieces = np.split(np.arange(len(time)), np.flatnonzero(np.diff(time) > _LONGEST_GAP * knot) + 1)
    found = [
        _differentiated(time[rows], position[rows], imu[rows], knot, knot * _STEP / _KNOT)
        for rows in pieces
        if time[rows[-1]] - time[rows[0]] > _SHORTEST * knot
    ]
    if not found:
        raise RecordingError(
            f"the log has {len(time)} poses of the base, and none for {_SHORTEST * knot:.2f} s without a gap"
        )
    times, turning, force = (np.concatenate(part) for part in zip(*(samples for samples, _ in found), strict=True))
    position_noise, angle_noise, noise = np.sqrt(np.median([levels for _, levels in found], axis=0)).tolist()
    return DerivedImu(times, turning, force, position_noise, angle_noise, noise)


def _valid(time: FloatArray, position: FloatArray, quat_wxyz: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the usable poses."""
    poses = np.column_stack([position, quat_wxyz])
    rows = np.flatnonzero(np.isfinite(time) & np.isfinite(poses).all(axis=1))
    if len(rows) < 2:
        raise RecordingError(f"the log has {len(rows)} poses of the base; at least 20 in a second are needed")
    rows = rows[np.diff(np.maximum.accumulate(time[rows]), prepend=-np.inf) > 0]
    rows = rows[~repeated_rows([poses[rows]])]
    norm = np.linalg.norm(quat_wxyz[rows], axis=1)
    if abs(usual := float(np.median(norm)) - 1) > _UNIT:
        raise RecordingError(f"the base's quaternions have a norm of {1 + usual:.3g}; it must be 1")
    rows = rows[np.abs(norm - 1) < _UNIT]
    return time[rows], position[rows], quat_wxyz[rows]


def _differentiated(
    time: FloatArray, position: FloatArray, quat_xyzw: FloatArray, knot: float, step: float
) -> tuple[tuple[FloatArray, FloatArray, FloatArray], tuple[float, float, float]]:
    """Return times, angular velocities and specific forces of poses without a gap, and variances of the noise.

    With a quaternion q of the body's axes, its angular velocity is twice the vector part of the conjugate of q times dq/dt.
    """
    fit = fit_spline(time, np.hstack([position, quat_xyzw]), knot)
    at = np.arange(time[0] + _ENDS * knot, time[-1] - _ENDS * knot, step)
    quaternion, rate = fit.at(at)[:, 3:], fit.at(at, derivative=1)[:, 3:]
    vector, scalar = quaternion[:, :3], quaternion[:, 3:]
    turning = 2 * (scalar * rate[:, :3] - rate[:, 3:] * vector - np.cross(vector, rate[:, :3]))
    turning /= (quaternion**2).sum(axis=1, keepdims=True)
    force = fit.at(at, derivative=2)[:, :3] + np.array([0.0, 0.0, GRAVITY])
    left = np.hstack([position, quat_xyzw]) - fit.at(time)
    degrees_of_freedom = max(len(time) - fit.factor.shape[1], 1)
    of_position, of_quaternion = ((part**2).sum() / degrees_of_freedom / 3 for part in np.hsplit(left, [3]))
    middle = fit.noise(at[len(at) // 2 :][:1], derivative=2)[0, 0]
    samples = at, turning, Rotation.from_quat(quaternion).inv().apply(force)
    return samples, (of_position, 4 * of_quaternion, middle * of_position)
