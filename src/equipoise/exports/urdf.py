"""The user's own URDF with another inertial, or with a link for what was added."""

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
from equipoise.exports.subject import PAYLOAD, Subject, number, numbers, products, seen_from
from equipoise.exports.written import Written
from equipoise.exports.xml_edit import Document, Edit, Element, comment_lines, escaped
from equipoise.robot.forward import link_in_file
from equipoise.robot.inertial import InertialParameters

_DYNAMICS = {"damping": "viscous_friction", "friction": "coulomb_friction"}
_JOINTS = (
    "joints' <dynamics> as found, torques in the unit in which the motors report them; a URDF has no place for armature, gain "
    "and delay"
)


def write(subject: Subject) -> Written:
    """The file as it was but for the base link's <inertial> and joints' <dynamics>, or with one link more."""
    assert subject.file is not None
    robot = read_robot(subject, subject.file.content)
    require_format(robot, "urdf")
    subject, robot = with_legs(subject, robot, _leg_edits)
    assert subject.file is not None
    document = Document(subject.file.content, subject.file.path)
    if BASE not in subject.parts:
        edits = _joint_edits(document, subject, subject.header(_JOINTS))
        return with_joints_alone(subject, robot, document.edited(edits), _JOINTS)
    if subject.payload_link:
        base_link, place = link_in_file(robot.base_link, robot.source.forward)
        about = (
            f"link {PAYLOAD!r}, fixed to base link {base_link!r}, is what the robot has more than the model file, "
            "in that link's frame; nothing else was changed"
        )
        before = composite_of(subject, robot)
        body, notes = payload(subject, before)
        content = document.edited(
            _payload_edits(document, base_link, seen_from(body, place), subject.header(about, *notes))
        )
        require_composite(subject, content, before.vector + body.vector)
        return Written(content, about, notes)
    link = edited_link(robot)
    about = (
        f"the <inertial> of link {link.name!r}, such that the whole robot has the composite that was found; "
        f"{what_else(subject, _JOINTS)}"
    )
    body, notes, composite = new_inertial(subject, robot, link)
    edits = _inertial_edits(document, _link(document, link.name), body, subject.header(about, *notes))
    content = document.edited([*edits, *_joint_edits(document, subject)])
    require_composite(subject, content, composite)
    return Written(content, about, notes)


def _leg_edits(document: Document, name: str, body: InertialParameters) -> list[Edit]:
    return _inertial_edits(document, _link(document, name), body, COMMENT)


def _link(document: Document, name: str) -> Element:
    for link in document.root.all("link"):
        if link.attributes.get("name") == name:
            return link
    raise ModelError(f"{str(document.path)!r} has no <link name={name!r}>")


def _inertial_edits(document: Document, link: Element, body: InertialParameters, header: tuple[str, ...]) -> list[Edit]:
    inertial = link.first("inertial")
    lines = inertial_lines(body)
    if inertial is None:
        return [document.put_first(link, [*comment_lines(header), *lines])]
    parts = {tag: inertial.first(tag) for tag in ("origin", "mass", "inertia")}
    edits = [document.comment(inertial, header)]
    values = {
        "origin": {"xyz": numbers(body.com), "rpy": "0 0 0"},
        "mass": {"value": number(body.mass)},
        "inertia": {key: number(value) for key, value in products(body.inertia).items()},
    }
    missing: list[str] = []
    for tag, element in parts.items():
        if element is None:
            missing.append(next(line.strip() for line in lines if line.strip().startswith(f"<{tag} ")))
            continue
        pairs = {key: value for key, value in values[tag].items() if key != "rpy" or key in element.attributes}
        edits += [document.set(element, key, value) for key, value in pairs.items()]
    return [*edits, document.put_first(inertial, missing)] if missing else edits


def _joint_edits(document: Document, subject: Subject, header: tuple[str, ...] = ()) -> list[Edit]:
    """<dynamics> of the joints whose friction was found."""
    values = {attribute: subject.column(name) for attribute, name in _DYNAMICS.items()}
    joints = {joint.attributes.get("name"): joint for joint in document.root.all("joint")}
    edits: list[Edit] = []
    for name in [name for name in subject.joints if any(name in column for column in values.values())]:
        joint = joint_element(document, joints, name)
        edits += [document.comment(joint, header)] if header and not edits else []
        edits += _dynamics_edits(
            document, joint, {key: max(0.0, column[name]) for key, column in values.items() if name in column}
        )
    return edits


def _dynamics_edits(document: Document, joint: Element, values: dict[str, float]) -> list[Edit]:
    if (dynamics := joint.first("dynamics")) is not None:
        return [document.set(dynamics, key, number(value)) for key, value in values.items()]
    words = " ".join(f'{key}="{number(value)}"' for key, value in values.items())
    return [document.put_last(joint, [f"<dynamics {words}/>"])]


def inertial_lines(body: InertialParameters) -> list[str]:
    """An <inertial> element in its frame's axes."""
    moments = " ".join(f'{key}="{number(value)}"' for key, value in products(body.inertia).items())
    return [
        "<inertial>",
        f'  <origin xyz="{numbers(body.com)}" rpy="0 0 0"/>',
        f'  <mass value="{number(body.mass)}"/>',
        f"  <inertia {moments}/>",
        "</inertial>",
    ]


def _payload_edits(document: Document, base_link: str, body: InertialParameters, header: tuple[str, ...]) -> list[Edit]:
    if any(link.attributes.get("name") == PAYLOAD for link in document.root.all("link")):
        raise SettingsError(f"{str(document.path)!r} has a link {PAYLOAD!r} already; start from the file without it")
    lines = [
        *comment_lines(header),
        f'<link name="{PAYLOAD}">',
        *(f"  {line}" for line in inertial_lines(body)),
        "</link>",
        f'<joint name="{PAYLOAD}_joint" type="fixed">',
        '  <origin xyz="0 0 0" rpy="0 0 0"/>',
        f'  <parent link="{escaped(base_link)}"/>',
        f'  <child link="{PAYLOAD}"/>',
        "</joint>",
    ]
    return [document.put_last(document.root, lines)]
