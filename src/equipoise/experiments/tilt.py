"""What a lift trial says: which way the robot tipped, and where the support plane was in the base frame.

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
    """How the robot turned while two feet were up.

    Attributes:
        about_line: rotation of the CoM about l [rad]; positive: the robot tipped forward.
        across_line: size of the base's rotation about the normal [rad]; a robot on a line hardly turns that way.
        verdict: outcome, "forward" or "backward", or "balanced" if it turned by less than the threshold.
        rise: height by which the lifted feet rose above the standing ones, by the encoders [m].
        lifted: whether that is at least half of what they were sent; a robot whose feet stay down is not balanced.
    """

    about_line: float
    across_line: float
    verdict: Verdict
    rise: float
    lifted: bool


@dataclass(frozen=True, eq=False)
class SupportPlane:
    """The plane that holds a support line and gravity, in the base frame. A balanced robot's CoM lies in it.

    Attributes:
        point: (3,) point on the line in the base frame, midway between the contact points [m].
        normal: (3,) unit normal in base axes, pointing forward.
    """

    point: FloatArray
    normal: FloatArray

    def distance_to(self, com_in_base: FloatArray) -> float:
        """Signed distance of a CoM from the plane [m]; positive: ahead of it, the robot tips forward."""
        return float(self.normal @ (com_in_base - self.point))

    def moved(self, distance: float) -> SupportPlane:
        """The plane so far ahead [m]."""
        return SupportPlane(self.point + distance * self.normal, self.normal)

    def towards(self, other: SupportPlane, share: float) -> SupportPlane:
        """The plane between this one and another that is nearly parallel: at 0 this one, at 1 the other."""
        normal = (1 - share) * self.normal + share * other.normal
        return SupportPlane((1 - share) * self.point + share * other.point, normal / np.linalg.norm(normal))


@dataclass(frozen=True, eq=False)
class RestMeans:
    """What the sensors say of a robot at rest.

    Attributes:
        joint_position: (nj,) mean joint positions [rad].
        up_in_base: (3,) unit vector against gravity in base axes, by the accelerometer.
        gyro_bias: (3,) mean angular velocity in the IMU frame [rad/s].
    """

    joint_position: FloatArray
    up_in_base: FloatArray
    gyro_bias: FloatArray


def rest_of(robot: RobotModel, recording: Recording, phase: str = "rest") -> RestMeans:
    """Means over a phase in which nothing moves; raises what `still_means` raises."""
    return still_means(robot, recording.phase(phase))


def still_means(robot: RobotModel, still: Recording) -> RestMeans:
    """Means over a recording in which nothing moves.

    Raises:
        RecordingError: the accelerometer does not read about GRAVITY.
    """
    acceleration = still.imu.acceleration_in_imu.mean(axis=0)
    size = float(np.linalg.norm(acceleration))
    if not ACCELERATION_AT_REST[0] < size < ACCELERATION_AT_REST[1]:
        raise RecordingError(
            f"the accelerometer reads {size:.3g} at rest; it must read about {GRAVITY}, in m/s2 (is it in units of g?)"
        )
    rotation_imu_to_base = np.array(robot.imu_in_base.rotation)
    return RestMeans(
        still.joints.position.mean(axis=0),
        rotation_imu_to_base @ acceleration / size,
        still.imu.angular_velocity_in_imu.mean(axis=0),
    )


def tilt_of(robot: RobotModel, recording: Recording, trial: CommandedLift) -> Tilt:
    """Which way the robot tipped in a lift trial.

    On soft legs the base turns by two degrees when two feet lift, whichever way the robot then tips. So what counts is how
    the CoM of the leg model turned about the line, from rest until the feet came down: encoders give the posture, the
    gyroscope (less its mean at rest) the attitude.

    Args:
        robot: the robot.
        recording: recording with phases "rest", "unload" and "lower"; the robot tips in between.
        trial: trial that was commanded.
    """
    rest = rest_of(robot, recording)
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
    return Tilt(about_line, abs(float(turned @ normal)), verdict, rise, rise >= 0.5 * trial.lift_height)


def tilt_curve(robot: RobotModel, recording: Recording, diagonal: str, points: int) -> tuple[FloatArray, FloatArray]:
    """How the robot tipped while two feet were up: what `tilt_of` judges the end of, over time.

    Args:
        recording: recording with phases "rest", "unload" and "lower".
        diagonal: diagonal that the robot stood on.
        points: largest number of points.

    Returns:
        (n,) times since the rest [s], and (n,) rotations of the CoM about l, positive forward [rad].
    """
    rest = rest_of(robot, recording)
    lifted = recording.phase(Phase.UNLOAD, until=Phase.LOWER)
    imu, joints = lifted.imu, lifted.joints
    turning = (imu.angular_velocity_in_imu - rest.gyro_bias) @ np.array(robot.imu_in_base.rotation).T
    steps = (turning[1:] + turning[:-1]) / 2 * np.diff(imu.time)[:, None]
    turned = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    before, height = _lean(robot, rest.joint_position, rest.up_in_base, diagonal)
    shown = np.unique(np.linspace(0, len(joints.time) - 1, points).astype(int))
    angles: list[float] = []
    turned_until = np.minimum(np.searchsorted(imu.time, joints.time[shown]), len(turned) - 1)
    for so_far, position in zip(turned[turned_until], joints.position[shown], strict=True):
        up = rest.up_in_base - np.cross(so_far, rest.up_in_base)
        angles.append((_lean(robot, position, up / np.linalg.norm(up), diagonal)[0] - before) / height)
    return joints.time[shown] - joints.time[0], np.array(angles)


def support_plane_of(robot: RobotModel, recording: Recording, diagonal: str, stance: FloatArray) -> SupportPlane:
    """The support plane of a lift trial, carried to the nominal stance, as the robot's own sensors place it.

    Feet come from the encoders at rest, just before the lift, through forward kinematics; gravity from the accelerometer
    at rest. That posture counts, not the lifted one: the legs move within a fifth of a second, and in so short a time
    hardly any force moves the CoM over the floor, whatever the joints do. The trial's posture is not the nominal stance,
    so that its CoM is elsewhere in the base frame: the plane is moved by how far the leg model says.

    Args:
        diagonal: diagonal that the robot stood on.
        stance: (nj,) joint positions of the nominal stance [rad].
    """
    rest = rest_of(robot, recording)
    _, normal, point = line_axes(robot, rest.joint_position, rest.up_in_base, diagonal)
    moved = composite_parameters(robot, stance).com - composite_parameters(robot, rest.joint_position).com
    return SupportPlane(point + moved, normal)


def _rise(robot: RobotModel, before: FloatArray, after: FloatArray, up_in_base: FloatArray, diagonal: str) -> float:
    """How far the feet off the diagonal rose above those on it [m]."""
    rose = (foot_positions(robot, after) - foot_positions(robot, before)) @ up_in_base
    standing = np.array([leg in DIAGONALS[diagonal] for leg in LEG_NAMES])
    return float(rose[~standing].mean() - rose[standing].mean())


def _lean(robot: RobotModel, joint_position: FloatArray, up_in_base: FloatArray, diagonal: str) -> tuple[float, float]:
    """How far the model's CoM is ahead of the line, and how high above it [m]."""
    _, normal, point = line_axes(robot, joint_position, up_in_base, diagonal)
    arm = composite_parameters(robot, joint_position).com - point
    return float(arm @ normal), float(arm @ up_in_base)


def _turned(robot: RobotModel, recording: Recording, rest: RestMeans) -> FloatArray:
    """(3,) integrated angular velocity in the base frame [rad]; small rotations."""
    imu = recording.imu
    turning = (imu.angular_velocity_in_imu - rest.gyro_bias) @ np.array(robot.imu_in_base.rotation).T
    return np.sum((turning[1:] + turning[:-1]) / 2 * np.diff(imu.time)[:, None], axis=0)


def line_axes(
    robot: RobotModel, joint_position: FloatArray, up_in_base: FloatArray, diagonal: str
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Left direction l, forward normal n and midpoint of a support line, in the base frame.

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
