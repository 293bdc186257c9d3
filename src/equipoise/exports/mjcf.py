"""The user's own MJCF with another inertial, or with a body for the payload."""

from __future__ import annotations

from equipoise.errors import ModelError
from equipoise.exports.model_file import joint_element
from equipoise.exports.model_writer import ModelFormat, write_model
from equipoise.exports.subject import PAYLOAD, Subject, Written, number, numbers
from equipoise.exports.xml_edit import Document, Edit, Element, comment_lines, empty_element
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
    inertial = body.first("inertial")
    if inertial is None:
        return [document.put(body, [*comment_lines(header), empty_element("inertial", _attributes(parameters))])]
    return [
        document.comment(inertial, header),
        *document.unset(inertial, "diaginertia", *ORIENTATIONS),
        *(document.set(inertial, key, value) for key, value in _attributes(parameters).items()),
    ]


def _attributes(body: InertialParameters) -> dict[str, str]:
    """Return the attributes of an <inertial> element in its body's axes."""
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = body.inertia
    return {"pos": numbers(body.com), "mass": number(body.mass), "fullinertia": numbers((xx, yy, zz, xy, xz, yz))}


def _joint_edits(document: Document, subject: Subject, header: tuple[str, ...]) -> list[Edit]:
    """Return edits of the attributes of the estimated joints; a joint's own attributes override those of its class."""
    values = {attribute: subject.column(name) for attribute, name in _ATTRIBUTES.items()}
    joints = {e.attributes.get("name"): e for e in _base_body(document).walk() if e.tag == "joint"}
    found = [(joint_element(document, joints, name), name) for name in subject.joints]
    edits = [
        document.set(joint, attribute, number(max(0.0, values[attribute][name])))
        for joint, name in found
        for attribute in values
        if name in values[attribute]
    ]
    return [document.comment(found[0][0], header), *edits] if header and found else edits


def _payload_edits(document: Document, base: str, body: InertialParameters, header: tuple[str, ...]) -> list[Edit]:
    del base
    lines = [
        *comment_lines(header),
        f'<body name="{PAYLOAD}">',
        f"  {empty_element('inertial', _attributes(body))}",
        "</body>",
    ]
    return [document.put(_base_body(document), lines, last=True)]


_MJCF = ModelFormat("mjcf", "body", _JOINTS, _body, _inertial_edits, _joint_edits, _payload_edits)
