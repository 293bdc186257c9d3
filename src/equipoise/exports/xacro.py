"""Properties of legged_control's const.xacro, in a new file or in the user's."""

from __future__ import annotations

from equipoise.errors import SettingsError
from equipoise.exports.subject import Subject, Written, number, products
from equipoise.exports.xml_edit import Document, comment_lines

_PREFIX = "trunk"


def write(subject: Subject) -> Written:
    """Write trunk_mass, trunk_com_x ... trunk_izz."""
    values = _properties(subject)
    header = subject.header(subject.words_in_file)
    if subject.file is not None:
        return Written(_edited(subject, values, header), subject.words_in_file)
    lines = [
        '<?xml version="1.0"?>',
        '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="trunk_inertia">',
        *(f"  {line}" for line in comment_lines(header)),
        *(f'  <xacro:property name="{name}" value="{value}"/>' for name, value in values.items()),
        "</robot>",
    ]
    return Written.text(lines, subject.words_in_file)


def _properties(subject: Subject) -> dict[str, str]:
    base = subject.base_in_file
    values = {"mass": base.mass, **{f"com_{axis}": value for axis, value in zip("xyz", base.com, strict=True)}}
    return {f"{_PREFIX}_{name}": number(value) for name, value in {**values, **products(base.inertia)}.items()}


def _edited(subject: Subject, values: dict[str, str], header: tuple[str, ...]) -> bytes:
    assert subject.file is not None
    document = Document(subject.file.content, subject.file.path)
    found = {
        name: [e for e in document.root.walk() if e.tag.endswith(":property") and e.attributes.get("name") == name]
        for name in values
    }
    wrong = [name for name, elements in found.items() if len(elements) != 1]
    if wrong:
        raise SettingsError(
            f"{str(document.path)!r} must define each of {', '.join(values)} once; it does not define {', '.join(wrong)} once"
        )
    edits = [document.set(found[name][0], "value", value) for name, value in values.items()]
    first = min((elements[0] for elements in found.values()), key=lambda element: element.start)
    return document.edited([document.comment(first, header), *edits])
