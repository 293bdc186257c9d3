"""Motion of the base estimated from encoders and IMU alone, accurate enough for display.

The gyroscope gives attitude and heading. The accelerometer corrects the attitude, and the gyroscope's bias is estimated at
rest. For the position, standing feet roll on a level floor without slip. Each foot is weighted by its height above the lowest
foot, along gravity, and by its load according to the joint torques.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.spatial.transform import Rotation

from equipoise.conventions import GRAVITY, FloatArray
from equipoise.errors import RecordingError
from equipoise.estimator.measurements.leg_motion import LegChains, cross
from equipoise.estimator.measurements.lift_samples import at_times
from equipoise.recording.recording import ImuStream, JointStream, Recording
from equipoise.robot.kinematics import feet_and_forces
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance

STEP = 0.01
"""Interval between two steps [s]."""
# For an A1; lengths and times are multiplied by those of the stance's scale.
_KEPT = 0.1  # [s] of samples before the next step, to interpolate from
_STANDING = 4e-3  # [m] height above the lowest foot at which a foot hardly counts as standing
_WINDOW = 0.1  # [s] time in which the joints of a robot at rest move less than the next limit
_STILL_JOINTS, _STILL_BASE = 2e-3, 0.03  # [rad], [rad/s]
_TO_GRAVITY_AT_REST, _TO_GRAVITY = 0.3, 10.0  # [s] time constants of the correction by the accelerometer
_SHAKEN = 1.0  # [m/s2] difference from gravity beyond which the accelerometer is ignored
_LEAST_LOAD = 0.05  # relative to a quarter of the robot's weight


@dataclass(frozen=True, eq=False)
class BaseMotion:
    """Motion of the base over n steps. The world's z axis is up, the floor is at zero, x is the initial heading.

    Attributes:
        steps: sensor samples of the steps.
        rotation_base_to_world: (n, 3, 3) attitude of the base.
        position_in_world: (n, 3) origin of the base [m].
        feet_in_world: (n, 4, 3) centres of the feet [m].
        standing: (n, 4) weight of each foot as a standing foot, from 0 to 1.
    """

    steps: Recording
    rotation_base_to_world: FloatArray
    position_in_world: FloatArray
    feet_in_world: FloatArray
    standing: FloatArray


class BaseTracker:
    """Estimator of the base's motion from consecutive pieces of a recording."""

    def __init__(self, robot: RobotModel, stance: Stance) -> None:
        self._robot, self._legs, self._scale = robot, LegChains(robot), stance.scale
        self._to_base = np.array(robot.imu_in_base.rotation)
        self._pending: Recording | None = None  # samples since the last step
        self._step_end: float | None = None
        self._past: FloatArray | None = None  # joint positions of the last steps
        self._feet: FloatArray | None = None  # relative to the base's origin, in world axes
        self._rotation: FloatArray | None = None
        self._position = np.zeros(3)
        self._bias, self._rested = np.zeros(3), 0.0

    def take(self, piece: Recording) -> BaseMotion | None:
        """Return the motion over the steps that a piece completes; None if it completes none."""
        try:
            self._pending = piece if self._pending is None else Recording.concatenate([self._pending, piece])
        except RecordingError:  # the clock was reset, or the recorded streams changed
            self._pending, self._step_end = piece, None
        steps = resample(self._pending, self._step_end)
        if steps is None:
            return None
        self._step_end = float(steps.joints.time[-1])
        self._pending = self._pending.between(self._step_end - _KEPT, np.inf)
        return self._follow(steps)

    def _follow(self, steps: Recording) -> BaseMotion:
        joints, window = steps.joints.position, round(_WINDOW * self._scale.time / STEP)
        before = np.repeat(joints[:1], window, axis=0) if self._past is None else self._past
        past = np.vstack([before, joints])
        self._past = past[-window:]
        velocity = np.diff(past, axis=0)[window - 1 :] / STEP
        still = np.abs(joints - past[:-window]).max(axis=1) < _STILL_JOINTS
        turning, acceleration = (
            sensed @ self._to_base.T for sensed in (steps.imu.angular_velocity_in_imu, steps.imu.acceleration_in_imu)
        )
        rotation = self._attitudes(turning, acceleration, still)
        motion, up = self._legs.motion(joints, velocity, turning), rotation[:, None, 2]
        height = np.einsum("nli,nji->nl", motion.foot, up) - self._legs.foot_radius
        rise = (height - height.min(axis=1, keepdims=True)) / (_STANDING * self._scale.length)
        standing = np.exp(-np.square(rise)) + 1e-9
        weight = standing * self._loads(steps, up)
        feet = np.einsum("nij,nlj->nli", rotation, motion.foot)
        last_feet = feet[:1] if self._feet is None else self._feet
        # Standing feet roll on the floor without slip.
        rolled = STEP * cross(motion.foot_angular_velocity, self._legs.foot_radius[:, None] * up)
        moved = np.diff(feet, axis=0, prepend=last_feet) - np.einsum("nij,nlj->nli", rotation, rolled)
        moves = -np.einsum("nl,nli->ni", weight, moved) / weight.sum(axis=1, keepdims=True)
        position = self._position + np.cumsum(moves, axis=0)
        position[:, 2] = -(standing * height).sum(axis=1) / standing.sum(axis=1)
        self._feet, self._position = feet[-1:], position[-1]
        return BaseMotion(steps, rotation, position, position[:, None] + feet, standing)

    def _attitudes(self, turning: FloatArray, acceleration: FloatArray, still: NDArray[np.bool_]) -> FloatArray:
        """Return (n, 3, 3) attitudes after each step, and subtract the bias from the gyroscope's (n, 3) readings [rad/s].

        Args:
            still: (n,) True while the joints are at rest.
        """
        level, _ = Rotation.align_vectors(np.array([[0.0, 0, 1]]), acceleration[:1])
        rotation = level.as_matrix() if self._rotation is None else self._rotation
        rotations = np.empty((len(turning), 3, 3))
        for k, force in enumerate(acceleration):
            turning[k] -= self._bias
            rotation = rotation @ Rotation.from_rotvec(turning[k] * STEP).as_matrix()
            at_rest = still[k] and np.abs(turning[k]).max() < _STILL_BASE
            if at_rest:
                self._rested += STEP
                self._bias = self._bias + turning[k] * STEP / self._rested
            size = float(np.linalg.norm(force))
            if abs(size - GRAVITY) < _SHAKEN:
                error = np.asarray(np.cross(rotation @ force / size, [0, 0, 1]), dtype=float)
                share = min(1.0, STEP / ((_TO_GRAVITY_AT_REST if at_rest else _TO_GRAVITY) * self._scale.time))
                rotation = Rotation.from_rotvec(share * error).as_matrix() @ rotation
            rotations[k] = rotation
        self._rotation = rotation
        return rotations

    def _loads(self, steps: Recording, up: FloatArray) -> FloatArray:
        """Return (n, 4) weights of the feet by their load; equal ones without joint torques."""
        joints = steps.joints
        torque = np.zeros_like(joints.position) if joints.torque is None else joints.torque
        carried = np.einsum("nli,nji->nl", feet_and_forces(self._robot, joints.position, torque)[1], up)
        total = np.maximum(carried.sum(axis=1, keepdims=True), 1e-9)
        return np.asarray(np.clip(4 * carried / total, _LEAST_LOAD, 1.0) ** 2, dtype=float)


