"""Cleaning of the joints of URDF files: their axes and limits."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from equipoise.errors import ModelError
from equipoise.robot.cleaning.urdf_text import child, number, tidy_vector, words

# Range of a joint without limits [rad]; one turn to either side exceeds any posture of a leg.
UNLIMITED_JOINT_RANGE = 2 * math.pi
Coupling = tuple[str, tuple[str, ...]]
"""Element of a file that couples joints, and their names."""
_BOUNDS = ("lower", "upper")
SMALLEST_AXIS = 1e-6
"""Length below which an axis has no direction; other readers normalise any."""


def couplings_of(root: ET.Element) -> list[Coupling]:
    """Return the joints that <mimic> couples, the follower first."""
    return [
        ("<mimic>", (joint.get("name", ""), mimic.get("joint", "")))
        for joint in root.findall("joint")
        for mimic in joint.findall("mimic")
    ]


def fix_locked_joints(root: ET.Element, path: Path) -> dict[str, float]:
    """Make joints whose limits are equal fixed, in place; returns their positions by name [rad or m]."""
    locked: dict[str, float] = {}
    for joint in root.findall("joint"):
        limit = joint.find("limit")
        if joint.get("type") not in ("revolute", "prismatic") or limit is None or not {*_BOUNDS} & {*limit.attrib}:
            continue
        lower, upper = (_limit(limit, key, joint, path) for key in _BOUNDS)
        if lower == upper:
            locked[joint.get("name", "")] = lower
            _fix(joint, lower, path)
            joint.remove(limit)
    return locked


def _fix(joint: ET.Element, position: float, path: Path) -> None:
    """Make a joint fixed at a position [rad or m]."""
    axis = _axis_of(joint, path)
    if position != 0:
        origin = child(joint, "origin")
        xyz, rpy = (np.array([float(word) for word in origin.get(key, "0 0 0").split()]) for key in ("xyz", "rpy"))
        rotation = pin.rpy.rpyToMatrix(rpy)
        if joint.get("type") == "prismatic":
            xyz = xyz + rotation @ axis * position
        else:
            rpy = pin.rpy.matrixToRpy(rotation @ pin.exp3(position * axis))
        origin.set("xyz", words(xyz))
        origin.set("rpy", words(rpy))
    joint.set("type", "fixed")


def clean_joints(root: ET.Element, path: Path) -> Iterator[str]:
    """Clean joints in place; yields a sentence for each change that concerns the user."""
    unlimited: list[str] = []
    for joint in root.findall("joint"):
        if joint.get("type") in ("revolute", "continuous", "prismatic"):
            _axis_of(joint, path)
            yield from _clean_limit(joint, path, unlimited)
        for tag in ("mimic", "safety_controller", "calibration"):
            for element in joint.findall(tag):
                joint.remove(element)
    if unlimited:
        yield (
            f"joints without position limits get {UNLIMITED_JOINT_RANGE:.2f} rad to either side: "
            f"{', '.join(unlimited)}; give lower and upper of their <limit>, or joint_limits in a robot configuration"
        )


def _clean_limit(joint: ET.Element, path: Path, unlimited: list[str]) -> Iterator[str]:
    """Write all four numbers of a joint's <limit>; a joint that has neither bound is added to `unlimited`."""
    limit, name = child(joint, "limit"), joint.get("name")
    given = [key for key in _BOUNDS if key in limit.attrib]
    if joint.get("type") == "continuous" or not given:
        if joint.get("type") != "continuous":
            unlimited.append(str(name))
        limit.attrib |= {"lower": str(-UNLIMITED_JOINT_RANGE), "upper": str(UNLIMITED_JOINT_RANGE)}
    if len(given) == 1 and joint.get("type") != "continuous":
        missing = "lower" if given == ["upper"] else "upper"
        yield f"joint {name!r} has no {missing} limit, which is 0 in URDF"
    if joint.get("type") == "continuous":
        joint.set("type", "revolute")
    for key in (*_BOUNDS, "effort", "velocity"):
        limit.set(key, str(_limit(limit, key, joint, path)))
    lower, upper = float(limit.get("lower", "0")), float(limit.get("upper", "0"))
    if lower > upper:
        raise ModelError(
            f"robot model {str(path)!r}: joint {name!r} has the limits {lower:g} to {upper:g}, which are exchanged: lower "
            "must be the smaller one; a missing one is 0"
        )


def _limit(limit: ET.Element, key: str, joint: ET.Element, path: Path) -> float:
    return number(limit.get(key), 0.0, f"joint {joint.get('name')!r}: {key}", path)


def _axis_of(joint: ET.Element, path: Path) -> NDArray[np.float64]:
    """Return the unit axis of a joint; raises ModelError if it has no direction."""
    element, what = joint.find("axis"), f"joint {joint.get('name')!r}: xyz of its <axis>"
    tidy_vector(element, "xyz", what, path)
    text = "1 0 0" if element is None else element.get("xyz", "1 0 0")
    axis = np.array([float(word) for word in text.split()])
    length = float(np.linalg.norm(axis))
    if not length > SMALLEST_AXIS:
        raise ModelError(
            f"robot model {str(path)!r}: joint {joint.get('name')!r}: axis {text} has no direction; give the axis that it "
            "moves about or along, as 0 1 0, or make the joint fixed"
        )
    return axis / length
