"""How far a standing robot's links are above the floor that its feet stand on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import coal
import numpy as np
import pinocchio as pin

from equipoise.clearance.clearance import FLOOR, Contact
from equipoise.clearance.pairs import pairs_of
from equipoise.clearance.shapes import link_of
from equipoise.conventions import FloatArray
from equipoise.robot.model import RobotModel


@dataclass(frozen=True, eq=False)
class _Outlines:
    """Simple shapes as boxes that are rounded: by a radius on all sides, or, of cylinders, about their z axis alone.

    Attributes:
        links: (n,) names of their links.
        joints: (n,) Pinocchio's ids of their joints.
        rotation, centre: (n, 3, 3), (n, 3) poses in their joints' frames [m].
        half_edges: (n, 3) of the boxes, in the shapes' axes [m].
        radius, rim: (n,) radii on all sides, and about z [m].
    """

    links: tuple[str, ...]
    joints: tuple[int, ...]
    rotation: FloatArray
    centre: FloatArray
    half_edges: FloatArray
    radius: FloatArray
    rim: FloatArray

    def lowest(self, joint_poses: Sequence[pin.SE3], up_in_base: FloatArray) -> FloatArray:
        """(n,) heights of their lowest points over the base frame's origin, along `up_in_base` [m]."""
        up_in_joint = np.array([up_in_base @ joint_poses[joint].rotation for joint in self.joints])
        origin = np.array([up_in_base @ joint_poses[joint].translation for joint in self.joints])
        up = np.einsum("ni,nij->nj", up_in_joint, self.rotation)
        half = (np.abs(up) * self.half_edges).sum(axis=1) + self.radius + self.rim * np.hypot(up[:, 0], up[:, 1])
        return np.asarray(origin + (up_in_joint * self.centre).sum(axis=1) - half, dtype=float)


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
    outlines = _off_the_floor(robot)
    heights = outlines.lowest(joint_poses, up_in_base)
    lowest = int(np.argmin(heights))
    distance = float(heights[lowest]) - floor_height
    return Contact((outlines.links[lowest], FLOOR), distance) if distance < pairs_of(robot).least else None


@lru_cache(maxsize=16)
def _off_the_floor(robot: RobotModel) -> _Outlines:
    shanks = {leg.joint_ids[-1] for leg in robot.legs.values()}
    shapes = [shape for shape in pairs_of(robot).shapes.geometryObjects if shape.parentJoint not in shanks]
    half_edges, radius, rim = zip(*(_rounded_box(shape.geometry) for shape in shapes), strict=True)
    return _Outlines(
        tuple(link_of(shape) for shape in shapes),
        tuple(int(shape.parentJoint) for shape in shapes),
        np.array([shape.placement.rotation for shape in shapes]),
        np.array([shape.placement.translation for shape in shapes]),
        *(np.array(part, dtype=float) for part in (half_edges, radius, rim)),
    )


def _rounded_box(geometry: coal.CollisionGeometry) -> tuple[FloatArray, float, float]:
    """Half edges, radius and rim of a simple shape [m]."""
    if isinstance(geometry, coal.Box):
        return np.array(geometry.halfSide), 0.0, 0.0
    if isinstance(geometry, coal.Sphere):
        return np.zeros(3), geometry.radius, 0.0
    if isinstance(geometry, coal.Cylinder):
        return np.array([0.0, 0.0, geometry.halfLength]), 0.0, geometry.radius
    assert isinstance(geometry, coal.Capsule)  # there are no others
    return np.array([0.0, 0.0, geometry.halfLength]), geometry.radius, 0.0
