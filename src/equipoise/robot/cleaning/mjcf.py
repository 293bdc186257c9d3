"""Cleaning of MJCF files, which keeps bodies, joints and primitive geoms and removes simulation settings."""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

from equipoise.errors import ModelError
from equipoise.robot.cleaning.mjcf_joints import base_body, clean_joints, couplings_of
from equipoise.robot.cleaning.mjcf_poses import ORIENTATIONS, angle_unit, write_plain_poses
from equipoise.robot.cleaning.size import refuse_immense
from equipoise.robot.cleaning.urdf_joints import Coupling
from equipoise.user_file import read_bytes

# Sections that describe a simulation and not a robot. equipoise's simulator adds its own.
_DROPPED_SECTIONS = (
    "actuator", "asset", "contact", "custom", "deformable", "equality", "extension", "keyframe", "sensor", "size",
    "statistic", "tendon", "visual",
)  # fmt: skip
_ACTUATORS = ("motor", "position", "velocity", "general", "intvelocity")
# Compiler settings that change the masses of bodies, and their harmless values.
_MASS_SETTINGS = {"settotalmass": [-1.0], "boundmass": [0.0], "boundinertia": [0.0], "inertiagrouprange": [0.0, 5.0]}
_POSITIONS = {"free": 7, "ball": 4}  # numbers in `qpos`; other joints have one
DefaultClasses = dict[str, dict[str, dict[str, str]]]
"""Attributes by default class and kind of element."""
# Elements that generate bodies.
_GENERATORS = ("replicate", "attach", "composite", "flexcomp")


def clean_mjcf(
    root: ET.Element, path: Path
) -> tuple[ET.Element, list[str], dict[str, float], dict[str, float], dict[str, float], list[Coupling]]:
    """Clean a parsed MJCF file.

    Returns:
        the root of the cleaned file, and `repairs`, `effort_limits`, `home`, `locked` and `couplings` of `ModelSource`.

    Raises:
        ModelError: no body with a free joint, a body whose mass only a mesh determines, bodies or masses that only MuJoCo
            can compute, joints without an axis or with exchanged limits.
        ValueError: something that is not a number.
    """
    root = copy.deepcopy(root)
    _expand_includes(root, path, path, depth=0)
    refuse_immense(root, path)
    _merge_sections(root)
    _refuse_mass_settings(root, path)
    _name_unnamed(root)
    classes = _default_classes(root)
    effort_limits, couplings = _effort_limits(root, classes), couplings_of(root)
    home = root.find("keyframe/key[@name='home']")
    for section in _DROPPED_SECTIONS:
        for element in root.findall(section):
            root.remove(element)
    _flatten_defaults(root, classes)
    at_home = {} if home is None else _joint_positions(root, home)
    write_plain_poses(root)
    base = base_body(root, path)
    _refuse_generators(base, path)
    locked = clean_joints(root, base, path)
    for key in ("pos", *ORIENTATIONS):  # the start pose is not a property of the robot
        base.attrib.pop(key, None)
    _drop_overruled_inertials(root)
    repairs = _strip_meshes(root, path)
    for world in root.findall("worldbody"):
        others = [child for child in world if child is not base]
        if others:
            tags = sorted({child.tag for child in others})
            repairs.append(f"other elements of the world are ignored: {', '.join(tags)}")
        for child in others:
            world.remove(child)
    return root, repairs, effort_limits, at_home, locked, couplings


def _expand_includes(root: ET.Element, path: Path, main: Path, depth: int) -> None:
    """Insert included files. Their names are relative to the main file's folder or else to the including file's."""
    if depth > 8:
        raise ModelError(f"robot model {str(main)!r} includes files more than 8 deep; is there a loop?")
    for parent in list(root.iter()):
        for index, child in reversed(list(enumerate(parent))):
            if child.tag != "include":
                continue
            name = child.get("file", "")
            file = main.parent / name
            file = file if file.is_file() else path.parent / name
            try:
                included = ET.fromstring(read_bytes(file))
            except (OSError, ValueError, ET.ParseError) as error:
                raise ModelError(
                    f"robot model {str(path)!r} includes {name!r}, which cannot be read: {error}"
                ) from error
            _expand_includes(included, file, main, depth + 1)
            parent.remove(child)
            for offset, element in enumerate(included):
                parent.insert(index + offset, element)


