"""Forward axis of the base link: x in most files, y in some. All other modules assume x.

A file with another forward axis gets a new base link above its own, rotated about z. Results are in the new link's axes.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin

from equipoise.conventions import FloatArray
from equipoise.errors import ModelError
from equipoise.robot.description import Forward
from equipoise.robot.source import ModelSource

# Angle about z from the file's x axis to the one that points forward [rad].
_YAW: dict[Forward, float] = {"+x": 0.0, "+y": math.pi / 2, "-x": math.pi, "-y": -math.pi / 2}
_SUFFIX = "_forward"

_WORDS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
_NOISE = {"joint", "j", "motor", "actuator", "link"}
_SIDES = {"left": "L", "l": "L", "right": "R", "r": "R"}
_ENDS = {"front": "F", "fore": "F", "f": "F", "rear": "R", "hind": "R", "back": "R", "h": "R", "b": "R"}
_LEGS = {
    **dict.fromkeys(("fl", "lf"), "FL"),
    **dict.fromkeys(("fr", "rf"), "FR"),
    **dict.fromkeys(("rl", "lr", "hl", "lh", "bl", "lb"), "RL"),
    **dict.fromkeys(("rr", "hr", "rh", "br", "rb"), "RR"),
}


def forward_axis(chains: Sequence[Sequence[str]], hips_in_base: FloatArray, path: Path) -> Forward:
    """Return the forward axis according to the legs' names; x if the names are not those of four legs.

    Args:
        chains: names of each leg's joints.
        hips_in_base: (4, 3) their hips in the file's base frame [m].
        path: path of the file, for the message.

    Raises:
        ModelError: the names fit no axis.
    """
    named = [_named(chain) for chain in chains]
    if len(set(named) - {None}) != 4:
        return "+x"
    if len(set(legs_by_place(hips_in_base))) != 4:  # not in four corners: `name_legs` reports it
        return "+x"
    for axis, yaw in _YAW.items():
        if legs_by_place(hips_in_base, yaw) == named:
            return axis
    places = ", ".join(
        f"{leg} at ({x:.2f}, {y:.2f})" for leg, (x, y, _) in zip(named, hips_in_base.tolist(), strict=True)
    )
    raise ModelError(
        f"robot model {str(path)!r}: the legs' places do not fit their names for any forward axis of the base: "
        f'{places} m; set forward = "+x" (or "+y", "-x", "-y") in a robot configuration to name legs by their places'
    )


def legs_by_place(hips_in_base: FloatArray, yaw: float = 0.0) -> list[str]:
    """Return the names of legs, from the places of their hips relative to each other.

    Args:
        hips_in_base: (4, 3) hips in the base frame [m].
        yaw: angle of the axis that points forward [rad].
    """
    side = hips_in_base - hips_in_base.mean(axis=0)
    ahead = side[:, 0] * math.cos(yaw) + side[:, 1] * math.sin(yaw)
    left = side[:, 1] * math.cos(yaw) - side[:, 0] * math.sin(yaw)
    return [("F" if x > 0 else "R") + ("L" if y > 0 else "R") for x, y in zip(ahead, left, strict=True)]


def turned(source: ModelSource, base_link: str, axis: Forward, described: bool) -> ModelSource:
    """Return the file with a base link whose x axis points forward.

    Args:
        base_link: name of the file's base link.
        axis: its axis that points forward.
        described: whether the robot configuration gives it; otherwise it follows from the legs' names.
    """
    root = ET.fromstring(source.xml)
    (_turn_urdf if source.format == "urdf" else _turn_mjcf)(root, base_link, -_YAW[axis])
    origin = "robot configuration" if described else "names of its legs"
    repair = (
        f"{axis} of {base_link!r} points forward ({origin}): the base frame is {base_link + _SUFFIX!r}, whose x does"
    )
    xml = ET.tostring(root, encoding="unicode")
    return dataclasses.replace(source, xml=xml, forward=axis, repairs=(*source.repairs, repair))


def link_in_file(base_link: str, axis: Forward) -> tuple[str, pin.SE3]:
    """Return the name of the file's own base link, and its placement in the robot's base link.

    Args:
        base_link: name of the robot's base link.
        axis: axis of the file's base link that points forward.
    """
    cosine, sine = round(math.cos(_YAW[axis])), -round(math.sin(_YAW[axis]))
    axes = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    return base_link if axis == "+x" else base_link.removesuffix(_SUFFIX), pin.SE3(axes, np.zeros(3))


def _turn_urdf(root: ET.Element, base_link: str, yaw: float) -> None:
    above = ET.SubElement(root, "link", name=base_link + _SUFFIX).attrib["name"]
    joint = ET.SubElement(root, "joint", name=f"{above}_joint", type="fixed")
    ET.SubElement(joint, "origin", xyz="0 0 0", rpy=f"0 0 {yaw!r}")
    ET.SubElement(joint, "parent", link=above)
    ET.SubElement(joint, "child", link=base_link)


def _turn_mjcf(root: ET.Element, base_link: str, yaw: float) -> None:
    (world,) = root.findall("worldbody")
    (base,) = world.findall("body")
    world.remove(base)
    above = ET.SubElement(world, "body", name=base_link + _SUFFIX)
    for joint in [child for child in base if child.tag in ("joint", "freejoint")]:
        base.remove(joint)
        above.append(joint)
    base.set("quat", f"{math.cos(yaw / 2)!r} 0 0 {math.sin(yaw / 2)!r}")
    above.append(base)


def _named(chain: Sequence[str]) -> str | None:
    """Return the leg on which the names of its joints agree."""
    legs = {leg_of(words_of(joint)) for joint in chain}
    return legs.pop() if len(legs) == 1 else None


def words_of(name: str) -> list[str]:
    """Return the lower-case words of a name, without its namespace and common words such as "joint"."""
    own = re.split(r"/|::", name)[-1]
    return [word for word in (match.lower() for match in _WORDS.findall(own)) if word not in _NOISE]


def leg_of(words: Sequence[str]) -> str | None:
    """Return the one leg that a name's words name, or None."""
    legs = {_LEGS[word] for word in words if word in _LEGS}
    for one, other in itertools.pairwise(words):
        for end, side in ((one, other), (other, one)):
            if end in _ENDS and side in _SIDES:
                legs.add(_ENDS[end] + _SIDES[side])
    return legs.pop() if len(legs) == 1 else None
