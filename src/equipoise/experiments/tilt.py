"""Evaluation of a lift trial: direction of the tilt, and support plane in the base frame.

Conventions: a support line runs through the contact points of the two stance feet; its direction l points to the robot's
left, and its normal n = l x up points forward. A positive turn about l is tipping forward: the CoM is ahead of the line.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from equipoise.conventions import ACCELERATION_AT_REST, GRAVITY, FloatArray
from equipoise.errors import RecordingError
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.recording.trials import CommandedLift
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.kinematics import foot_positions
from equipoise.robot.model import DIAGONALS, LEG_NAMES, RobotModel

Verdict = Literal["forward", "backward", "balanced"]

_LAST = 0.02  # [s] at the end of a trial, over which the encoders are averaged


@dataclass(frozen=True)
class Tilt:
    """Rotation of the robot while two feet were up.

    Attributes:
        about_line: rotation of the CoM about l [rad]; positive: the robot tipped forward.
        across_line: size of the base's rotation about the normal [rad], which is small for a robot on a line.
        verdict: "forward", "backward", or "balanced" if the rotation is below the threshold.
        rise: height of the lifted feet above the standing ones, from the encoders [m].
    """

    about_line: float
    across_line: float
    verdict: Verdict
    rise: float


@dataclass(frozen=True, eq=False)
class SupportPlane:
    """Plane through a support line and along gravity, in the base frame. It contains the CoM of a balanced robot.

    Attributes:
        point: (3,) point on the line in the base frame, midway between the contact points [m].
        normal: (3,) unit normal in base axes, pointing forward.
    """

    point: FloatArray
    normal: FloatArray

    def distance_to(self, com_in_base: FloatArray) -> float:
        """Return the signed distance of a CoM from the plane [m]; positive: ahead of it, the robot tips forward."""
        return float(self.normal @ (com_in_base - self.point))

    def moved(self, distance: float) -> SupportPlane:
        """Return the plane moved forward by a distance [m]."""
        return SupportPlane(self.point + distance * self.normal, self.normal)

    def towards(self, other: SupportPlane, share: float) -> SupportPlane:
        """Interpolate between this plane (share 0) and another that is nearly parallel (share 1)."""
        normal = (1 - share) * self.normal + share * other.normal
        return SupportPlane((1 - share) * self.point + share * other.point, normal / np.linalg.norm(normal))


@dataclass(frozen=True, eq=False)
class RestMeans:
    """Mean sensor readings of a robot at rest.

    Attributes:
        joint_position: (nj,) mean joint positions [rad].
        up_in_base: (3,) unit vector against gravity in base axes, from the accelerometer.
        gyro_bias: (3,) mean angular velocity in the IMU frame [rad/s].
    """

    joint_position: FloatArray
    up_in_base: FloatArray
    gyro_bias: FloatArray


def still_means(robot: RobotModel, still: Recording) -> RestMeans:
    """Return the means over a recording at rest.

    Raises:
        RecordingError: the accelerometer's magnitude is far from GRAVITY.
    """
    acceleration = still.imu.acceleration_in_imu.mean(axis=0)
    size = float(np.linalg.norm(acceleration))
    if not ACCELERATION_AT_REST[0] < size < ACCELERATION_AT_REST[1]:
        raise RecordingError(
            f"the accelerometer reads {size:.3g} at rest; it must read about {GRAVITY} m/s2 (is it in units of g?)"
        )
    rotation_imu_to_base = np.array(robot.imu_in_base.rotation)
    return RestMeans(
        still.joints.position.mean(axis=0),
        rotation_imu_to_base @ acceleration / size,
        still.imu.angular_velocity_in_imu.mean(axis=0),
    )


def tilt_of(robot: RobotModel, recording: Recording, trial: CommandedLift) -> Tilt:
    """Return the tilt of the robot in a lift trial.

    On soft legs the base rotates by two degrees when two feet lift, independent of the tilt. The tilt is therefore the
    rotation of the leg model's CoM about the line, from rest until the feet are lowered. Encoders give the posture; the
    gyroscope, minus its mean at rest, gives the attitude.

    Args:
        robot: the robot.
        recording: recording with phases "rest", "unload" and "lower"; the robot tips between the last two.
        trial: commanded trial.
    """
    rest = still_means(robot, recording.phase(Phase.REST))
    lifted = recording.phase(Phase.UNLOAD, until=Phase.LOWER)
    turned = _turned(robot, lifted, rest)
    up = rest.up_in_base - np.cross(turned, rest.up_in_base)
    end = lifted.between(lifted.joints.time[-1] - _LAST, np.inf).joints.position.mean(axis=0)
    diagonal = trial.diagonal
    before, height = _lean(robot, rest.joint_position, rest.up_in_base, diagonal)
    after, _ = _lean(robot, end, up / np.linalg.norm(up), diagonal)
    about_line = (after - before) / height
    _, normal, _ = line_axes(robot, rest.joint_position, rest.up_in_base, diagonal)
    verdict: Verdict = "balanced"
    if abs(about_line) >= trial.tilt_threshold:
        verdict = "forward" if about_line > 0 else "backward"
    rise = _rise(robot, rest.joint_position, end, rest.up_in_base, diagonal)
    return Tilt(about_line, abs(float(turned @ normal)), verdict, rise)


def support_plane_of(robot: RobotModel, recording: Recording, diagonal: str, stance: FloatArray) -> SupportPlane:
    """Return the measured support plane of a lift trial, transferred to the nominal stance.

    Feet are computed from the encoders at rest before the lift, and gravity from the accelerometer. The lifted posture is
    not used: the legs move within a fifth of a second, in which the CoM hardly moves over the floor. The trial's posture
    differs from the nominal stance, so the plane is moved by the difference of the leg model's CoMs.

    Args:
        diagonal: diagonal that the robot stood on.
        stance: (nj,) joint positions of the nominal stance [rad].
    """
    rest = still_means(robot, recording.phase(Phase.REST))
    _, normal, point = line_axes(robot, rest.joint_position, rest.up_in_base, diagonal)
    moved = composite_parameters(robot, stance).com - composite_parameters(robot, rest.joint_position).com
    return SupportPlane(point + moved, normal)


def _rise(robot: RobotModel, before: FloatArray, after: FloatArray, up_in_base: FloatArray, diagonal: str) -> float:
    """Return the rise of the feet off the diagonal relative to those on it [m]."""
    rose = (foot_positions(robot, after) - foot_positions(robot, before)) @ up_in_base
    standing = np.array([leg in DIAGONALS[diagonal] for leg in LEG_NAMES])
    return float(rose[~standing].mean() - rose[standing].mean())


def _lean(robot: RobotModel, joint_position: FloatArray, up_in_base: FloatArray, diagonal: str) -> tuple[float, float]:
    """Return the distance of the model's CoM ahead of the line, and its height above the line [m]."""
    _, normal, point = line_axes(robot, joint_position, up_in_base, diagonal)
    arm = composite_parameters(robot, joint_position).com - point
    return float(arm @ normal), float(arm @ up_in_base)