def _merge_sections(root: ET.Element) -> None:
    """Merge sections: Pinocchio reads the first and ignores the others."""
    for tag in ("compiler", "worldbody"):
        sections = root.findall(tag)
        for section in sections[1:]:
            sections[0].attrib.update(section.attrib)
            sections[0].extend(section)
            root.remove(section)


def _refuse_mass_settings(root: ET.Element, path: Path) -> None:
    """Refuse settings that Pinocchio does not support; remove those that are not needed."""
    for compiler in root.findall("compiler"):
        for key, harmless in _MASS_SETTINGS.items():
            value = compiler.attrib.pop(key, None)
            if value is not None and [float(word) for word in value.split()] != harmless:
                raise ModelError(
                    f"robot model {str(path)!r}: <compiler {key}={value!r}> changes the masses of bodies; give every "
                    "body an <inertial> with its mass and remove the setting"
                )
        compiler.attrib.pop("balanceinertia", None)


def _name_unnamed(root: ET.Element) -> None:
    """Name unnamed bodies and joints, because readers find them by name."""
    for index, (_, body) in enumerate(_walk_bodies(root)):
        if body.tag == "body" and not body.get("name"):
            body.set("name", f"unnamed_body_{index}")
        for place, joint in enumerate(body.findall("joint")):
            if not joint.get("name"):
                joint.set("name", f"unnamed_joint_{index}_{place}")


def _default_classes(root: ET.Element) -> DefaultClasses:
    """Return the attributes of MJCF's nested default classes, with those that they inherit."""
    classes: DefaultClasses = {"main": {}}

    def read(element: ET.Element, name: str, above: str) -> None:
        classes[name] = {tag: dict(values) for tag, values in classes[above].items()}
        for child in element:
            if child.tag != "default":
                classes[name].setdefault(_default_tag(child), {}).update(child.attrib)
        for child in element.findall("default"):
            read(child, child.get("class", ""), name)

    for top in root.findall("default"):
        read(top, "main", "main")
    return classes


def _inherited(classes: DefaultClasses, element: ET.Element, childclass: str = "main") -> dict[str, str]:
    """Return the attributes that an element inherits from its class."""
    return classes.get(element.get("class", childclass), {}).get(_default_tag(element), {})


def _attribute(classes: DefaultClasses, element: ET.Element, key: str, childclass: str = "main") -> str | None:
    """Return one attribute, the element's own or inherited."""
    return element.attrib.get(key, _inherited(classes, element, childclass).get(key))


def _default_tag(element: ET.Element) -> str:
    """Return the key of an element's defaults: all kinds of actuators share theirs."""
    return "actuator" if element.tag in _ACTUATORS else element.tag


def _effort_limits(root: ET.Element, classes: DefaultClasses) -> dict[str, float]:
    """Return the torque limit of each joint: the force range of its actuator, or of a motor's control, times the gear.

    A limit of the joint itself applies too.
    """
    limits: dict[str, float] = {}
    for element in root.iterfind("actuator/*"):
        joint = element.get("joint")
        if element.tag not in _ACTUATORS or joint is None:
            continue
        span = _attribute(classes, element, "forcerange")
        if span is None and element.tag == "motor":
            span = _attribute(classes, element, "ctrlrange")
        gear = abs(float((_attribute(classes, element, "gear") or "1").split()[0]))
        _lower(limits, joint, span, gear)
    for childclass, body in _walk_bodies(root):
        for joint in body.findall("joint"):
            _lower(limits, joint.get("name", ""), _attribute(classes, joint, "actuatorfrcrange", childclass), 1.0)
    return limits


