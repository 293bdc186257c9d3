"""Poses in MJCF: the ways of writing an orientation made one, and frames written into what they hold."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

ORIENTATIONS = ("quat", "axisangle", "xyaxes", "zaxis", "euler")
_PLACED = ("body", "geom", "site", "inertial", "frame")


@dataclass(frozen=True)
class AngleConvention:
    """How a file writes angles: `unit` in radians, and the axes of Euler angles (lower case: each in the turned frame)."""

    unit: float
    euler_sequence: str

    @classmethod
    def of(cls, root: ET.Element) -> AngleConvention:
        """Of a file that has one <compiler> at most. MuJoCo's defaults are degrees and xyz."""
        found = root.find("compiler")
        compiler = ET.Element("compiler") if found is None else found
        unit = 1.0 if compiler.get("angle", "degree") == "radian" else np.pi / 180
        return cls(unit, compiler.get("eulerseq", "xyz"))


def write_plain_poses(root: ET.Element) -> None:
    """Dissolve frames and turn orientations that readers disagree on into `xyaxes`, in place.

    Pinocchio passes over frames, does not normalise the axis of `axisangle` and reads every Euler sequence as turned.

    Raises:
        ValueError: a number that is none.
    """
    convention = AngleConvention.of(root)
    for world in root.findall("worldbody"):
        _dissolve_frames(world, convention)
        for element in world.iter():
            if element.tag in _PLACED and ("euler" in element.attrib or "axisangle" in element.attrib):
                _set_orientation(element, orientation(element, convention))


def orientation(element: ET.Element, convention: AngleConvention) -> FloatArray:
    """(3, 3) axes of an element in its parent's."""
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
        return _turned(numbers[:3], convention.unit * float(numbers[3]))
    if key == "xyaxes":
        x = numbers[:3] / np.linalg.norm(numbers[:3])
        y = numbers[3:] - (numbers[3:] @ x) * x
        y = y / np.linalg.norm(y)
        return np.column_stack([x, y, np.cross(x, y)])
    if key == "zaxis":
        z = numbers / np.linalg.norm(numbers)
        across = np.cross([0.0, 0.0, 1.0], z)
        return _turned(
            across if across.any() else np.array([1.0, 0, 0]), float(np.arctan2(np.linalg.norm(across), z[2]))
        )
    w, *xyz = numbers / np.linalg.norm(numbers)
    return _turned(np.array(xyz), 2 * float(np.arctan2(np.linalg.norm(xyz), w))) if np.any(xyz) else np.eye(3)


def _turned(axis: FloatArray, angle: float) -> FloatArray:
    """(3, 3) rotation about an axis of any length, by Rodrigues' formula."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def _dissolve_frames(parent: ET.Element, convention: AngleConvention) -> None:
    """Put what frames hold in their place, moved and turned as they are."""
    for child in list(parent):
        if child.tag in ("body", "frame"):
            _dissolve_frames(child, convention)
        if child.tag == "frame":
            place = list(parent).index(child)
            parent.remove(child)
            translation, rotation = _numbers(child, "pos", "0 0 0"), orientation(child, convention)
            for offset, held in enumerate(child):
                _move(held, translation, rotation, convention)
                parent.insert(place + offset, held)


def _move(element: ET.Element, translation: FloatArray, rotation: FloatArray, convention: AngleConvention) -> None:
    if "fromto" in element.attrib:
        ends = _numbers(element, "fromto").reshape(2, 3) @ rotation.T + translation
        element.set("fromto", _text(ends.ravel()))
        return
    element.set("pos", _text(rotation @ _numbers(element, "pos", "0 0 0") + translation))
    if element.tag == "joint":
        element.set("axis", _text(rotation @ _numbers(element, "axis", "0 0 1")))
    elif element.tag in _PLACED:
        _set_orientation(element, rotation @ orientation(element, convention))


def _set_orientation(element: ET.Element, rotation: FloatArray) -> None:
    for key in ORIENTATIONS:
        element.attrib.pop(key, None)
    element.set("xyaxes", _text(rotation.T[:2].ravel()))


def _numbers(element: ET.Element, key: str, default: str = "") -> FloatArray:
    try:
        return np.array([float(word) for word in element.get(key, default).split()])
    except ValueError:
        raise ValueError(f"<{element.tag}> has {key}={element.get(key)!r}, which are not numbers") from None


def _text(numbers: FloatArray) -> str:
    return " ".join(repr(float(number)) for number in numbers)
