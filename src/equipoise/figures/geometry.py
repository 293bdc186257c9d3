"""Shapes of a robot's links, for reports and viewers.

They are the visuals of the user's model file, if it is unchanged and all its meshes are readable. A link without any gets the
shapes that distances are computed with: simple collision shapes of the file, or else a capsule, and a box for the base.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from equipoise.clearance.shapes import robot_shapes
from equipoise.clearance.stand_ins import BASE_JOINT
from equipoise.conventions import FloatArray
from equipoise.robot.kinematics import Kinematics
from equipoise.robot.model import RobotModel

IntArray = NDArray[np.int64]
Kind = Literal["box", "sphere", "cylinder", "capsule", "mesh"]
Part = Literal["base", "hip", "thigh", "shank"]

_SIMPLE: dict[str, Kind] = {"Box": "box", "Sphere": "sphere", "Cylinder": "cylinder", "Capsule": "capsule"}
_AROUND = 24  # edges around a round body
_MOST_FACES = 20_000  # per mesh, before simplification: some models have very fine meshes
MOST_FACES_ON_PAGE = 1200
"""Approximate largest number of faces of a mesh in a report."""
_FACES_OF_GRID = 3.0  # faces of a simplified mesh, over the square of the number of cells along its longest side


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangle mesh of one shape.

    Attributes:
        vertices: (n, 3) [m].
        faces: (m, 3) indices of vertices, anticlockwise seen from outside.
        kind: type of the shape.
        joint: Pinocchio id of the joint that carries the shape; 1 is the base.
        part: part of the robot.
    """

    vertices: FloatArray
    faces: IntArray
    kind: Kind = "mesh"
    joint: int = BASE_JOINT
    part: Part = "base"

    def normals(self) -> FloatArray:
        """Return (n, 3) unit normals at the vertices: area-weighted means over the adjacent faces."""
        a, b, c = (self.vertices[self.faces[:, corner]] for corner in range(3))
        normals = np.zeros_like(self.vertices)
        for corner in range(3):
            np.add.at(normals, self.faces[:, corner], np.cross(b - a, c - a))
        return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)

    def moved(self, place: pin.SE3) -> Mesh:
        """Return the mesh transformed by a placement."""
        return replace(self, vertices=self.vertices @ np.array(place.rotation).T + np.array(place.translation))


def drawn_shapes(robot: RobotModel, most_faces: int = _MOST_FACES) -> tuple[Mesh, ...]:
    """Return all shapes of a robot in the frames of their joints, those of the base first.

    Args:
        most_faces: approximate largest number of faces of a mesh; finer meshes are simplified.
    """
    found = _visuals(robot, most_faces)
    shown = {shape.joint for shape in found if shape.kind != "sphere"}
    for shape in robot_shapes(robot).geometryObjects:
        joint = int(shape.parentJoint)
        if joint not in shown:
            drawn = _drawn(robot, joint, shape, shape.placement, most_faces)
            found += [mesh for mesh in drawn if not any(_same_ball(mesh, other) for other in found)]
    return tuple(sorted(found, key=lambda shape: shape.joint))


def _same_ball(one: Mesh, other: Mesh) -> bool:
    """Return whether two shapes are spheres at the same place of a link, as a foot's in the file and its stand-in."""
    return (one.kind, other.kind) == ("sphere", "sphere") and (
        one.joint == other.joint and np.allclose(one.vertices.mean(axis=0), other.vertices.mean(axis=0))
    )


def at_posture(robot: RobotModel, shapes: Iterable[Mesh], joint_position: FloatArray) -> list[Mesh]:
    """Return shapes in the base frame.

    Args:
        joint_position: (nj,) leg joint positions [rad].
    """
    poses = Kinematics(robot).joint_poses(joint_position)
    return [shape.moved(poses[shape.joint]) for shape in shapes]


def box(x: float, y: float, z: float) -> Mesh:
    """Return a box centred at the origin, with the given edges [m]."""
    return _convex(np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) * [x / 2, y / 2, z / 2])


def sphere(radius: float) -> Mesh:
    """Return a sphere centred at the origin [m]."""
    return capsule(radius, 0.0)


def cylinder(radius: float, length: float) -> Mesh:
    """Return a cylinder along z, centred at the origin [m]."""
    return _convex(np.vstack([_ring(radius, -length / 2), _ring(radius, length / 2)]))


