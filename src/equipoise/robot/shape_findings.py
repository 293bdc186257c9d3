"""Findings about mass distributions: centres of mass outside their links, and a trunk unlike its collision shapes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pinocchio as pin

from equipoise.conventions import FloatArray
from equipoise.robot.links import file_links
from equipoise.robot.model import RobotModel
from equipoise.robot.tree import read_shapes

# Leg lengths that a CoM may lie beyond its link's joints, frames and shapes and those of the link above, where its motor may
# be; in the catalogue at most 0.03.
_OUTSIDE = 0.15
_LEAST_MASS = 0.01  # of the robot's; lighter links do not matter
# A trunk's moments of inertia over those of its collision shapes at uniform density: 0.57 to 1.8 in the catalogue.
_LEAST_INERTIA, _MOST_INERTIA = 0.35, 2.8
_DENSITIES = 150.0, 3000.0  # [kg/m3] of shapes that are the trunk; 420 to 1340 in the catalogue

Found = tuple[str, str]
"""Name of a link, and its defect."""


def coms_outside(robot: RobotModel) -> Iterator[Found]:
    """Compare each link's CoM with the box around its joints, frames and shapes and those of the link above it."""
    model, shapes = robot.full_pinocchio, read_shapes(robot.source)[1]
    points = {joint: _points_of(model, shapes, joint) for joint in range(1, model.njoints)}
    for link in file_links(model):
        com, parent = link.placement.act(link.inertia.lever), model.parents[link.joint]
        outside = _distance_to_box(com, points[link.joint])
        if parent > 0:
            com_in_parent = model.jointPlacements[link.joint].act(com)
            outside = min(outside, _distance_to_box(com_in_parent, points[parent]))
        if link.inertia.mass > _LEAST_MASS * robot.mass and outside > _OUTSIDE * robot.leg_length:
            shown = ", ".join(f"{value * 1000:.0f}" for value in link.inertia.lever)
            text = f"a centre of mass at ({shown}) mm that is {outside * 1000:.0f} mm outside its joints and shapes"
            yield link.name, text


def _points_of(model: pin.Model, shapes: pin.GeometryModel, joint: int) -> FloatArray:
    """Return (n, 3) points of a joint's link in its frame [m]: joints, frames, and corners of boxes around its shapes."""
    below = [model.jointPlacements[other].translation for other in model.children[joint]]
    frames = [frame.placement.translation for frame in model.frames if frame.parentJoint == joint]
    corners: list[FloatArray] = []
    for shape in shapes.geometryObjects:
        if shape.parentJoint == joint:
            shape.geometry.computeLocalAABB()
            box = shape.geometry.aabb_local
            ends = np.array(np.meshgrid(*zip(box.min_, box.max_, strict=True))).reshape(3, -1).T
            corners += [shape.placement.act(corner) for corner in ends]
    return np.array([*below, *frames, *corners, *([np.zeros(3)] if joint > 1 else [])])


def _distance_to_box(point: FloatArray, points: FloatArray) -> float:
    """Compute the distance of a (3,) point from the axis-aligned box around (n, 3) points [m]."""
    low, high = points.min(axis=0), points.max(axis=0)
    return float(np.linalg.norm(np.maximum(np.maximum(low - point, point - high), 0.0)))


def trunk_unlike_its_shapes(robot: RobotModel) -> Iterator[Found]:
    """Compare the base link's moments of inertia with those of its collision shapes at uniform density."""
    total = pin.Inertia.Zero()
    for shape in read_shapes(robot.source)[1].geometryObjects:
        if shape.parentJoint == 1:
            volume, geometry = shape.geometry.computeVolume(), shape.geometry
            total += shape.placement.act(pin.Inertia(volume, geometry.computeCOM(), geometry.computeMomentofInertia()))
    own = robot.full_pinocchio.inertias[1]
    if not total.mass > 0 or not _DENSITIES[0] < own.mass / total.mass < _DENSITIES[1]:
        return
    ratios = np.diag(own.inertia) / (np.diag(total.inertia) * own.mass / total.mass)
    if ratios.min() < _LEAST_INERTIA or ratios.max() > _MOST_INERTIA:
        shown = ", ".join(f"{ratio:.2g}" for ratio in ratios)
        yield (
            robot.base_link,
            f"moments of inertia Ixx, Iyy, Izz that are {shown} times those of its collision shapes filled with its mass",
        )
