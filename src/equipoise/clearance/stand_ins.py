"""Stand-ins for links without simple shapes in the model file: capsules along them, and a box around the hips."""

from __future__ import annotations

from collections.abc import Container, Iterator

import coal
import numpy as np
import pinocchio as pin

from equipoise.conventions import FloatArray
from equipoise.robot.bodies import hip_positions, link_ends
from equipoise.robot.model import RobotModel

BASE_JOINT = 1
"""Pinocchio's id of the floating joint, which carries the base."""
LIMB_RADIUS_RATIO = 0.09  # of the leg length: assumed radius of a link without shapes
_SHANK_SHARE = 0.6  # of that radius, for shanks


def capsule(joint: int, start: FloatArray, end: FloatArray, radius: float) -> pin.GeometryObject:
    """Return a capsule along a link of a joint, from its caps' (3,) centres in the joint's frame and its radius [m]."""
    length = float(np.linalg.norm(end - start))
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), (end - start) / length)
    return pin.GeometryObject("", joint, pin.SE3(turn.matrix(), (start + end) / 2), coal.Capsule(radius, length))


def leg_limbs(robot: RobotModel, shown: Container[int]) -> Iterator[pin.GeometryObject]:
    """Generate capsules along the leg links whose joint is not in `shown`; links shorter than their radius have none."""
    radius = LIMB_RADIUS_RATIO * robot.leg_length
    for leg in robot.legs.values():
        for joint, end in link_ends(robot, leg).items():
            if joint not in shown and float(np.linalg.norm(end)) > radius:
                yield capsule(joint, np.zeros(3), end, radius * (_SHANK_SHARE if joint == leg.joint_ids[-1] else 1.0))


def trunk_box(robot: RobotModel) -> tuple[tuple[float, float, float], FloatArray]:
    """Return the edges of a box around the hips, and its (3,) centre in the base frame [m]."""
    hips, radius = hip_positions(robot), LIMB_RADIUS_RATIO * robot.leg_length
    x, y, z = (np.ptp(hips, axis=0) + np.array([0, 0, 2 * radius])).tolist()
    return (x, y, z), hips.mean(axis=0)