def resample(recording: Recording, start: float | None) -> Recording | None:
    """Return a recording in equal steps: joints interpolated at their ends, IMU averaged; None without a complete step.

    Args:
        start: beginning of the first step [s]; None: first time in both streams.
    """
    joints, imu = recording.joints, recording.imu
    if not (len(joints.time) > 1 and len(imu.time) > 1):
        return None
    start = max(float(joints.time[0]), float(imu.time[0])) if start is None else start
    count = int((min(joints.time[-1], imu.time[-1]) - start) / STEP + 1e-6)
    if count < 1:
        return None
    edges: FloatArray = np.asarray(start + STEP * np.arange(count + 1), dtype=float)

    def mean(values: FloatArray) -> FloatArray:
        integral = np.asarray(cumulative_trapezoid(values, imu.time, axis=0, initial=0), dtype=float)
        return np.diff(at_times(edges, imu.time, integral), axis=0) / STEP

    torque = None if joints.torque is None else at_times(edges[1:], joints.time, joints.torque)
    return Recording(
        recording.joint_names,
        JointStream(edges[1:], at_times(edges[1:], joints.time, joints.position), torque=torque),
        ImuStream(edges[1:], mean(imu.angular_velocity_in_imu), mean(imu.acceleration_in_imu)),
    )
