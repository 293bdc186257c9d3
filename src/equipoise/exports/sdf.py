"""SDF (Gazebo): the <inertial> of the base link, or a link for the payload; alone, or in the user's own file.

Gazebo's reader joins all links fixed to a URDF's base into one link, so the link gets the whole base.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET

from equipoise.errors import ModelError
from equipoise.exports.model_file import payload
from equipoise.exports.model_writer import refuse_second_payload
from equipoise.exports.subject import PAYLOAD, Subject, Written, number, numbers, products
from equipoise.exports.xml_edit import Document, Edit, Element, comment_lines, element_lines
from equipoise.robot.inertial import InertialParameters


def write(subject: Subject) -> Written:
    """Write an <inertial>, or a <link> with its <joint>."""
    notes: tuple[str, ...] = ()
    if subject.payload_link:
        about = (
            f"link {PAYLOAD!r}, fixed to base link {subject.file_link!r}, is the robot's difference from the run's model "
            "file, in that link's frame"
        )
        body, notes = payload(subject, subject.result.nominal.composite)
        element = _payload_lines(subject, subject.in_file(body))
    else:
        about, body = subject.words_in_file, subject.base_in_file
        element = element_lines(_inertial(body))
    header = subject.header(about, *notes)
    lines = [*comment_lines(header), *element]
    if subject.file is None:
        return Written.text(lines, about, notes)
    document = Document(subject.file.content, subject.file.path)
    link = _link(document, subject.file_link)
    edit = (
        _payload_edits(document, link, lines) if subject.payload_link else _inertial_edits(document, link, body, header)
    )
    return Written(document.edited(edit), about, notes)


def _inertial(body: InertialParameters) -> ET.Element:
    """Return an <inertial> in its link's axes."""
    inertial = ET.Element("inertial")
    ET.SubElement(inertial, "pose").text = f"{numbers(body.com)} 0 0 0"
    ET.SubElement(inertial, "mass").text = number(body.mass)
    moments = ET.SubElement(inertial, "inertia")
    for tag, value in products(body.inertia).items():
        ET.SubElement(moments, tag).text = number(value)
    return inertial


def _payload_lines(subject: Subject, body: InertialParameters) -> list[str]:
    link = ET.Element("link", name=PAYLOAD)
    ET.SubElement(link, "pose", relative_to=subject.file_link).text = "0 0 0 0 0 0"
    link.append(_inertial(body))
    joint = ET.Element("joint", name=f"{PAYLOAD}_joint", type="fixed")
    ET.SubElement(joint, "parent").text = subject.file_link
    ET.SubElement(joint, "child").text = PAYLOAD
    return [*element_lines(link), *element_lines(joint)]


def _link(document: Document, name: str) -> Element:
    links = [e for e in document.root.walk() if e.tag == "link" and e.attributes.get("name") == name and e.parent]
    if len(links) != 1:
        raise ModelError(f"{str(document.path)!r} has {len(links)} links called {name!r}; it must have one")
    return links[0]


def _payload_edits(document: Document, link: Element, lines: list[str]) -> list[Edit]:
    assert link.parent is not None
    refuse_second_payload(document, link.parent, "link")
    return [document.put(link.parent, lines, last=True)]


def _inertial_edits(document: Document, link: Element, body: InertialParameters, header: tuple[str, ...]) -> list[Edit]:
    _refuse_fixed_links(document, link)
    poses = [pose for inertial in link.all("inertial")[:1] for pose in inertial.all("pose")[:1]]
    frame = [edit for pose in poses for edit in document.unset(pose, "degrees", "rotation_format", "relative_to")]
    return [*frame, *document.put_child(link, _inertial(body), header)]


def _refuse_fixed_links(document: Document, link: Element) -> None:
    """Raise ModelError for links that are fixed to the base, which would be counted twice."""
    assert link.parent is not None
    for joint in link.parent.all("joint"):
        ends = [_text(document, joint.first(tag)) for tag in ("parent", "child")]
        if joint.attributes.get("type") == "fixed" and link.attributes["name"] in ends:
            raise ModelError(
                f"{str(document.path)!r} fixes links to {link.attributes['name']!r} (joint "
                f"{joint.attributes.get('name')!r}), whose masses would be counted twice: join them, as Gazebo does when it "
                "reads a URDF, or use --add-payload-link"
            )


def _text(document: Document, element: Element | None) -> str:
    return "" if element is None else document.data[element.inside : element.inside_end].decode().strip()
