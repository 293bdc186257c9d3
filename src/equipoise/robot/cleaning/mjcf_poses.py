"""Poses in MJCF, in the form that all readers interpret equally."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.robot.cleaning.urdf_text import words

ORIENTATIONS = ("quat", "axisangle", "xyaxes", "zaxis", "euler")
_PLACED = ("body", "geom", "site", "inertial", "frame")


@dataclass(frozen=True)
class AngleConvention:
    """Form of angles in a file: `unit` in radians, and the axes of Euler angles (lower case: each in the turned frame)."""

    unit: float
    euler_sequence: str

    @classmethod
    def of(cls, root: ET.Element) -> AngleConvention:
        """Return the convention of a file that has one <compiler> at most. MuJoCo's defaults are degrees and xyz."""
        found = root.find("compiler")
        compiler = ET.Element("compiler") if found is None else found
        unit = 1.0 if compiler.get("angle", "degree") == "radian" else np.pi / 180
        return cls(unit, compiler.get("eulerseq", "xyz"))


def write_plain_poses(root: ET.Element) -> None:
    """Dissolve frames, fold joints' references into their bodies, and write some orientations as `xyaxes`, in place.

    Pinocchio ignores frames, shifts limits by the reference, does not normalise the axis of `axisangle` and reads every
    Euler sequence as intrinsic.

    Raises:
        ValueError: an invalid number, or a reference that cannot be folded.
    """
    convention = AngleConvention.of(root)
    for world in root.findall("worldbody"):
        _dissolve_frames(world, convention)
        for body in world.iter("body"):
            fold_reference(body, convention)
        for element in world.iter():
            if element.tag in _PLACED and ("euler" in element.attrib or "axisangle" in element.attrib):
                _set_orientation(element, orientation(element, convention))


def orientation(element: ET.Element, convention: AngleConvention) -> FloatArray:
    """Return the (3, 3) axes of an element in its parent's."""
    for key in ORIENTATIONS:
        if key in element.attrib:
            break
    else:
        return np.eye(3)
    numbers = _numbers(element, key)
    if key == "euler":
        rotation = np.eye(3)
        for letter, angle in zip(convention.euler_sequence, numbers, strict=True):
            turn = _turned(np.eye(3)["xyz".index(letter.lower())], convention.unit * angle)
            rotation = rotation @ turn if letter.islower() else turn @ rotation
        return rotation
    if key == "axisangle":
        return _turned(_unit(numbers[:3], element), convention.unit * float(numbers[3]))
    if key == "xyaxes":
        x = _unit(numbers[:3], element)
        y = _unit(numbers[3:] - (numbers[3:] @ x) * x, element)
        return np.column_stack([x, y, np.cross(x, y)])
    if key == "zaxis":
        z = _unit(numbers, element)
        return _turned(np.cross([0.0, 0.0, 1.0], z), float(np.arctan2(np.hypot(z[0], z[1]), z[2])))
    w, *xyz = _unit(numbers, element)
    return _turned(np.array(xyz), 2 * float(np.arctan2(np.linalg.norm(xyz), w)))


def _unit(vector: FloatArray, element: ET.Element) -> FloatArray:
    length = np.linalg.norm(vector)
    if length == 0:
        raise ValueError(f"<{element.tag}> has an orientation whose axes or quaternion have no direction")
    return vector / length


def _turned(axis: FloatArray, angle: float) -> FloatArray:
    """Return the (3, 3) rotation about an axis of any length (Rodrigues' formula); about x if the axis has no direction."""
    length = np.linalg.norm(axis)
    x, y, z = axis / length if length > 1e-12 else (1.0, 0.0, 0.0)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def _dissolve_frames(parent: ET.Element, convention: AngleConvention) -> None:
    """Replace frames by their children, moved and rotated accordingly."""
    for child in list(parent):
        if child.tag in ("body", "frame"):
            _dissolve_frames(child, convention)
        if child.tag == "frame":
            place = list(parent).index(child)
            parent.remove(child)
            translation, rotation = _numbers(child, "pos", "0 0 0"), orientation(child, convention)
            for offset, element in enumerate(child):
                _move(element, translation, rotation, convention)
                parent.insert(place + offset, element)


def fold_reference(body: ET.Element, convention: AngleConvention) -> None:
    """Rotate the body from its joint's reference, the pose of the file, to the joint's zero."""
    joints = body.findall("joint")
    references = [float(joint.attrib.pop("ref", "0")) for joint in joints]
    if not any(references):
        return
    if len(joints) > 1:
        raise ValueError(f"body {body.get('name')!r} has several joints, one with a 'ref', which is not read")
    axis = _unit(_numbers(joints[0], "axis", "0 0 1"), joints[0])
    if joints[0].get("type") == "slide":
        turn, shift = np.eye(3), -references[0] * axis
    else:
        turn, anchor = _turned(axis, -convention.unit * references[0]), _numbers(joints[0], "pos", "0 0 0")
        shift = anchor - turn @ anchor
    rotation = orientation(body, convention)
    body.set("pos", words(_numbers(body, "pos", "0 0 0") + rotation @ shift))
    _set_orientation(body, rotation @ turn)


def _move(element: ET.Element, translation: FloatArray, rotation: FloatArray, convention: AngleConvention) -> None:
    if "fromto" in element.attrib:
        ends = _numbers(element, "fromto").reshape(2, 3) @ rotation.T + translation
        element.set("fromto", words(ends.ravel()))
        return
    element.set("pos", words(rotation @ _numbers(element, "pos", "0 0 0") + translation))
    if element.tag == "joint":
        element.set("axis", words(rotation @ _numbers(element, "axis", "0 0 1")))
    elif element.tag in _PLACED:
        _set_orientation(element, rotation @ orientation(element, convention))


def _set_orientation(element: ET.Element, rotation: FloatArray) -> None:
    for key in ORIENTATIONS:
        element.attrib.pop(key, None)
    element.set("xyaxes", words(rotation.T[:2].ravel()))


def _numbers(element: ET.Element, key: str, default: str = "") -> FloatArray:
    try:
        numbers = np.array([float(word) for word in element.get(key, default).split()])
    except ValueError:
        numbers = np.array([np.nan])
    if not np.isfinite(numbers).all():
        raise ValueError(f"<{element.tag}> has {key}={element.get(key)!r}; every number must be finite")
    return numbers
