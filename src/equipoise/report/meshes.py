"""Meshes as traces of Plotly's mesh3d, in millimetres, and the robot's own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.pictures.geometry import Mesh, at_posture, robot_shapes, sphere
from equipoise.report.blocks import Block
from equipoise.result.calibration import Calibration
from equipoise.robot.model import RobotModel

_MOST_FACES = 1200  # of one mesh: a page is sent by mail


@dataclass(frozen=True, eq=False)
class Body:
    """The robot at its stance.

    Attributes:
        base, legs: meshes in the base frame.
        own: whether the model file says what all links look like.
    """

    base: tuple[Mesh, ...]
    legs: tuple[Mesh, ...]
    own: bool


def body(result: Calibration, robot: RobotModel) -> Body:
    """What the robot looks like."""
    position = np.array([result.joint_position[name] for name in robot.joint_names])
    shapes = robot_shapes(robot, _MOST_FACES)
    meshes = list(zip(shapes, at_posture(robot, shapes, position), strict=True))
    return Body(
        tuple(mesh for shape, mesh in meshes if shape.part == "base"),
        tuple(mesh for shape, mesh in meshes if shape.part != "base"),
        not any(shape.stands_in for shape in shapes),
    )


def ellipsoid(middle: FloatArray, half_axes: FloatArray, directions: FloatArray) -> Block:
    """A trace; directions are columns."""
    ball = sphere(1.0)
    return merged([Mesh(middle + (ball.vertices * half_axes) @ directions.T, ball.faces)], decimals=3)


def merged(meshes: Sequence[Mesh], decimals: int = 1) -> Block:
    """One trace of many meshes, in millimetres."""
    first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    points = 1000 * np.concatenate([np.zeros((0, 3)), *(mesh.vertices for mesh in meshes)])
    none = np.zeros((0, 3), dtype=np.int64)
    faces = np.concatenate([none, *(mesh.faces + start for mesh, start in zip(meshes, first, strict=False))])
    places = {axis: np.round(points[:, k], decimals).tolist() for k, axis in enumerate("xyz")}
    return {"type": "mesh3d", **places, **{name: faces[:, k].tolist() for k, name in enumerate("ijk")}}
