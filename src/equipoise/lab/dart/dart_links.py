"""Links of a robot model file for DART: DART's own reader for URDF, and a reader of cleaned MJCF."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

import dartpy
import numpy as np
from dartpy import dynamics

from equipoise.conventions import FloatArray
from equipoise.errors import ModelError
from equipoise.robot.cleaning.mjcf_poses import AngleConvention, orientation
from equipoise.robot.inertial import InertialParameters
from equipoise.robot.source import ModelSource

_WATER = 1000.0  # [kg/m3], MuJoCo's default density of shapes
_TENSOR_ORDER = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])  # of MJCF's fullinertia: xx yy zz xy xz yz


@dataclass(frozen=True, eq=False)
class Axis:
    """Joint axis of a link, hinge or slide.

    Attributes:
        name: name of the joint.
        kind: kind of joint, "hinge" or "slide".
        direction: (3,) unit vector in the link's frame.
        anchor: (3,) point on the axis in the link's frame [m].
    """

    name: str
    kind: Literal["hinge", "slide"]
    direction: FloatArray
    anchor: FloatArray

    def moved(self, position: float) -> FloatArray:
        """Return the (4, 4) pose of the moved link relative to its pose at zero."""
        if self.kind == "slide":
            return pose_of(np.eye(3), position * self.direction)
        rotation = np.array(dartpy.math.expMapRot(position * self.direction))
        return pose_of(rotation, self.anchor - rotation @ self.anchor)


@dataclass(frozen=True, eq=False)
class KinematicLink:
    """Link of a model file.

    Attributes:
        name: name of the link.
        parent: name of its parent; None for the base.
        placement: (4, 4) pose of its frame in its parent's, joints at zero.
        axes: axes of its joints, in order from the parent.
        parts: inertial parameters of its parts in its frame; empty: no mass.
    """

    name: str
    parent: str | None
    placement: FloatArray
    axes: tuple[Axis, ...]
    parts: tuple[InertialParameters, ...]


def read_links(source: ModelSource) -> list[KinematicLink]:
    """Return every link of the cleaned file, parents before children.

    Raises:
        ModelError: DART cannot read the file.
    """
    return list(_urdf_links(source) if source.format == "urdf" else _mjcf_links(source))


def pose_of(rotation: FloatArray, translation: FloatArray) -> FloatArray:
    """Return the (4, 4) pose of a rotation and a translation."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, translation
    return pose


def moved_by(pose: FloatArray, body: InertialParameters) -> InertialParameters:
    """Transform a body from a frame with a (4, 4) pose."""
    rotation = pose[:3, :3]
    return InertialParameters(body.mass, pose[:3, 3] + rotation @ body.com, rotation @ body.inertia @ rotation.T)


def _urdf_links(source: ModelSource) -> Iterator[KinematicLink]:
    skeleton = dartpy.utils.DartLoader().parseSkeletonString(
        source.xml, dartpy.common.Uri(), dartpy.utils.DartResourceRetriever()
    )
    if skeleton is None:
        raise ModelError(f"DART cannot make a model of {str(source.path)!r}")
    # DART adds a default inertial to links without one.
    with_inertial = {
        link.get("name") for link in ET.fromstring(source.xml).findall("link") if link.find("inertial") is not None
    }
    for node in skeleton.getBodyNodes():
        joint, parent, name = node.getParentJoint(), node.getParentBodyNode(), node.getName()
        inertia = node.getInertia()
        own = InertialParameters(inertia.getMass(), inertia.getLocalCOM(), inertia.getMoment())
        parts = (own,) if name in with_inertial else ()
        if parent is None:
            yield KinematicLink(name, None, np.eye(4), (), parts)
            continue
        placement = np.array(joint.getTransformFromParentBodyNode().matrix())
        yield KinematicLink(name, parent.getName(), placement, tuple(_urdf_axes(joint)), parts)


