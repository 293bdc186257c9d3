"""SDF (Gazebo): the <inertial> of the base link, or a link for the payload; alone, or in the user's own file.

Gazebo's reader joins all links fixed to a URDF's base into one link, so the link gets the whole base.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias

from equipoise.errors import ModelError
from equipoise.exports.model_file import payload
from equipoise.exports.model_writer import refuse_second_payload
from equipoise.exports.subject import PAYLOAD, Subject, Written, number, numbers, products
from equipoise.exports.xml_edit import Document, Edit, Element, comment_lines, escaped
from equipoise.robot.inertial import InertialParameters

Content: TypeAlias = "str | Mapping[str, Content]"
"""Text of an element, or its children by tag."""


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
        element = _lines("inertial", _inertial(body))
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


def _inertial(body: InertialParameters) -> Content:
    """Return the content of an <inertial> element in its link's axes."""
    moments = {key: number(value) for key, value in products(body.inertia).items()}
    return {"pose": f"{numbers(body.com)} 0 0 0", "mass": number(body.mass), "inertia": moments}


def _lines(tag: str, content: Content) -> list[str]:
    """Return an element."""
    if isinstance(content, str):
        return [f"<{tag}>{content}</{tag}>"]
    inner = [line for key, value in content.items() for line in _lines(key, value)]
    return [f"<{tag}>", *(f"  {line}" for line in inner), f"</{tag}>"]


def _edits(document: Document, element: Element, content: Content) -> list[Edit]:
    """Return edits that give an element this content; its other children do not change."""
    if isinstance(content, str):
        return [document.fill(element, content)]
    edits, missing = list[Edit](), list[str]()
    for tag, value in content.items():
        child = element.first(tag)
        if child is None:
            missing += _lines(tag, value)
        else:
            edits += _edits(document, child, value)
    return [*edits, document.put(element, missing)] if missing else edits


def _payload_lines(subject: Subject, body: InertialParameters) -> list[str]:
    base = escaped(subject.file_link)
    return [
        f'<link name="{PAYLOAD}">',
        f'  <pose relative_to="{base}">0 0 0 0 0 0</pose>',
        *(f"  {line}" for line in _lines("inertial", _inertial(body))),
        "</link>",
        f'<joint name="{PAYLOAD}_joint" type="fixed">',
        f"  <parent>{base}</parent>",
        f"  <child>{PAYLOAD}</child>",
        "</joint>",
    ]


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
    inertial = link.first("inertial")
    if inertial is None:
        return [document.put(link, [*comment_lines(header), *_lines("inertial", _inertial(body))])]
    pose = inertial.first("pose")
    frame = [] if pose is None else document.unset(pose, "degrees", "rotation_format", "relative_to")
    return [document.comment(inertial, header), *frame, *_edits(document, inertial, _inertial(body))]


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
