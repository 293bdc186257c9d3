"""The user's own MJCF with another inertial, or with a body for what was added."""

from __future__ import annotations

from equipoise.errors import ModelError, SettingsError
from equipoise.exports.found import BASE
from equipoise.exports.legs import COMMENT, what_else, with_legs
from equipoise.exports.model_file import (
    composite_of,
    edited_link,
    joint_element,
    new_inertial,
    payload,
    read_robot,
    require_composite,
    require_format,
    with_joints_alone,
)
from equipoise.exports.subject import PAYLOAD, Subject, number, numbers, seen_from
from equipoise.exports.written import Written
from equipoise.exports.xml_edit import Document, Edit, Element, comment_lines
from equipoise.robot.cleaning.mjcf_poses import ORIENTATIONS
from equipoise.robot.forward import link_in_file
from equipoise.robot.inertial import InertialParameters

_ATTRIBUTES = {"armature": "armature", "frictionloss": "coulomb_friction", "damping": "viscous_friction"}
_JOINTS = "joints' armature, frictionloss and damping as found, torques in the unit in which the motors report them"


def write(subject: Subject) -> Written:
    """The file as it was but for the base body's <inertial> and joints' attributes, or with one body more."""
    assert subject.file is not None
    robot = read_robot(subject, subject.file.content)
    require_format(robot, "mjcf")
    subject, robot = with_legs(subject, robot, _leg_edits)
    assert subject.file is not None
    document = Document(subject.file.content, subject.file.path)
    base = _base_body(document)
    if BASE not in subject.parts:
        edits = _joint_edits(document, base, subject, subject.header(_JOINTS))
        return with_joints_alone(subject, robot, document.edited(edits), _JOINTS)
    if subject.payload_link:
        base_link, place = link_in_file(robot.base_link, robot.source.forward)
        about = (
            f"body {PAYLOAD!r}, fixed to base body {base_link!r}, is what the robot has more than the model file, "
            "in that body's frame; nothing else was changed"
        )
        before = composite_of(subject, robot)
        body, notes = payload(subject, before)
        content = document.edited(_payload_edits(document, base, seen_from(body, place), subject.header(about, *notes)))
        require_composite(subject, content, before.vector + body.vector)
        return Written(content, about, notes)
    link = edited_link(robot)
    about = (
        f"the <inertial> of body {link.name!r}, such that the whole robot has the composite that was found; "
        f"{what_else(subject, _JOINTS)}"
    )
    body, notes, composite = new_inertial(subject, robot, link)
    edited = base if link.name == robot.base_link else _named(document, base, link.name)
    edits = _inertial_edits(document, edited, body, subject.header(about, *notes))
    content = document.edited([*edits, *_joint_edits(document, base, subject)])
    require_composite(subject, content, composite)
    return Written(content, about, notes)


def _leg_edits(document: Document, name: str, body: InertialParameters) -> list[Edit]:
    return _inertial_edits(document, _named(document, _base_body(document), name), body, COMMENT)


def _base_body(document: Document) -> Element:
    """The first body with a free joint, in the world or in frames of it."""
    waiting = [child for world in document.root.all("worldbody") for child in world.children]
    while waiting:
        element = waiting.pop(0)
        if element.tag == "frame":
            waiting = [*element.children, *waiting]
        elif element.tag == "body" and _is_free(element):
            return element
    raise ModelError(
        f"{str(document.path)!r} does not hold the base body itself but includes it from another file; write one file of "
        "them all (mujoco.mj_saveLastXML) and name it with --file"
    )


def _is_free(body: Element) -> bool:
    joints = body.all("joint")
    return bool(body.all("freejoint")) or any(joint.attributes.get("type") == "free" for joint in joints)


def _named(document: Document, base: Element, name: str) -> Element:
    for element in base.walk():
        if element.tag == "body" and element.attributes.get("name") == name:
            return element
    raise ModelError(f"{str(document.path)!r} has no body {name!r} below its base body; give the body a name")


def _inertial_edits(
    document: Document, body: Element, parameters: InertialParameters, header: tuple[str, ...]
) -> list[Edit]:
    inertial = body.first("inertial")
    if inertial is None:
        return [document.put_first(body, [*comment_lines(header), inertial_line(parameters)])]
    return [
        document.comment(inertial, header),
        *document.unset(inertial, "diaginertia", *ORIENTATIONS),
        *(document.set(inertial, key, value) for key, value in _attributes(parameters).items()),
    ]


def _attributes(body: InertialParameters) -> dict[str, str]:
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = body.inertia
    return {"pos": numbers(body.com), "mass": number(body.mass), "fullinertia": numbers((xx, yy, zz, xy, xz, yz))}


def inertial_line(body: InertialParameters) -> str:
    """An <inertial> element in its body's axes."""
    words = [f'{key}="{value}"' for key, value in _attributes(body).items()]
    return f"<inertial {' '.join(words)}/>"


def _joint_edits(document: Document, base: Element, subject: Subject, header: tuple[str, ...] = ()) -> list[Edit]:
    """Attributes of the joints that were found; where a class of joints has others, the joint's own go first."""
    values = {attribute: subject.column(name) for attribute, name in _ATTRIBUTES.items()}
    joints = {e.attributes.get("name"): e for e in base.walk() if e.tag == "joint"}
    found = [(joint_element(document, joints, name), name) for name in subject.joints]
    edits = [
        document.set(joint, attribute, number(max(0.0, values[attribute][name])))
        for joint, name in found
        for attribute in values
        if name in values[attribute]
    ]
    return [document.comment(found[0][0], header), *edits] if header and found else edits


def _payload_edits(document: Document, base: Element, body: InertialParameters, header: tuple[str, ...]) -> list[Edit]:
    if any(e.tag == "body" and e.attributes.get("name") == PAYLOAD for e in document.root.walk()):
        raise SettingsError(f"{str(document.path)!r} has a body {PAYLOAD!r} already; start from the file without it")
    lines = [*comment_lines(header), f'<body name="{PAYLOAD}">', f"  {inertial_line(body)}", "</body>"]
    return [document.put_last(base, lines)]
