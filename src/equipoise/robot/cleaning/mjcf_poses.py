"""Poses in MJCF, in the form that all readers interpret equally."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
import pinocchio as pin

from equipoise.conventions import FloatArray
from equipoise.robot.cleaning.urdf_text import words

_COUNTS = {"quat": 4, "axisangle": 4, "xyaxes": 6, "zaxis": 3, "euler": 3}
ORIENTATIONS = tuple(_COUNTS)
_PLACED = ("body", "geom", "site", "inertial", "frame")


def angle_unit(root: ET.Element) -> float:
    """Return the unit of angles in a file with at most one <compiler> [rad]: by default a degree."""
    return 1.0 if root.find("compiler[@angle='radian']") is not None else np.pi / 180


def write_plain_poses(root: ET.Element) -> None:
    """Dissolve frames, fold joints' references into their bodies, and write some orientations as `xyaxes`, in place.

    Pinocchio ignores frames, shifts limits by the reference, does not normalise the axis of `axisangle` and reads every
    Euler sequence as intrinsic.

    Raises:
        ValueError: an invalid number, or a reference that cannot be folded.
    """
    for world in root.findall("worldbody"):
        _dissolve_frames(world, root)
        for body in world.iter("body"):
            fold_reference(body, root)
        for element in world.iter():
            if element.tag in _PLACED and ("euler" in element.attrib or "axisangle" in element.attrib):
                _set_orientation(element, orientation(element, root))


def orientation(element: ET.Element, root: ET.Element) -> FloatArray:
    """Return the (3, 3) axes of an element of a file in its parent's."""
    for key in ORIENTATIONS:
        if key in element.attrib:
            break
    else:
        return np.eye(3)
    numbers = _numbers(element, key, "", _COUNTS[key])
    if key == "euler":
        rotation, compiler = np.eye(3), root.find("compiler")
        sequence = "xyz" if compiler is None else compiler.get("eulerseq", "xyz")
        for letter, angle in zip(sequence, angle_unit(root) * numbers, strict=True):
            turn = pin.exp3(angle * np.eye(3)["xyz".index(letter.lower())])
            rotation = rotation @ turn if letter.islower() else turn @ rotation  # lower case: in the turned frame
        return rotation
    if key == "axisangle":
        return pin.exp3(angle_unit(root) * numbers[3] * _unit(numbers[:3], element))
    if key == "xyaxes":
        x = _unit(numbers[:3], element)
        y = _unit(numbers[3:] - (numbers[3:] @ x) * x, element)
        return np.column_stack([x, y, np.cross(x, y)])
    if key == "zaxis":
        x, y, z = _unit(numbers, element)
        axis = np.array([-y, x, 0.0]) / np.hypot(x, y) if np.hypot(x, y) > 1e-12 else np.array([1.0, 0.0, 0.0])
        return pin.exp3(np.arctan2(np.hypot(x, y), z) * axis)
    w, x, y, z = _unit(numbers, element)
    return pin.Quaternion(np.array([x, y, z, w])).matrix()


def _unit(vector: FloatArray, element: ET.Element) -> FloatArray:
    length = np.linalg.norm(vector)
    if length == 0:
        raise ValueError(f"<{element.tag}> has an orientation whose axes or quaternion have no direction")
    return vector / length


def _dissolve_frames(parent: ET.Element, root: ET.Element) -> None:
    """Replace frames by their children, moved and rotated accordingly."""
    for child in list(parent):
        if child.tag in ("body", "frame"):
            _dissolve_frames(child, root)
        if child.tag == "frame":
            place = list(parent).index(child)
            parent.remove(child)
            translation, rotation = _numbers(child, "pos", "0 0 0"), orientation(child, root)
            for offset, element in enumerate(child):
                _move(element, translation, rotation, root)
                parent.insert(place + offset, element)


def fold_reference(body: ET.Element, root: ET.Element) -> None:
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
        turn, anchor = pin.exp3(-angle_unit(root) * references[0] * axis), _numbers(joints[0], "pos", "0 0 0")
        shift = anchor - turn @ anchor
    rotation = orientation(body, root)
    body.set("pos", words(_numbers(body, "pos", "0 0 0") + rotation @ shift))
    _set_orientation(body, rotation @ turn)


def _move(element: ET.Element, translation: FloatArray, rotation: FloatArray, root: ET.Element) -> None:
    if "fromto" in element.attrib:
        ends = _numbers(element, "fromto", "", 6).reshape(2, 3) @ rotation.T + translation
        element.set("fromto", words(ends.ravel()))
        return
    element.set("pos", words(rotation @ _numbers(element, "pos", "0 0 0") + translation))
    if element.tag == "joint":
        element.set("axis", words(rotation @ _numbers(element, "axis", "0 0 1")))
    elif element.tag in _PLACED:
        _set_orientation(element, rotation @ orientation(element, root))


def _set_orientation(element: ET.Element, rotation: FloatArray) -> None:
    for key in ORIENTATIONS:
        element.attrib.pop(key, None)
    element.set("xyaxes", words(rotation.T[:2].ravel()))


def _numbers(element: ET.Element, key: str, default: str, count: int = 3) -> FloatArray:
    try:
        numbers = np.array([float(word) for word in element.get(key, default).split()])
    except ValueError:
        numbers = np.array([np.nan])
    if not np.isfinite(numbers).all():
        raise ValueError(f"<{element.tag}> has {key}={element.get(key)!r}; every number must be finite")
    if len(numbers) != count:
        raise ValueError(f"<{element.tag}> has {key}={element.get(key)!r}; it must have {count} numbers")
    return numbers
