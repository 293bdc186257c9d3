"""The user's own URDF with new inertials and joint dynamics, or with a link for the payload."""

from __future__ import annotations

from equipoise.errors import ModelError
from equipoise.exports.model_file import joint_element
from equipoise.exports.model_writer import ModelFormat, write_model
from equipoise.exports.subject import PAYLOAD, Subject, Written, number, numbers, products
from equipoise.exports.xml_edit import Document, Edit, Element, comment_lines, empty_element, escaped
from equipoise.robot.inertial import InertialParameters

_DYNAMICS = {"damping": "viscous_friction", "friction": "coulomb_friction"}
_JOINTS = (
    "joints' <dynamics> as estimated, torques in the motors' reported unit; a URDF cannot hold armature, gain or delay"
)


def write(subject: Subject) -> Written:
    """Return the file with a new <inertial> of base or leg links and <dynamics> of joints, or with an additional link."""
    return write_model(subject, _URDF)


def _link(document: Document, name: str, base: str) -> Element:
    del base
    for link in document.root.all("link"):
        if link.attributes.get("name") == name:
            return link
    raise ModelError(f"{str(document.path)!r} has no <link name={name!r}>")


def _inertial_edits(document: Document, link: Element, body: InertialParameters, header: tuple[str, ...]) -> list[Edit]:
    inertial = link.first("inertial")
    if inertial is None:
        return [document.put(link, [*comment_lines(header), *_inertial_lines(body)])]
    edits, missing = [document.comment(inertial, header)], list[str]()
    for tag, attributes in _inertial(body).items():
        element = inertial.first(tag)
        if element is None:
            missing.append(empty_element(tag, attributes))
            continue
        pairs = {key: value for key, value in attributes.items() if key != "rpy" or key in element.attributes}
        edits += [document.set(element, key, value) for key, value in pairs.items()]
    return [*edits, document.put(inertial, missing)] if missing else edits


def _joint_edits(document: Document, subject: Subject, header: tuple[str, ...]) -> list[Edit]:
    """Return edits of <dynamics> of the joints with estimated friction."""
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
    attributes = {key: number(value) for key, value in values.items()}
    return [document.put(joint, [empty_element("dynamics", attributes)], last=True)]


def _inertial(body: InertialParameters) -> dict[str, dict[str, str]]:
    """Return the elements of an <inertial> in its frame's axes, with their attributes."""
    return {
        "origin": {"xyz": numbers(body.com), "rpy": "0 0 0"},
        "mass": {"value": number(body.mass)},
        "inertia": {key: number(value) for key, value in products(body.inertia).items()},
    }


def _inertial_lines(body: InertialParameters) -> list[str]:
    inner = [f"  {empty_element(tag, attributes)}" for tag, attributes in _inertial(body).items()]
    return ["<inertial>", *inner, "</inertial>"]


def _payload_edits(document: Document, base_link: str, body: InertialParameters, header: tuple[str, ...]) -> list[Edit]:
    lines = [
        *comment_lines(header),
        f'<link name="{PAYLOAD}">',
        *(f"  {line}" for line in _inertial_lines(body)),
        "</link>",
        f'<joint name="{PAYLOAD}_joint" type="fixed">',
        '  <origin xyz="0 0 0" rpy="0 0 0"/>',
        f'  <parent link="{escaped(base_link)}"/>',
        f'  <child link="{PAYLOAD}"/>',
        "</joint>",
    ]
    return [document.put(document.root, lines, last=True)]


_URDF = ModelFormat("urdf", "link", _JOINTS, _link, _inertial_edits, _joint_edits, _payload_edits)
