"""How far a standing robot's links are above the floor that its feet stand on."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import coal
import pinocchio as pin

from equipoise.clearance.clearance import FLOOR, Contact
from equipoise.clearance.pairs import pairs_of
from equipoise.clearance.shapes import link_of
from equipoise.conventions import FloatArray
from equipoise.robot.model import RobotModel


def floor_contact(
    robot: RobotModel, joint_poses: Sequence[pin.SE3], up_in_base: FloatArray, floor_height: float
) -> Contact | None:
    """The lowest link, if it is nearer to the floor than links may be to each other.

    Lower legs are not looked at: they end on the floor.

    Args:
        joint_poses: poses of the joints' frames in the base frame, as of `Kinematics`.
        up_in_base: (3,) the floor's unit normal in the base frame.
        floor_height: height of the floor over the base frame's origin, along the normal [m].
    """
    floor = coal.Halfspace(up_in_base, floor_height)
    heights = [
        Contact((link_of(shape), FLOOR), _distance(shape, joint_poses[shape.parentJoint], floor))
        for shape in _off_the_floor(robot)
    ]
    lowest = min(heights, key=lambda contact: contact.distance)
    return lowest if lowest.distance < pairs_of(robot).least else None


@lru_cache(maxsize=16)
def _off_the_floor(robot: RobotModel) -> list[pin.GeometryObject]:
    shanks = {leg.joint_ids[-1] for leg in robot.legs.values()}
    return [shape for shape in pairs_of(robot).shapes.geometryObjects if shape.parentJoint not in shanks]


def _distance(shape: pin.GeometryObject, joint_pose: pin.SE3, floor: coal.Halfspace) -> float:
    """[m]; negative: the shape reaches into the floor."""
    pose = joint_pose * shape.placement
    placed = coal.Transform3s(pose.rotation, pose.translation)
    result = coal.DistanceResult()
    return float(coal.distance(shape.geometry, placed, floor, coal.Transform3s(), coal.DistanceRequest(), result))
