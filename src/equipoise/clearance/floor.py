"""Heights of a standing robot's links above the floor."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import coal
import numpy as np
import pinocchio as pin

from equipoise.clearance.clearance import FLOOR, Contact
from equipoise.clearance.pairs import pairs_of
from equipoise.clearance.shapes import Spheres, link_of
from equipoise.conventions import FloatArray
from equipoise.robot.model import RobotModel


def floor_contact(
    robot: RobotModel, joint_poses: Sequence[pin.SE3], up_in_base: FloatArray, floor_height: float
) -> Contact | None:
    """Return the lowest link, without shanks, if it is nearer to the floor than links may be to each other.

    Args:
        joint_poses: poses of the joints' frames in the base frame, from `Kinematics`.
        up_in_base: (3,) unit normal of the floor in the base frame.
        floor_height: height of the floor over the base frame's origin, along the normal [m].
    """
    least, (shapes, spheres) = pairs_of(robot).least, _off_the_floor(robot)
    above = spheres.placed(joint_poses) @ up_in_base - floor_height - spheres.radius
    floor = coal.Halfspace(up_in_base, floor_height)
    heights = [
        Contact(
            (link_of(shapes[index]), FLOOR), _distance(shapes[index], joint_poses[shapes[index].parentJoint], floor)
        )
        for index in np.flatnonzero(above < least)
    ]
    lowest = min(heights, key=lambda contact: contact.distance, default=None)
    return lowest if lowest is not None and lowest.distance < least else None


@lru_cache(maxsize=16)
def _off_the_floor(robot: RobotModel) -> tuple[list[pin.GeometryObject], Spheres]:
    shanks = {leg.joint_ids[-1] for leg in robot.legs.values()}
    shapes = [shape for shape in pairs_of(robot).shapes.geometryObjects if shape.parentJoint not in shanks]
    return shapes, Spheres.around(shapes)


def _distance(shape: pin.GeometryObject, joint_pose: pin.SE3, floor: coal.Halfspace) -> float:
    """Return the distance of a shape from the floor [m]; negative: they overlap."""
    pose = joint_pose * shape.placement
    placed = coal.Transform3s(pose.rotation, pose.translation)
    result = coal.DistanceResult()
    return float(coal.distance(shape.geometry, placed, floor, coal.Transform3s(), coal.DistanceRequest(), result))
