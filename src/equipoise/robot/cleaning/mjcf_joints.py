"""Cleaning of the joints of MJCF files: their axes, limits and couplings."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from equipoise.errors import ModelError
from equipoise.robot.cleaning.mjcf_poses import angle_unit, fold_reference
from equipoise.robot.cleaning.urdf_joints import SMALLEST_AXIS, Coupling

_FEWEST_LEG_JOINTS = 8  # of a quadruped: four legs of two
_MOVED_BY_TENDON = ("stiffness", "range", "springlength")


def base_body(root: ET.Element, path: Path) -> ET.Element:
    """Return the body with a free joint; raises ModelError if there is none."""
    bodies = [body for world in root.findall("worldbody") for body in world.findall("body")]
    for body in bodies:
        free = body.find("freejoint") is not None or any(j.get("type") == "free" for j in body.findall("joint"))
        if free:
            return body
    raise ModelError(f"robot model {str(path)!r} {_without_base(bodies)}")


def _without_base(bodies: list[ET.Element]) -> str:
    """Describe the defect of a file without a free joint."""
    if not bodies:
        return "has no <body> in its <worldbody>"
    largest = max(bodies, key=lambda body: len(list(body.iter("joint"))))
    legs = len(list(largest.iter("joint"))) >= _FEWEST_LEG_JOINTS
    moving = [body for body in ([largest] if legs else bodies) if body.find("joint") is not None]
    names = ", ".join(str(body.get("name")) for body in moving)
    if len(moving) > 1:
        return (
            f"has no trunk: its legs ({names}) are attached to the world, as MuJoCo writes a URDF without a floating joint. "
            "The trunk's mass is not in the file: put the legs and the trunk's geoms into one <body> with a <freejoint/> and "
            "an <inertial>, or give the URDF"
        )
    if moving:
        joints = ", ".join(str(joint.get("name")) for joint in moving[0].findall("joint"))
        return f"has no floating base: replace the joints of {names} ({joints}) by one <freejoint/>"
    return "has no floating base: give the trunk's body a <freejoint/>"


def clean_joints(root: ET.Element, base: ET.Element, path: Path) -> dict[str, float]:
    """Make joints whose limits are equal fixed, in place; returns their positions by name [rad or m].

    Raises:
        ModelError: a joint without axis, with exchanged limits, or limited without a range.
    """
    locked: dict[str, float] = {}
    for body in base.iter("body"):
        for joint in [joint for joint in body.findall("joint") if joint.get("type", "hinge") in ("hinge", "slide")]:
            if (position := _locked_at(joint, f"robot model {str(path)!r}: joint {joint.get('name')!r}")) is None:
                continue
            joint.set("ref", repr(-position))
            fold_reference(body, root)
            body.remove(joint)
            unit = angle_unit(root) if joint.get("type", "hinge") == "hinge" else 1.0
            locked[joint.get("name", "")] = position * unit
    return locked


def _locked_at(joint: ET.Element, where: str) -> float | None:
    """Return the position at which a joint's limits lock it, in the file's unit; None if it can move."""
    axis = joint.get("axis", "0 0 1")
    if not np.linalg.norm([float(word) for word in axis.split()]) > SMALLEST_AXIS:
        raise ModelError(
            f"{where}: axis {axis} has no direction; give the axis that it moves about or along, as 0 1 0, or remove it"
        )
    if "range" not in joint.attrib:
        if joint.get("limited") == "true":
            raise ModelError(f"{where} is limited and has no range; give a range, or remove limited")
        return None
    lower, upper = (float(word) for word in joint.get("range", "").split())
    if lower > upper:
        raise ModelError(
            f"{where} has the range {lower:g} to {upper:g}, whose ends are exchanged: the smaller one comes first"
        )
    return lower if lower == upper else None


def couplings_of(root: ET.Element) -> list[Coupling]:
    """Return the couplings of joints by equalities and tendons."""
    tendons = {
        tendon.get("name", ""): tuple(joint.get("joint", "") for joint in tendon.findall("joint"))
        for tendon in root.iterfind("tendon/fixed")
    }
    moving = {element.get("tendon", "") for element in root.iterfind("actuator/*")}
    moving |= {
        t.get("name", "") for t in root.iterfind("tendon/fixed") if any(key in t.attrib for key in _MOVED_BY_TENDON)
    }
    by_tendon = [("<tendon>", joints) for name, joints in tendons.items() if name in moving and len(joints) > 1]
    return [*_equalities(root, tendons), *by_tendon]


def _equalities(root: ET.Element, tendons: dict[str, tuple[str, ...]]) -> Iterator[Coupling]:
    above = _joints_by_part(root)
    for element in root.iterfind("equality/*"):
        if element.get("active") == "false":
            continue
        ends = [element.get(f"{element.tag}{end}", "") for end in ("1", "2")]
        if element.tag == "joint":
            joints = tuple(name for name in ends if name)
        elif element.tag == "tendon":
            joints = tuple(joint for name in ends for joint in tendons.get(name, ()))
        else:
            parts = [element.get(f"{kind}{end}", "") for kind in ("body", "site") for end in ("1", "2")]
            joints = tuple(joint for part in parts for joint in above.get(part, ()))
        if joints:
            yield f"<equality> <{element.tag}>", joints


def _joints_by_part(root: ET.Element) -> dict[str, tuple[str, ...]]:
    """Return the joints of each body, by its name and by those of its sites."""
    found: dict[str, tuple[str, ...]] = {}
    for body in root.iter("body"):
        joints = tuple(joint.get("name", "") for joint in body.findall("joint") if joint.get("type") != "free")
        found |= dict.fromkeys([part.get("name", "") for part in (body, *body.findall("site"))], joints)
    return found