def _joint_positions(root: ET.Element, key: ET.Element) -> dict[str, float]:
    """Return a keyframe's positions of joints with one axis, relative to zero after references are folded [rad].

    Empty if the number of values does not fit the joints: MuJoCo may generate further bodies.
    """
    values = [float(word) for word in key.get("qpos", "").split()]
    unit, found, place = angle_unit(root), dict[str, float](), 0
    for _, body in _walk_bodies(root):
        for joint in (child for child in body if child.tag in ("joint", "freejoint")):
            kind = "free" if joint.tag == "freejoint" else joint.get("type", "hinge")
            if kind in ("hinge", "slide") and place < len(values):
                reference = float(joint.get("ref", "0")) * (unit if kind == "hinge" else 1.0)
                found[joint.get("name", "")] = values[place] - reference
            place += _POSITIONS.get(kind, 1)
    return found if place == len(values) else {}


def _lower(limits: dict[str, float], joint: str, span: str | None, gear: float) -> None:
    limit = gear * min((abs(float(word)) for word in (span or "").split()), default=0.0)
    if limit > 0:
        limits[joint] = min(limit, limits.get(joint, limit))


def _walk_bodies(parent: ET.Element, childclass: str = "main") -> Iterator[tuple[str, ET.Element]]:
    """Yield every body and every frame of a file with the default class of its children."""
    for child in parent:
        if child.tag in ("worldbody", "body", "frame"):
            own = child.get("childclass", childclass)
            if child.tag != "worldbody":
                yield own, child
            yield from _walk_bodies(child, own)


def _flatten_defaults(root: ET.Element, classes: DefaultClasses) -> None:
    """Write inherited attributes onto the elements: Pinocchio's reader ignores some of them (a geom's `pos`)."""
    for childclass, body in _walk_bodies(root):
        body.attrib.pop("childclass", None)
        for element in body:
            if element.tag in ("geom", "joint", "site"):
                inherited = _inherited(classes, element, childclass)
                if any(key in element.attrib for key in (*ORIENTATIONS, "fromto")):
                    inherited = {k: v for k, v in inherited.items() if k not in (*ORIENTATIONS, "fromto")}
                element.attrib = {**inherited, **element.attrib}
                for key in ("class", "material"):
                    element.attrib.pop(key, None)
                if element.tag == "joint" and element.get("limited") == "false":
                    element.attrib.pop("range", None)
    for default in root.findall("default"):
        root.remove(default)


def _refuse_generators(base: ET.Element, path: Path) -> None:
    for element in base.iter():
        if element.tag in _GENERATORS:
            raise ModelError(
                f"robot model {str(path)!r} has a <{element.tag}>, which only MuJoCo can expand; load the file there, "
                "save it with mujoco.mj_saveLastXML and use that file"
            )


def _drop_overruled_inertials(root: ET.Element) -> None:
    """Remove inertials that the compiler's `inertiafromgeom` overrides."""
    for compiler in root.findall("compiler"):
        if compiler.attrib.pop("inertiafromgeom", "auto") == "true":
            for _, body in _walk_bodies(root):
                for inertial in body.findall("inertial") if body.find("geom") is not None else ():
                    body.remove(inertial)


def _strip_meshes(root: ET.Element, path: Path) -> list[str]:
    meshes = 0
    for _, body in _walk_bodies(root):
        for geom in body.findall("geom"):
            if geom.get("mesh") is None and geom.get("type") not in ("mesh", "hfield", "sdf"):
                continue
            body.remove(geom)
            meshes += 1
            has_mass = float(geom.get("mass", geom.get("density", "1000"))) > 0
            if has_mass and body.find("inertial") is None:
                raise ModelError(
                    f"robot model {str(path)!r}: body {body.get('name')!r} takes its mass from a mesh; "
                    "give it an <inertial> element"
                )
        for tag in ("camera", "light"):
            for element in body.findall(tag):
                body.remove(element)
    return [f"{meshes} mesh geoms are ignored: the feet are modelled as spheres"] if meshes else []
