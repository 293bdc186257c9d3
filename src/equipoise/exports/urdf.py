"""The user's own URDF with new inertials and joint dynamics, or with a link for the payload."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from equipoise.errors import ModelError
from equipoise.exports.model_writer import ModelFormat, write_model
from equipoise.exports.subject import PAYLOAD, Subject, Written, number, numbers, products
from equipoise.exports.xml_edit import Document, Edit, Element, comment_lines, element_lines
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
    wanted, present = _inertial(body), link.first("inertial")
    origin = None if present is None else present.first("origin")
    if origin is not None and "rpy" not in origin.attributes:
        del wanted[0].attrib["rpy"]
    return document.put_child(link, wanted, header)


def _joints(document: Document) -> list[Element]:
    return document.root.all("joint")


def _joint_edits(document: Document, joint: Element, values: dict[str, str]) -> list[Edit]:
    return document.put_child(joint, ET.Element("dynamics", values), last=True)


def _inertial(body: InertialParameters) -> ET.Element:
    """Return an <inertial> in its frame's axes."""
    inertial = ET.Element("inertial")
    ET.SubElement(inertial, "origin", xyz=numbers(body.com), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=number(body.mass))
    ET.SubElement(inertial, "inertia", {key: number(value) for key, value in products(body.inertia).items()})
    return inertial


def _payload_edits(document: Document, base_link: str, body: InertialParameters, header: tuple[str, ...]) -> list[Edit]:
    link = ET.Element("link", name=PAYLOAD)
    link.append(_inertial(body))
    joint = ET.Element("joint", name=f"{PAYLOAD}_joint", type="fixed")
    ET.SubElement(joint, "origin", xyz="0 0 0", rpy="0 0 0")
    ET.SubElement(joint, "parent", link=base_link)
    ET.SubElement(joint, "child", link=PAYLOAD)
    lines = [*comment_lines(header), *element_lines(link), *element_lines(joint)]
    return [document.put(document.root, lines, last=True)]


_URDF = ModelFormat("urdf", "link", _JOINTS, _DYNAMICS, _link, _inertial_edits, _joints, _joint_edits, _payload_edits)
