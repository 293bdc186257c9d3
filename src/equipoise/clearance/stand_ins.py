"""Stand-ins for links without simple shapes in the model file: capsules along them, and a box around the hips."""

from __future__ import annotations

from collections.abc import Container, Iterator
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from equipoise.conventions import FloatArray
from equipoise.robot.bodies import hip_positions, link_ends
from equipoise.robot.model import RobotModel

BASE_JOINT = 1
"""Pinocchio's id of the floating joint, which carries the base."""
LIMB_RADIUS_RATIO = 0.09  # of the leg length: assumed radius of a link without shapes
_SHANK_SHARE = 0.6  # of that radius, for shanks


@dataclass(frozen=True, eq=False)
class Limb:
    """Capsule along a link.

    Attributes:
        joint: Pinocchio's id of the joint that moves the link.
        start, end: (3,) centres of its caps in the joint's frame [m].
        radius: radius of the capsule [m].
    """

    joint: int
    start: FloatArray
    end: FloatArray
    radius: float

    @property
    def length(self) -> float:
        """Length of the straight part [m]."""
        return float(np.linalg.norm(self.end - self.start))

    @property
    def placement(self) -> pin.SE3:
        """Pose of the capsule's middle in the joint's frame, with z along the capsule."""
        z = (self.end - self.start) / self.length
        x = np.cross(z, [1.0, 0, 0] if abs(z[0]) < 0.9 else [0, 1.0, 0])
        x /= np.linalg.norm(x)
        return pin.SE3(np.column_stack([x, np.cross(z, x), z]), (self.start + self.end) / 2)


def leg_limbs(robot: RobotModel, shown: Container[int]) -> Iterator[Limb]:
    """Generate capsules along the leg links whose joint is not in `shown`; links shorter than their radius have none."""
    radius = LIMB_RADIUS_RATIO * robot.leg_length
    for leg in robot.legs.values():
        for joint, end in link_ends(robot, leg).items():
            if joint not in shown and float(np.linalg.norm(end)) > radius:
                yield Limb(joint, np.zeros(3), end, radius * (_SHANK_SHARE if joint == leg.joint_ids[-1] else 1.0))


def trunk_box(robot: RobotModel, around: float = 0.0) -> tuple[tuple[float, float, float], FloatArray]:
    """Return the edges of a box around the hips, and its (3,) centre in the base frame [m].

    Args:
        around: margin on each side, over a limb's radius.
    """
    hips, radius = hip_positions(robot), LIMB_RADIUS_RATIO * robot.leg_length
    x, y, z = (np.ptp(hips, axis=0) + 2 * radius * np.array([around, around, 1 + around])).tolist()
    return (x, y, z), hips.mean(axis=0)
