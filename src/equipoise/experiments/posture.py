"""Postures of the base over four feet on the floor."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import pinocchio as pin

from equipoise.clearance.clearance import contact_in
from equipoise.clearance.floor import floor_contact
from equipoise.conventions import FloatArray
from equipoise.errors import ReachError
from equipoise.robot.kinematics import Kinematics, feet_under_base, inverse_kinematics
from equipoise.robot.model import DIAGONALS, LEG_NAMES, RobotModel
from equipoise.robot.posture import BodyPosture
from equipoise.robot.stance import Stance
from equipoise.robot.statics import static_torques

_LONGEST_LEG = 0.95  # hip to foot over thigh plus shank: near 1, inverse kinematics and control are singular
_SHORTEST_LEG = 0.35
_LIMIT_MARGIN = 0.03  # [rad]
_TORQUE_MARGIN = 0.9  # of the effort limit
_INSIDE = 0.15  # smallest distance of the CoM from the edge of the feet, over the stance's half width or length


def feet_in_posture(
    stance: Stance, com: FloatArray, posture: BodyPosture, diagonal: str | None = None, offset: float = 0.0
) -> FloatArray:
    """Return the (4, 3) feet of the nominal stance in the base frame of a posture [m].

    Args:
        com: (3,) assumed CoM in the base frame [m].
        posture: posture of the base.
        diagonal: diagonal to whose support line the CoM is moved along x, or None. With a diagonal, `posture.ahead`
            and `aside` are ignored.
        offset: distance of the line ahead of the CoM, along the line's normal [m].
    """
    feet = stance.feet_in_base
    # The base does not move sideways: legs with two joints cannot do that.
    over = np.array([feet[:, 0].mean(), com[1]]) + stance.hip_height * np.array([posture.ahead, posture.aside])
    if diagonal is not None:
        _, normal, point = stance_line(stance, diagonal)
        over = com[:2].copy()
        over[0] -= (offset + float(normal[:2] @ (com[:2] - point[:2]))) / normal[0]
    target = np.array([*over, com[2] - posture.crouch * stance.hip_height])
    return feet_under_base(feet, target - posture.rotation @ com, posture.rotation)


@lru_cache(maxsize=16)
def stance_line(stance: Stance, diagonal: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the left direction, forward normal and midpoint of a nominal stance's support line, in the base frame."""
    right, left = sorted(DIAGONALS[diagonal], key=lambda leg: leg[1], reverse=True)
    a, b = stance.feet_in_base[LEG_NAMES.index(left)], stance.feet_in_base[LEG_NAMES.index(right)]
    direction = (a - b) / np.linalg.norm(a - b)
    normal = np.cross(direction, [0.0, 0.0, 1.0])
    return direction, normal / np.linalg.norm(normal), (a + b) / 2


def check_posture(
    robot: RobotModel,
    stance: Stance,
    feet_in_base: FloatArray,
    standing: tuple[str, ...] = LEG_NAMES,
    near: FloatArray | None = None,
) -> FloatArray:
    """Return the joint positions of a posture after checking reach, joint limits, torques and contacts.

    Args:
        feet_in_base: (4, 3) foot positions in the base frame [m].
        standing: legs that carry the robot.
        near: (nj,) initial guess of the joint positions; default the nominal ones [rad].

    Raises:
        ReachError: a leg is too long or too short, a joint too near its limit, a motor too weak, or links touch each other
            or the floor.
    """
    position = inverse_kinematics(robot, feet_in_base, stance.joint_position if near is None else near)
    margin = np.minimum(position - robot.lower_limit, robot.upper_limit - position)
    worst = int(np.argmin(margin))
    if margin[worst] < _LIMIT_MARGIN:
        raise ReachError(f"joint {robot.joint_names[worst]!r} would be {max(margin[worst], 0):.3f} rad from its limit")
    kinematics = Kinematics(robot)
    poses = kinematics.joint_poses(position)
    for leg, foot in zip(robot.legs.values(), kinematics.foot_positions(position), strict=True):
        hip = poses[leg.joint_ids[-2]].translation
        ratio = float(np.linalg.norm(foot - hip)) / robot.leg_length
        if not _SHORTEST_LEG < ratio < _LONGEST_LEG:
            raise ReachError(f"the {leg.name} leg would be {ratio:.0%} of its length")
    turn = _turn_to_level(stance, feet_in_base)
    _check_inside(stance, feet_in_base, turn, kinematics.com(position))
    torque = np.abs(static_torques(robot, position, standing)) / robot.effort_limit
    worst = int(np.argmax(torque))
    if torque[worst] > _TORQUE_MARGIN:
        raise ReachError(f"joint {robot.joint_names[worst]!r} would need {torque[worst]:.0%} of its torque limit")
    check_clear(robot, position)
    _check_above_floor(robot, poses, feet_in_base, turn[:, 2], standing)
    return position


def check_clear(robot: RobotModel, joint_position: FloatArray) -> None:
    """Raise ReachError if links touch at (nj,) joint positions [rad]."""
    if (contact := contact_in(robot, joint_position)) is not None:
        raise ReachError(str(contact))


def _turn_to_level(stance: Stance, feet_in_base: FloatArray) -> FloatArray:
    """Return the (3, 3) matrix that rotates row vectors from a posture's base frame to the level one of the nominal stance.

    The posture's feet are those of the stance, moved rigidly. Lifting two diagonal feet equally does not change it.
    """
    before, after = stance.feet_in_base, feet_in_base
    left, _, right = np.linalg.svd((after - after.mean(axis=0)).T @ (before - before.mean(axis=0)))
    return np.asarray(left @ np.diag([1, 1, np.linalg.det(left @ right)]) @ right, dtype=float)


def _check_inside(stance: Stance, feet_in_base: FloatArray, turn: FloatArray, com: FloatArray) -> None:
    """Raise ReachError if the CoM is near the edge of the feet, where the robot could tip over."""
    before = stance.feet_in_base
    over = (com - feet_in_base.mean(axis=0)) @ turn + before.mean(axis=0)
    for axis, name in ((0, "front or rear"), (1, "left or right")):
        half_width = float(np.ptp(before[:, axis])) / 2
        room = min(before[:, axis].max() - over[axis], over[axis] - before[:, axis].min())
        if room < _INSIDE * half_width:
            raise ReachError(f"the centre of mass would be {room * 1000:.0f} mm inside the {name} feet")


def _check_above_floor(
    robot: RobotModel,
    joint_poses: Sequence[pin.SE3],
    feet_in_base: FloatArray,
    up_in_base: FloatArray,
    standing: tuple[str, ...],
) -> None:
    """Raise ReachError if knees or trunk would touch the plane of the feet."""
    soles = [feet_in_base[LEG_NAMES.index(leg)] @ up_in_base - robot.legs[leg].foot_radius for leg in standing]
    if (contact := floor_contact(robot, joint_poses, up_in_base, float(np.mean(soles)))) is not None:
        raise ReachError(str(contact))
