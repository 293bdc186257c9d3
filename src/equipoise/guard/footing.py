"""Contact state of the feet that commands intend, from forward kinematics.

Four feet on a floor lie in a plane, whatever the base's orientation. Phase names do not determine this, and feedback loops
have no phases.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.robot.floor import Vector, floor_normal_by_diagonals
from equipoise.robot.kinematics import foot_positions
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance, lying_posture

_LIFTED = 0.003  # [m] out of the plane of the others, on an A1; the lowest of its steps is 10 mm high
# Damped robots of the catalogue sink to the floor in 0.9 to 2.3 s (HyQ; over its scale of time), at 0.2 to 0.9 m/s (B1: the
# final speed of a drop of 4 cm). Twice the damping takes twice as long, and HyQ rolled over.
_SUNK = 4.0  # [s] on an A1
# Raised legs come down slower than a body sinks: an A1's are held by friction, and fall outward at 0.2 rad/s for up to
# 9 s. Released after 4 s, they fell at 5 rad/s.
_LEGS_UP = 2.5  # times as long
_RAISED = 0.1  # of the leg length: height of a raised foot above its position on the lying robot


def look_at_feet(robot: RobotModel, stance: Stance, joint_position: FloatArray) -> tuple[bool, Vector]:
    """Return whether feet are lifted off the floor under the others, and that floor's upward normal in base axes.

    Args:
        stance: stance in which all feet stand.
        joint_position: (nj,) joint positions [rad].
    """
    apart, up = _diagonals(foot_positions(robot, joint_position))
    return abs(apart - _usually_apart(stance)) > _LIFTED * stance.scale.length, up


def feet_are_lifted(robot: RobotModel, stance: Stance, joint_position: FloatArray) -> bool:
    """Return whether feet are lifted off the floor under the others."""
    return look_at_feet(robot, stance, joint_position)[0]


def legs_are_up(robot: RobotModel, stance: Stance, joint_position: FloatArray) -> bool:
    """Return whether a foot is so high that the robot must lie with its legs turned up."""
    folded, _ = lying_posture(robot, stance)
    feet, lying = (foot_positions(robot, position) for position in (joint_position, folded))
    return float((feet - lying)[:, 2].max()) > _RAISED * robot.leg_length


def damping_time(stance: Stance, legs_up: bool) -> float:
    """Return the time after which a damped robot is taken to be at rest without samples [s]."""
    return stance.scale.time * _SUNK * (_LEGS_UP if legs_up else 1.0)


def floor_on_three_feet(
    robot: RobotModel, stance: Stance, joint_position: FloatArray, standing: FloatArray
) -> Vector | None:
    """Return the floor's upward normal in base axes if at most one foot has moved, or None.

    Args:
        stance: stance in which all feet stand.
        joint_position: (nj,) joint positions [rad].
        standing: (nj,) last joint positions with all feet on the floor [rad].
    """
    feet, before = (foot_positions(robot, position) for position in (joint_position, standing))
    moved = np.abs(feet - before).max(axis=1) > _LIFTED * stance.scale.length
    return floor_normal_by_diagonals(before) if np.count_nonzero(moved) <= 1 else None


@lru_cache(maxsize=4)
def _usually_apart(stance: Stance) -> float:
    """Return the distance between the diagonals where all feet stand [m]."""
    return _diagonals(stance.feet_in_base)[0]


def _diagonals(feet: FloatArray) -> tuple[float, Vector]:
    """Return the height of the middle of one diagonal above that of the other [m], and the upward normal of both.

    Args:
        feet: (4, 3) foot positions FL FR RL RR in the base frame [m].
    """
    up = floor_normal_by_diagonals(feet)
    dx, dy, dz = (feet[0] + feet[3] - feet[1] - feet[2]).tolist()
    return (up[0] * dx + up[1] * dy + up[2] * dz) / 2, up
