"""Cleaning of MJCF files: the bodies, joints and primitive geoms stay, what belongs to a simulation goes."""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ET
from pathlib import Path

from equipoise.errors import ModelError

# Sections that describe a simulation and not a robot. Ours replace them where the simulator needs them.
_DROPPED_SECTIONS = (
    "actuator", "asset", "contact", "custom", "deformable", "equality", "extension", "keyframe", "sensor", "size",
    "statistic", "tendon", "visual",
)  # fmt: skip
_ORIENTATIONS = ("quat", "axisangle", "xyaxes", "zaxis", "euler", "fromto")
_ACTUATORS = ("motor", "position", "velocity", "general", "intvelocity")


def clean_mjcf(root: ET.Element, path: Path) -> tuple[ET.Element, list[str], dict[str, float]]:
    """Clean a parsed MJCF file.

    Returns:
        the cleaned root; what was changed, a sentence each; torque limits by joint name [Nm].

    Raises:
        ModelError: no body with a free joint, or a body whose mass only a mesh tells.
    """
    root = copy.deepcopy(root)
    _expand_includes(root, path, depth=0)
    defaults = _Defaults(root)
    effort_limits = _effort_limits(root, defaults)
    for section in _DROPPED_SECTIONS:
        for element in root.findall(section):
            root.remove(element)
    _flatten_defaults(root, defaults)
    base = _base_body(root, path)
    repairs = _strip_meshes(root, path)
    others = [child for world in root.findall("worldbody") for child in world if child is not base]
    if others:
        tags = sorted({child.tag for child in others})
        repairs.append(f"what else is in the world is ignored: {', '.join(tags)}")
    for world in root.findall("worldbody"):
        for child in list(world):
            if child is not base:
                world.remove(child)
    return root, repairs, effort_limits


def _expand_includes(root: ET.Element, path: Path, depth: int) -> None:
    if depth > 8:
        raise ModelError(f"robot model {str(path)!r} includes files more than 8 deep; is there a loop?")
    for parent in list(root.iter()):
        for index, child in reversed(list(enumerate(parent))):
            if child.tag != "include":
                continue
            file = path.parent / child.get("file", "")
            try:
                included = ET.parse(file).getroot()
            except (OSError, ET.ParseError) as error:
                raise ModelError(
                    f"robot model {str(path)!r} includes {child.get('file')!r}, which cannot be read: {error}"
                ) from error
            _expand_includes(included, file, depth + 1)
            parent.remove(child)
            for offset, element in enumerate(included):
                parent.insert(index + offset, element)


class _Defaults:
    """Attribute look-up through MJCF's nested default classes."""

    def __init__(self, root: ET.Element) -> None:
        self._classes: dict[str, dict[str, dict[str, str]]] = {"main": {}}
        for top in root.findall("default"):
            self._read(top, "main", {})

    def _read(self, element: ET.Element, name: str, inherited: dict[str, dict[str, str]]) -> None:
        attributes = {tag: dict(values) for tag, values in inherited.items()}
        for child in element:
            if child.tag != "default":
                attributes.setdefault(child.tag, {}).update(child.attrib)
        self._classes[element.get("class", name)] = attributes
        self._classes.setdefault("main", attributes)
        if name == "main":
            self._classes["main"] = attributes
        for child in element.findall("default"):
            self._read(child, "", attributes)

    def all(self, element: ET.Element, childclass: str = "main") -> dict[str, str]:
        """What the element inherits from its class."""
        return self._classes.get(element.get("class", childclass), {}).get(element.tag, {})

    def get(self, element: ET.Element, key: str, childclass: str = "main") -> str | None:
        """One attribute, the element's own or inherited."""
        return element.attrib.get(key, self.all(element, childclass).get(key))


def _effort_limits(root: ET.Element, defaults: _Defaults) -> dict[str, float]:
    """Torque limit of each joint: the force range of its actuator, or of a motor's control, times the gear."""
    limits: dict[str, float] = {}
    for element in root.iterfind("actuator/*"):
        joint = element.get("joint")
        if element.tag not in _ACTUATORS or joint is None:
            continue
        span = defaults.get(element, "forcerange")
        if span is None and element.tag == "motor":
            span = defaults.get(element, "ctrlrange")
        if span is None:
            continue
        try:
            gear = abs(float((defaults.get(element, "gear") or "1").split()[0]))
            limit = gear * min(abs(float(word)) for word in span.split())
        except ValueError:
            continue
        if limit > 0:
            limits[joint] = limit
    for parent_class, joint in _walk_joints(root):
        span = defaults.get(joint, "actuatorfrcrange", parent_class)
        name = joint.get("name")
        if span is not None and name is not None and name not in limits:
            limits[name] = min(abs(float(word)) for word in span.split())
    return limits


def _walk_joints(root: ET.Element) -> list[tuple[str, ET.Element]]:
    return [(childclass, joint) for childclass, body in _walk_bodies(root) for joint in body.findall("joint")]


def _walk_bodies(root: ET.Element) -> list[tuple[str, ET.Element]]:
    """Every body with the default class that its children take."""
    found: list[tuple[str, ET.Element]] = []

    def descend(element: ET.Element, childclass: str) -> None:
        for body in element.findall("body"):
            own = body.get("childclass", childclass)
            found.append((own, body))
            descend(body, own)

    for world in root.findall("worldbody"):
        descend(world, "main")
    return found


def _flatten_defaults(root: ET.Element, defaults: _Defaults) -> None:
    """Write inherited attributes onto the elements: Pinocchio's reader passes over some of them (a geom's `pos`)."""
    for childclass, body in _walk_bodies(root):
        body.attrib.pop("childclass", None)
        for element in body:
            if element.tag in ("geom", "joint", "site"):
                inherited = defaults.all(element, childclass)
                if any(key in element.attrib for key in _ORIENTATIONS):
                    inherited = {key: value for key, value in inherited.items() if key not in _ORIENTATIONS}
                element.attrib = {**inherited, **element.attrib}
                for key in ("class", "material"):
                    element.attrib.pop(key, None)
    for default in root.findall("default"):
        root.remove(default)


def _base_body(root: ET.Element, path: Path) -> ET.Element:
    bodies = [body for world in root.findall("worldbody") for body in world.findall("body")]
    for body in bodies:
        free = body.find("freejoint") is not None or any(j.get("type") == "free" for j in body.findall("joint"))
        if free:
            return body
    raise ModelError(
        f"robot model {str(path)!r} has no floating base: give the trunk's body a <freejoint/>"
        if bodies
        else f"robot model {str(path)!r} has no <body> in its <worldbody>"
    )


def _strip_meshes(root: ET.Element, path: Path) -> list[str]:
    meshes = 0
    for _, body in _walk_bodies(root):
        stripped = 0
        for geom in body.findall("geom"):
            if geom.get("mesh") is not None or geom.get("type") in ("mesh", "hfield", "sdf"):
                body.remove(geom)
                stripped += 1
        meshes += stripped
        for tag in ("camera", "light", "composite", "flexcomp", "replicate", "attach"):
            for element in body.findall(tag):
                body.remove(element)
        if stripped and body.find("inertial") is None and not body.findall("geom"):
            raise ModelError(
                f"robot model {str(path)!r}: body {body.get('name')!r} takes its mass from a mesh; "
                "give it an <inertial> element"
            )
    return [f"{meshes} mesh geoms are ignored: the feet are taken as spheres"] if meshes else []