def _turned(robot: RobotModel, recording: Recording, rest: RestMeans) -> FloatArray:
    """Return the (3,) integral of the angular velocity in the base frame [rad], for small rotations."""
    imu = recording.imu
    turning = (imu.angular_velocity_in_imu - rest.gyro_bias) @ np.array(robot.imu_in_base.rotation).T
    return np.sum((turning[1:] + turning[:-1]) / 2 * np.diff(imu.time)[:, None], axis=0)


def line_axes(
    robot: RobotModel, joint_position: FloatArray, up_in_base: FloatArray, diagonal: str
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the left direction l, forward normal n and midpoint of a support line, in the base frame.

    Args:
        joint_position: (nj,) joint positions [rad].
        up_in_base: (3,) unit vector against gravity in base axes.
        diagonal: diagonal, "FL_RR" or "FR_RL".
    """
    feet = foot_positions(robot, joint_position)
    stance_legs = DIAGONALS[diagonal]
    radii = np.array([robot.legs[leg].foot_radius for leg in stance_legs])
    contacts = feet[[LEG_NAMES.index(leg) for leg in stance_legs]] - radii[:, None] * up_in_base
    line = contacts[0] - contacts[1]
    left = line if line[1] > 0 else -line
    left = left / np.linalg.norm(left)
    normal = np.cross(left, up_in_base)
    return left, normal / np.linalg.norm(normal), contacts.mean(axis=0)
