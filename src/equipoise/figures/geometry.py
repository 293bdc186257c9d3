"""Shapes of a robot's links, for reports and viewers.

They are the visuals of the user's model file, if it is unchanged and all its meshes are readable. Otherwise they are the
primitive collision shapes of the cleaned model. A link with neither gets a capsule, the base a box.
"""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from equipoise.clearance.stand_ins import BASE_JOINT, leg_limbs, trunk_box
from equipoise.conventions import FloatArray
from equipoise.robot.kinematics import Kinematics
from equipoise.robot.model import RobotModel

IntArray = NDArray[np.int64]
Kind = Literal["box", "sphere", "cylinder", "capsule", "mesh"]
Part = Literal["base", "hip", "thigh", "shank"]

_AROUND = 24  # edges around a round body
_MOST_FACES = 20_000  # per mesh, before simplification: some models have very fine meshes
_MOST_FACES_ON_PAGE = 1200
_FACES_OF_GRID = 3.0  # faces of a simplified mesh, over the square of the number of cells along its longest side


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangle mesh.

    Attributes:
        vertices: (n, 3) [m].
        faces: (m, 3) indices of vertices, anticlockwise seen from outside.
    """

    vertices: FloatArray
    faces: IntArray

    def normals(self) -> FloatArray:
        """Return (n, 3) unit normals at the vertices: area-weighted means over the adjacent faces."""
        a, b, c = (self.vertices[self.faces[:, corner]] for corner in range(3))
        normals = np.zeros_like(self.vertices)
        for corner in range(3):
            np.add.at(normals, self.faces[:, corner], np.cross(b - a, c - a))
        return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)

    def moved(self, place: pin.SE3) -> Mesh:
        """Return the mesh transformed by a placement."""
        return Mesh(self.vertices @ np.array(place.rotation).T + np.array(place.translation), self.faces)


@dataclass(frozen=True, eq=False)
class Shape:
    """Shape on one link.

    Attributes:
        joint: Pinocchio id of the joint that carries the shape; 1 is the base.
        part: part of the robot.
        kind: type of the shape.
        size: dimensions [m]. Box: edges x, y, z; sphere: radius; cylinder and capsule: radius, length along z without
            caps; mesh: empty.
        rotation: (3, 3) axes of the shape in the joint's frame.
        translation: (3,) centre of the shape in the joint's frame [m].
        own: triangles of a mesh in its own axes.
        stands_in: True if the model file has no shape of the link.
    """

    joint: int
    part: Part
    kind: Kind
    size: tuple[float, ...]
    rotation: FloatArray
    translation: FloatArray
    own: Mesh | None = None
    stands_in: bool = False

    def mesh(self) -> Mesh:
        """Return the triangles in the joint's frame [m]."""
        mesh = self.own or _MESHES[self.kind](*self.size)
        return Mesh(mesh.vertices @ self.rotation.T + self.translation, mesh.faces)


def robot_shapes(robot: RobotModel, most_faces: int = _MOST_FACES) -> tuple[Shape, ...]:
    """Return all shapes of a robot, those of the base first.

    Args:
        most_faces: approximate largest number of faces of a mesh; finer meshes are simplified.
    """
    found = _visuals(robot, most_faces) or _collisions(robot, most_faces)
    return tuple(sorted([*found, *_stand_ins(robot, found)], key=lambda shape: shape.joint))


def at_posture(robot: RobotModel, shapes: Iterable[Shape], joint_position: FloatArray) -> list[Mesh]:
    """Return the meshes of shapes in the base frame [m].

    Args:
        joint_position: (nj,) leg joint positions [rad].
    """
    poses = Kinematics(robot).joint_poses(joint_position)
    return [shape.mesh().moved(poses[shape.joint]) for shape in shapes]


