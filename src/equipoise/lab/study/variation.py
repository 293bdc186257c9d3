"""Random robots: a model with varied link lengths, masses and CoM of the base."""

from __future__ import annotations

import dataclasses
import hashlib
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from equipoise.errors import ModelError, ModelWarning, SettingsError
from equipoise.robot.model import RobotModel

LARGEST_SPREAD = 0.3
"""Largest spread at which the legs of the catalogue's robots reach their stance."""

_COM_RATIO = 0.2  # the base's CoM moves by the spread times this fraction of the leg length, along each axis


@dataclass(frozen=True)
class SegmentVariation:
    """Variation of the links of one segment: the base, all hips, all thighs or all shanks.

    Attributes:
        length: factor on every position in the links' frames.
        mass: factor on the links' masses; inertias scale with mass times length squared.
        com_shift: (3,) shift of the masses in the links' frames [m], only of the base.
    """

    length: float
    mass: float
    com_shift: tuple[float, float, float] = (0.0, 0.0, 0.0)


def vary(robot: RobotModel, spread: float, generator: np.random.Generator) -> RobotModel:
    """Return a robot with randomly varied lengths and masses of its segments, and a shifted CoM of the base.

    All four legs vary alike, so that the robot stands level. Links whose mass follows from their shapes (MJCF without an
    inertial) keep it.

    Args:
        spread: standard deviation of the factors' logarithms, truncated at two standard deviations; 0: the same robot.

    Raises:
        SettingsError: the spread is out of range.
    """
    if not 0 <= spread <= LARGEST_SPREAD:
        raise SettingsError(f"the spread of random robots is {spread:g}; it must be from 0 to {LARGEST_SPREAD:g}")

    def factor() -> float:
        return float(np.exp(spread * np.clip(generator.standard_normal(), -2, 2)))

    joints = len(next(iter(robot.legs.values())).joints)
    shift = _COM_RATIO * spread * robot.leg_length * np.clip(generator.standard_normal(3), -2, 2)
    base = SegmentVariation(factor(), factor(), (float(shift[0]), float(shift[1]), float(shift[2])))
    return with_segments(robot, base, [SegmentVariation(factor(), factor()) for _ in range(joints)])


def with_segments(robot: RobotModel, base: SegmentVariation, legs: list[SegmentVariation]) -> RobotModel:
    """Return the robot with varied base and leg segments, from the hip down."""
    root = ET.fromstring(robot.source.xml)
    walk = {"urdf": _urdf_links, "mjcf": _mjcf_links}[robot.source.format]
    depth = {name: index for leg in robot.legs.values() for index, name in enumerate(leg.joint_names)}
    for level, elements in walk(root, depth):
        _change(elements, base if level is None else legs[level])
    xml = ET.tostring(root, encoding="unicode")
    source = dataclasses.replace(robot.source, xml=xml, sha256=hashlib.sha256(xml.encode()).hexdigest(), repairs=())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)  # already issued when the original was loaded
        return RobotModel.from_source(source, robot.name, robot.description)


def _urdf_links(root: ET.Element, depth: dict[str, int]) -> Iterator[tuple[int | None, list[ET.Element]]]:
    """Yield each link of a URDF with its child joints, and the depth of the leg joint that moves it."""
    joints = root.findall("joint")
    parent_joint = {_named(joint, "child"): joint for joint in joints}
    for link in root.findall("link"):
        level, above = None, parent_joint.get(link.get("name", ""))
        while above is not None and level is None:
            level = depth.get(above.get("name", ""))
            above = parent_joint.get(_named(above, "parent"))
        hanging = [joint for joint in joints if _named(joint, "parent") == link.get("name")]
        yield level, [*hanging, *link]


def _named(joint: ET.Element, role: str) -> str:
    element = joint.find(role)
    return "" if element is None else element.get("link", "")


def _mjcf_links(root: ET.Element, depth: dict[str, int]) -> Iterator[tuple[int | None, list[ET.Element]]]:
    """Yield each body of an MJCF with its elements, and the depth of the leg joint that moves it."""

    def visit(body: ET.Element, level: int | None) -> Iterator[tuple[int | None, list[ET.Element]]]:
        levels = [depth[name] for joint in body.findall("joint") if (name := joint.get("name", "")) in depth]
        level = levels[-1] if levels else level
        yield level, list(body)
        for child in body.findall("body"):
            yield from visit(child, level)

    trunk = root.find("worldbody/body")
    if trunk is None:
        raise ModelError("the MJCF model has no body")
    yield from visit(trunk, None)


def _change(elements: list[ET.Element], segment: SegmentVariation) -> None:
    """Scale the positions in a link's frame, and change its inertial."""

    def scaled(values: list[float]) -> list[float]:
        return [segment.length * value for value in values]

    def moved(values: list[float]) -> list[float]:
        return [segment.length * value + shift for value, shift in zip(values, segment.com_shift, strict=True)]

    for element in elements:
        if element.tag == "inertial":
            _edit(element, "pos", moved)
            for origin in element.findall("origin"):
                _edit(origin, "xyz", moved)
            _change_inertial(element, segment)
            continue
        for key in ("pos", "fromto"):
            _edit(element, key, scaled)
        for origin in element.findall("origin"):
            _edit(origin, "xyz", scaled)


def _change_inertial(inertial: ET.Element, segment: SegmentVariation) -> None:
    moment = segment.mass * segment.length**2
    for element in inertial.iter():
        for key in ("value", "mass"):
            _edit(element, key, lambda values: [segment.mass * value for value in values])
        for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz", "diaginertia", "fullinertia"):
            _edit(element, key, lambda values: [moment * value for value in values])


def _edit(element: ET.Element, key: str, change: Callable[[list[float]], list[float]]) -> None:
    text = element.get(key)
    if text is not None:
        element.set(key, " ".join(repr(value) for value in change([float(word) for word in text.split()])))