def capsule(radius: float, length: float) -> Mesh:
    """Return a capsule along z, centred at the origin; `length` excludes the caps [m]."""
    angles = np.linspace(0, np.pi / 2, _AROUND // 4 + 1)
    cap = np.vstack([_ring(radius * np.cos(a), length / 2 + radius * np.sin(a)) for a in angles])
    return _convex(np.unique(np.vstack([cap, cap * [1, 1, -1]]).round(12), axis=0))


def _ring(radius: float, z: float) -> FloatArray:
    """Return (n, 3) points on a horizontal circle around the z axis [m]."""
    around = np.linspace(0, 2 * np.pi, _AROUND, endpoint=False)
    return np.column_stack([radius * np.cos(around), radius * np.sin(around), np.full(_AROUND, z)])


def _convex(points: FloatArray) -> Mesh:
    """Return the convex hull of points."""
    hull = ConvexHull(points)
    faces, normals = np.asarray(hull.simplices, dtype=np.int64), np.asarray(hull.equations)[:, :3]
    a, b, c = (points[faces[:, corner]] for corner in range(3))
    inward = np.einsum("ni,ni->n", np.cross(b - a, c - a), normals) < 0
    faces[inward] = faces[inward][:, ::-1]
    used, faces = np.unique(faces, return_inverse=True)
    return Mesh(points[used], faces.reshape(-1, 3))


def _visuals(robot: RobotModel, most_faces: int) -> list[Mesh]:
    """Return the visuals of the user's model file, on links of the same names.

    Empty if the file was changed, or if it or one of its meshes cannot be read or drawn.
    """
    path, found = robot.source.path, list[Mesh]()
    links = {str(f.name): f for f in robot.pinocchio.frames if f.type == pin.FrameType.BODY}
    try:
        if hashlib.sha256(path.read_bytes()).hexdigest() != robot.source.sha256:
            return []
        model, geometry = _read(path, robot.source.format)
        for shape in geometry.geometryObjects:
            theirs = model.frames[shape.parentFrame]
            if (ours := links.get(str(theirs.name))) is not None:
                placement = ours.placement * theirs.placement.inverse() * shape.placement
                found += _drawn(robot, int(ours.parentJoint), shape, placement, most_faces)
    except (OSError, ValueError, RuntimeError, IndexError):
        return []
    return found


def _read(path: Path, model_format: str) -> tuple[pin.Model, pin.GeometryModel]:
    """Return the model of a file, and its visuals."""
    if model_format == "mjcf":
        model = pin.buildModelFromMJCF(str(path))
        return model, pin.buildGeomFromMJCF(model, str(path), pin.GeometryType.VISUAL)
    folders = [str(folder) for folder in path.resolve().parents]  # to resolve package://NAME/... in
    model = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
    return model, pin.buildGeomFromUrdf(model, str(path), pin.GeometryType.VISUAL, package_dirs=folders)


def _drawn(robot: RobotModel, joint: int, shape: pin.GeometryObject, placement: pin.SE3, most_faces: int) -> list[Mesh]:
    """Return one shape of Pinocchio to draw; none for kinds that are not drawn."""
    mesh = _triangles(shape, most_faces)
    if mesh is None:
        return []
    kind = _SIMPLE.get(type(shape.geometry).__name__, "mesh")
    return [replace(mesh.moved(placement), kind=kind, joint=joint, part=_part(robot, joint))]


def _triangles(shape: Any, most_faces: int) -> Mesh | None:
    """Return the triangles of a Pinocchio shape in its own axes; None for unsupported ones such as planes."""
    geometry = shape.geometry
    name = type(geometry).__name__
    if name == "Box":
        return box(*(2 * float(half) for half in geometry.halfSide))
    if name == "Sphere":
        return sphere(float(geometry.radius))
    if name == "Cylinder":
        return cylinder(float(geometry.radius), 2 * float(geometry.halfLength))
    if name == "Capsule":
        return capsule(float(geometry.radius), 2 * float(geometry.halfLength))
    if not hasattr(geometry, "tri_indices"):
        return None
    triangles = (geometry.tri_indices(index) for index in range(geometry.num_tris))
    faces = np.array([[t[0], t[1], t[2]] for t in triangles], dtype=np.int64)
    return _coarser(_mended(Mesh(np.array(geometry.vertices(), dtype=float), faces)), most_faces)


def _mended(mesh: Mesh) -> Mesh:
    """Return the mesh, or its convex hull if some vertices belong to no triangle.

    In files of several parts coal 3.0 numbers the vertices of each part from zero, so triangles have wrong vertices.
    """
    return mesh if len(np.unique(mesh.faces)) == len(mesh.vertices) else _convex(mesh.vertices)


def _coarser(mesh: Mesh, most_faces: int) -> Mesh:
    """Return the mesh, with vertices merged in grid cells if it has too many faces."""
    if len(mesh.faces) <= most_faces:
        return mesh
    cell = float(np.ptp(mesh.vertices, axis=0).max()) / np.sqrt(most_faces / _FACES_OF_GRID)
    _, first, merged = np.unique(np.rint(mesh.vertices / cell), axis=0, return_index=True, return_inverse=True)
    faces = merged.reshape(-1)[mesh.faces]
    a, b, c = faces.T
    return Mesh(mesh.vertices[first], np.unique(faces[(a != b) & (b != c) & (c != a)], axis=0))


def _part(robot: RobotModel, joint: int) -> Part:
    for leg in robot.legs.values():
        if joint in leg.joint_ids:
            parts: tuple[Part, ...] = ("shank", "thigh", "hip")
            return parts[leg.joint_ids[::-1].index(joint)]
    return "base"