def robot_meshes(robot: RobotModel, joint_position: FloatArray) -> tuple[list[Mesh], list[Mesh], bool]:
    """Return simplified meshes of a robot in a posture, small enough for a report.

    Args:
        joint_position: (nj,) leg joint positions [rad].

    Returns:
        meshes of the base and of the legs in the base frame [m]; True if the model file has shapes of all links.
    """
    shapes = robot_shapes(robot, _MOST_FACES_ON_PAGE)
    meshes = list(zip(shapes, at_posture(robot, shapes, joint_position), strict=True))
    base = [mesh for shape, mesh in meshes if shape.part == "base"]
    legs = [mesh for shape, mesh in meshes if shape.part != "base"]
    return base, legs, not any(shape.stands_in for shape in shapes)


def box(x: float, y: float, z: float) -> Mesh:
    """Return a box centred at the origin, with the given edges [m]."""
    corners = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) * [x / 2, y / 2, z / 2]
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return Mesh(corners, np.array([face for a, b, c, d in sides for face in ((a, b, c), (a, c, d))]))


def sphere(radius: float) -> Mesh:
    """Return a sphere centred at the origin [m]."""
    return capsule(radius, 0.0)


def cylinder(radius: float, length: float) -> Mesh:
    """Return a cylinder along z, centred at the origin [m]."""
    return _revolved([(0.0, -length / 2), (radius, -length / 2), (radius, length / 2), (0.0, length / 2)])


