"""The user's own MJCF with another inertial, or with a body for the payload."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from equipoise.errors import ModelError
from equipoise.exports.model_writer import ModelFormat, write_model
from equipoise.exports.subject import PAYLOAD, Subject, Written, number, numbers
from equipoise.exports.xml_edit import Document, Edit, Element, comment_lines, element_lines
from equipoise.robot.cleaning.mjcf_poses import ORIENTATIONS
from equipoise.robot.inertial import InertialParameters

_ATTRIBUTES = {"armature": "armature", "frictionloss": "coulomb_friction", "damping": "viscous_friction"}
_JOINTS = "joints' armature, frictionloss and damping as estimated, torques in the motors' reported unit"


def write(subject: Subject) -> Written:
    """Return the file with another <inertial> of the base body and attributes of joints, or with an additional body."""
    return write_model(subject, _MJCF)


def _base_body(document: Document) -> Element:
    """Return the first body with a free joint, in the world or in frames of it."""
    waiting = [child for world in document.root.all("worldbody") for child in world.children]
    while waiting:
        element = waiting.pop(0)
        if element.tag == "frame":
            waiting = [*element.children, *waiting]
        elif element.tag == "body" and _is_free(element):
            return element
    raise ModelError(
        f"{str(document.path)!r} does not hold the base body itself but includes it from another file; write a single "
        "file (mujoco.mj_saveLastXML) and name it with --file"
    )


def _is_free(body: Element) -> bool:
    joints = body.all("joint")
    return bool(body.all("freejoint")) or any(joint.attributes.get("type") == "free" for joint in joints)


def _body(document: Document, name: str, base: str) -> Element:
    base_body = _base_body(document)
    if name == base:
        return base_body
    for element in base_body.walk():
        if element.tag == "body" and element.attributes.get("name") == name:
            return element
    raise ModelError(f"{str(document.path)!r} has no body {name!r} below its base body; give the body a name")


def _inertial_edits(
    document: Document, body: Element, parameters: InertialParameters, header: tuple[str, ...]
) -> list[Edit]:
    stale = [edit for one in body.all("inertial")[:1] for edit in document.unset(one, "diaginertia", *ORIENTATIONS)]
    return [*stale, *document.put_child(body, _inertial(parameters), header)]


def _inertial(body: InertialParameters) -> ET.Element:
    """Return an <inertial> in its body's axes."""
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = body.inertia
    moments = numbers((xx, yy, zz, xy, xz, yz))
    return ET.Element("inertial", pos=numbers(body.com), mass=number(body.mass), fullinertia=moments)


def _joints(document: Document) -> list[Element]:
    return [element for element in _base_body(document).walk() if element.tag == "joint"]


def _joint_edits(document: Document, joint: Element, values: dict[str, str]) -> list[Edit]:
    """Return edits of a joint's own attributes, which override those of its class."""
    return document.complete(joint, ET.Element("joint", values))


def _payload_edits(document: Document, base: str, body: InertialParameters, header: tuple[str, ...]) -> list[Edit]:
    del base
    payload = ET.Element("body", name=PAYLOAD)
    payload.append(_inertial(body))
    return [document.put(_base_body(document), [*comment_lines(header), *element_lines(payload)], last=True)]


_MJCF = ModelFormat("mjcf", "body", _JOINTS, _ATTRIBUTES, _body, _inertial_edits, _joints, _joint_edits, _payload_edits)