def _urdf_axes(joint: dynamics.Joint) -> Iterator[Axis]:
    """Yield the axis of a joint, which DART's URDF reader puts in the link's origin."""
    if isinstance(joint, dynamics.RevoluteJoint):
        yield Axis(joint.getName(), "hinge", np.array(joint.getAxis()), np.zeros(3))
    elif isinstance(joint, dynamics.PrismaticJoint):
        yield Axis(joint.getName(), "slide", np.array(joint.getAxis()), np.zeros(3))


def _mjcf_links(source: ModelSource) -> Iterator[KinematicLink]:
    root = ET.fromstring(source.xml)
    base = root.find("worldbody/body")
    assert base is not None  # a cleaned file has one
    yield from _mjcf_body(base, None, AngleConvention.of(root))


def _mjcf_body(body: ET.Element, parent: str | None, convention: AngleConvention) -> Iterator[KinematicLink]:
    name = body.get("name", "")
    axes = () if parent is None else tuple(_mjcf_axes(body))
    yield KinematicLink(name, parent, _pose(body, convention), axes, tuple(_mjcf_parts(body, convention)))
    for child in body.findall("body"):
        yield from _mjcf_body(child, name, convention)


def _mjcf_axes(body: ET.Element) -> Iterator[Axis]:
    for joint in body.findall("joint"):
        kind = joint.get("type", "hinge")
        if kind in ("hinge", "slide"):
            direction = _numbers(joint, "axis", "0 0 1")
            anchor = _numbers(joint, "pos", "0 0 0")
            name = joint.get("name", "")
            yield Axis(name, "hinge" if kind == "hinge" else "slide", direction / np.linalg.norm(direction), anchor)


def _mjcf_parts(body: ET.Element, convention: AngleConvention) -> Iterator[InertialParameters]:
    """Yield the inertial, or the shapes if there is none."""
    inertial = body.find("inertial")
    if inertial is None:
        yield from (_shape(geom, convention) for geom in body.findall("geom"))
        return
    if "fullinertia" in inertial.attrib:
        inertia = _numbers(inertial, "fullinertia")[_TENSOR_ORDER]
    else:
        inertia = np.diag(_numbers(inertial, "diaginertia", "0 0 0"))
    own = InertialParameters(float(inertial.get("mass", "0")), np.zeros(3), inertia)
    yield moved_by(_pose(inertial, convention), own)


def _shape(geom: ET.Element, convention: AngleConvention) -> InertialParameters:
    """Return the inertial parameters of a primitive shape from its mass or density."""
    kind, size, pose = geom.get("type", "sphere"), np.resize(_numbers(geom, "size", "0"), 3), _pose(geom, convention)
    if "fromto" in geom.attrib:
        begin, end = _numbers(geom, "fromto").reshape(2, 3)
        turned = ET.Element("geom", {"zaxis": " ".join(repr(float(number)) for number in end - begin)})
        pose = pose_of(orientation(turned, convention), (begin + end) / 2)
        half_length = float(np.linalg.norm(end - begin)) / 2
        size = np.array([size[0], size[0] if kind in ("box", "ellipsoid") else half_length, half_length])
    if kind not in _SHAPES:
        raise ValueError(f"the mass of a geom of type {kind!r} cannot be computed; add an <inertial> to its body")
    shape = _SHAPES[kind](size)
    mass = float(geom.get("mass", float(geom.get("density", _WATER)) * shape.getVolume()))
    return moved_by(pose, InertialParameters(mass, np.zeros(3), shape.computeInertia(mass)))


_SHAPES: dict[str, Callable[[FloatArray], dynamics.Shape]] = {
    "sphere": lambda size: dynamics.SphereShape(size[0]),
    "capsule": lambda size: dynamics.CapsuleShape(size[0], 2 * size[1]),
    "cylinder": lambda size: dynamics.CylinderShape(size[0], 2 * size[1]),
    "box": lambda size: dynamics.BoxShape(2 * size),
    "ellipsoid": lambda size: dynamics.EllipsoidShape(2 * size),
}


def _pose(element: ET.Element, convention: AngleConvention) -> FloatArray:
    return pose_of(orientation(element, convention), _numbers(element, "pos", "0 0 0"))


def _numbers(element: ET.Element, key: str, default: str = "") -> FloatArray:
    return np.array([float(word) for word in element.get(key, default).split()])