def capsule(radius: float, length: float) -> Mesh:
    """Return a capsule along z, centred at the origin; `length` excludes the caps [m]."""
    angles = np.linspace(0, np.pi / 2, _AROUND // 4 + 1)
    upper = [(radius * float(np.cos(a)), length / 2 + radius * float(np.sin(a))) for a in angles[:-1]]
    upper.append((0.0, length / 2 + radius))
    return _revolved([(r, -z) for r, z in reversed(upper)] + upper[int(length == 0) :])


_MESHES = {"box": box, "sphere": sphere, "cylinder": cylinder, "capsule": capsule}


def _revolved(profile: list[tuple[float, float]]) -> Mesh:
    """Return the solid of revolution about z of a profile (radius, z), given from bottom to top."""
    around = np.linspace(0, 2 * np.pi, _AROUND, endpoint=False)
    circle = np.column_stack([np.cos(around), np.sin(around)])
    rings = [np.column_stack([r * circle, np.full(_AROUND, z)]) for r, z in profile]
    here = np.arange(_AROUND)
    there = (here + 1) % _AROUND
    faces: list[IntArray] = []
    for ring in range(len(rings) - 1):
        low, high = ring * _AROUND, (ring + 1) * _AROUND
        if profile[ring][0] > 0:
            faces.append(np.column_stack([low + here, low + there, high + there]))
        if profile[ring + 1][0] > 0:
            faces.append(np.column_stack([low + here, high + there, high + here]))
    return Mesh(np.concatenate(rings), np.concatenate(faces))


def _visuals(robot: RobotModel, most_faces: int) -> list[Shape]:
    """Return the visuals of the user's model file; empty if the file has changed or a mesh is not readable."""
    path = robot.source.path
    try:
        if hashlib.sha256(path.read_bytes()).hexdigest() != robot.source.sha256:
            return []
        return list(_read(robot, path, robot.source.format, pin.GeometryType.VISUAL, most_faces))
    except (OSError, ValueError, RuntimeError, IndexError):
        return []


def _collisions(robot: RobotModel, most_faces: int) -> list[Shape]:
    """Return the collision shapes of the cleaned model."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.xml"
        path.write_text(robot.source.xml, encoding="utf-8")
        return list(_read(robot, path, robot.source.format, pin.GeometryType.COLLISION, most_faces))


def _read(robot: RobotModel, path: Path, model_format: str, what: Any, most_faces: int) -> Iterator[Shape]:
    """Yield the shapes of a file on the robot's links, matched by link name."""
    if model_format == "urdf":
        model = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
        geometry = pin.buildGeomFromUrdf(model, str(path), what, package_dirs=_package_folders(path))
    else:
        model = pin.buildModelFromMJCF(str(path))
        geometry = pin.buildGeomFromMJCF(model, str(path), what)
    links = {str(f.name): f for f in robot.pinocchio.frames if f.type == pin.FrameType.BODY}
    for shape in geometry.geometryObjects:
        theirs = model.frames[shape.parentFrame]
        ours = links.get(str(theirs.name))
        form = None if ours is None else _form(shape, most_faces)
        if ours is None or form is None:
            continue
        placement = ours.placement * theirs.placement.inverse() * shape.placement
        joint = int(ours.parentJoint)
        yield Shape(joint, _part(robot, joint), *form[:2], np.array(placement.rotation), placement.translation, form[2])


def _package_folders(path: Path) -> list[str]:
    """Return the folders to resolve package://NAME/... in: all parents of the file."""
    return [str(folder) for folder in path.resolve().parents]


def _form(shape: Any, most_faces: int) -> tuple[Kind, tuple[float, ...], Mesh | None] | None:
    """Return kind, size and triangles of a Pinocchio shape; None for unsupported ones such as planes."""
    geometry = shape.geometry
    name = type(geometry).__name__
    if name == "Box":
        return "box", tuple(2 * float(half) for half in geometry.halfSide), None
    if name == "Sphere":
        return "sphere", (float(geometry.radius),), None
    if name in ("Cylinder", "Capsule"):
        kind: Kind = "cylinder" if name == "Cylinder" else "capsule"
        return kind, (float(geometry.radius), 2 * float(geometry.halfLength)), None
    if not hasattr(geometry, "tri_indices"):
        return None
    triangles = (geometry.tri_indices(index) for index in range(geometry.num_tris))
    faces = np.array([[t[0], t[1], t[2]] for t in triangles], dtype=np.int64)
    return "mesh", (), _coarser(_mended(Mesh(np.array(geometry.vertices(), dtype=float), faces)), most_faces)


def _mended(mesh: Mesh) -> Mesh:
    """Return the mesh, or its convex hull if some vertices belong to no triangle.

    In files of several parts coal 3.0 numbers the vertices of each part from zero, so triangles have wrong vertices.
    """
    if len(np.unique(mesh.faces)) == len(mesh.vertices):
        return mesh
    hull = ConvexHull(mesh.vertices)
    faces, normals = np.asarray(hull.simplices, dtype=np.int64), np.asarray(hull.equations)[:, :3]
    a, b, c = (mesh.vertices[faces[:, corner]] for corner in range(3))
    inward = np.einsum("ni,ni->n", np.cross(b - a, c - a), normals) < 0
    faces[inward] = faces[inward][:, ::-1]
    used, faces = np.unique(faces, return_inverse=True)
    return Mesh(mesh.vertices[used], faces.reshape(-1, 3))


def _coarser(mesh: Mesh, most_faces: int) -> Mesh:
    """Return the mesh, with vertices merged in grid cells if it has too many faces."""
    if len(mesh.faces) <= most_faces:
        return mesh
    cell = float(np.ptp(mesh.vertices, axis=0).max()) / np.sqrt(most_faces / _FACES_OF_GRID)
    _, first, merged = np.unique(np.rint(mesh.vertices / cell), axis=0, return_index=True, return_inverse=True)
    faces = merged.reshape(-1)[mesh.faces]
    a, b, c = faces.T
    return Mesh(mesh.vertices[first], np.unique(faces[(a != b) & (b != c) & (c != a)], axis=0))


def _stand_ins(robot: RobotModel, found: list[Shape]) -> Iterator[Shape]:
    """Yield shapes for links without any, or with a foot sphere only."""
    shown = {shape.joint for shape in found if shape.kind != "sphere"}
    if BASE_JOINT not in shown:
        edges, middle = trunk_box(robot, around=1.0)
        yield Shape(BASE_JOINT, "base", "box", edges, np.eye(3), middle, stands_in=True)
    for limb in leg_limbs(robot, shown):
        place, size = limb.placement, (limb.radius, limb.length)
        rotation, middle = np.array(place.rotation), np.array(place.translation)
        yield Shape(limb.joint, _part(robot, limb.joint), "capsule", size, rotation, middle, stands_in=True)


def _part(robot: RobotModel, joint: int) -> Part:
    for leg in robot.legs.values():
        if joint in leg.joint_ids:
            parts: tuple[Part, ...] = ("shank", "thigh", "hip")
            return parts[leg.joint_ids[::-1].index(joint)]
    return "base"
