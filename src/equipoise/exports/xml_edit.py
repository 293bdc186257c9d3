"""Local edits of XML files that leave all other bytes unchanged.

Expat, the parser behind Python's readers, reports the position of each element, whose text is then replaced. So comments,
white space, line ends, attribute quotes, encoding and byte order mark do not change.
"""

from __future__ import annotations

import codecs
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat
from xml.sax.saxutils import escape

from equipoise.errors import ModelError

_BOMS = ((codecs.BOM_UTF8, "utf-8"), (codecs.BOM_UTF16_LE, "utf-16-le"), (codecs.BOM_UTF16_BE, "utf-16-be"))
_DECLARED = re.compile(rb"<\?xml[^>]*?encoding\s*=\s*[\"']([A-Za-z0-9._:-]+)")
_ATTRIBUTE = re.compile(rb"\s+([^\s=/>]+)\s*=\s*(\"[^\"]*\"|'[^']*')")
_START_TAG = re.compile(rb"<[^\s/>]+(?:" + _ATTRIBUTE.pattern + rb")*\s*/?>")
_QUOTES = {'"': "&quot;", "'": "&apos;"}
_OUR_COMMENT = re.compile(rb"<!-- equipoise (?:(?!-->).)*-->\s*\Z", re.DOTALL)

Edit = tuple[int, int, str]
"""Start and end of bytes in `Document.data`, and the text that replaces them."""


@dataclass(eq=False)
class Element:
    """Element and its position in `Document.data`.

    Attributes:
        tag: name of the element as written, prefix included.
        attributes: values of the attributes by name, entities resolved.
        start, inside, inside_end, end: positions of its begin, the begin and end of its content, and its end; for an
            element without content (`<a/>`) inside = inside_end = end.
        closed: whether it is written with an end tag.
    """

    tag: str
    attributes: dict[str, str]
    parent: Element | None
    start: int
    inside: int
    inside_end: int
    end: int
    closed: bool
    children: list[Element] = field(default_factory=list["Element"])

    def all(self, *tags: str) -> list[Element]:
        """Return its children with these tags."""
        return [child for child in self.children if child.tag in tags]

    def first(self, tag: str) -> Element | None:
        """Return its first child with that tag, or None."""
        return next(iter(self.all(tag)), None)

    def walk(self) -> Iterator[Element]:
        """Yield the element and all below it, in the order of the file."""
        yield self
        for child in self.children:
            yield from child.walk()


class Document:
    """XML file to edit.

    Attributes:
        path: path of the file, for messages.
        data: text of the file in UTF-8, without the byte order mark.
        root: outermost element.
    """

    def __init__(self, content: bytes, path: Path) -> None:
        self.path = path
        self._bom, self._encoding = _encoding(content)
        try:
            text = content[len(self._bom) :].decode(self._encoding)
            if text.encode(self._encoding) != content[len(self._bom) :]:
                raise ModelError(f"{str(path)!r} does not survive decoding as {self._encoding}; save it as UTF-8")
        except (UnicodeError, LookupError) as error:
            raise ModelError(f"{str(path)!r} cannot be read in its encoding: {error}") from error
        self.data = text.encode()
        self.root = _parse(self.data, path)

    def edited(self, edits: Iterable[Edit]) -> bytes:
        """Return the edited file in its own encoding."""
        data = self.data
        for start, end, text in sorted(edits, key=lambda edit: edit[:2], reverse=True):
            data = data[:start] + text.encode() + data[end:]
        return self._bom + data.decode().encode(self._encoding)

    def set(self, element: Element, name: str, value: str) -> Edit:
        """Set an attribute."""
        value = escape(value, _QUOTES)
        at = element.start + 1 + len(element.tag.encode())
        for match in self._attributes(element):
            if match[1].decode() == name:
                return match.start(2) + 1, match.end(2) - 1, value
            at = match.end()
        return at, at, f' {name}="{value}"'

    def unset(self, element: Element, *names: str) -> list[Edit]:
        """Remove attributes, with the space before each."""
        return [(m.start(), m.end(), "") for m in self._attributes(element) if m[1].decode() in names]

    def fill(self, element: Element, text: str) -> Edit:
        """Replace the content of an element."""
        if element.closed:
            return element.inside, element.inside_end, text
        slash = self.data.rindex(b"/", element.start, element.end)
        return slash, element.end, f">{text}</{element.tag}>"

    def put(self, element: Element, lines: Iterable[str], last: bool = False) -> Edit:
        """Insert lines before an element's first child, or after its last one."""
        margin = self.margin(element.children[0]) if element.children else self.margin(element) + "  "
        text = "".join(f"{margin}{line}" for line in lines)
        if not element.closed:
            return self.fill(element, text + self.margin(element))
        if not last:
            return element.inside, element.inside, text
        content = self.data[element.inside : element.inside_end]
        at = element.inside + len(content.rstrip())  # before the end tag's own indentation
        return at, at, text

    def put_child(
        self, element: Element, child: ET.Element, comment: Sequence[str] = (), last: bool = False
    ) -> list[Edit]:
        """Insert a child, or complete the present one of that tag, with a comment before it if there is one."""
        present = element.first(child.tag)
        if present is None:
            return [self.put(element, [*comment_lines(comment), *element_lines(child)], last)]
        return [*([self.comment(present, comment)] if comment else []), *self.complete(present, child)]

    def complete(self, element: Element, wanted: ET.Element) -> list[Edit]:
        """Give an element the attributes, the text and the children of another; its own others do not change."""
        edits = [self.set(element, name, value) for name, value in wanted.items()]
        edits += [self.fill(element, wanted.text)] if wanted.text else []
        missing: list[str] = []
        for child in wanted:
            present = element.first(child.tag)
            if present is None:
                missing += element_lines(child)
            else:
                edits += self.complete(present, child)
        return [*edits, self.put(element, missing)] if missing else edits

    def margin(self, element: Element) -> str:
        """Return the line end and indentation before an element; empty if it does not begin its line."""
        before = self.data[: element.start]
        blank = before[len(before.rstrip(b" \t")) :]
        before = before[: len(before) - len(blank)]
        if not before.endswith((b"\n", b"\r")):
            return ""
        end = "\r\n" if before.endswith(b"\r\n") else before[-1:].decode()
        return end + blank.decode()

    def comment(self, element: Element, lines: Sequence[str]) -> Edit:
        """Insert a comment before an element, in place of that of an earlier export."""
        earlier = _OUR_COMMENT.search(self.data, 0, element.start)
        margin = self.margin(element)
        text = (margin or " ").join(comment_lines(lines))
        return earlier.start() if earlier else element.start, element.start, text + margin

    def _attributes(self, element: Element) -> Iterator[re.Match[bytes]]:
        tag_end = element.inside if element.closed else element.end
        return _ATTRIBUTE.finditer(self.data, element.start + 1 + len(element.tag.encode()), tag_end)


def comment_lines(lines: Sequence[str]) -> list[str]:
    """Return a comment, line by line; nothing for one without lines."""
    if not lines:
        return []
    first, *others = (comment_text(line) for line in lines)
    return [f"<!-- {first}", *(f"     {line}" for line in others), "-->"]


def element_lines(element: ET.Element) -> list[str]:
    """Return a new element, line by line."""
    ET.indent(element)
    return ET.tostring(element, encoding="unicode").replace(" />", "/>").split("\n")


def comment_text(line: str) -> str:
    """Return a line valid in an XML comment in any encoding: printable ASCII, and no two hyphens in a row."""
    plain = re.sub(r"[^ -~]", "?", line.encode("ascii", "backslashreplace").decode())
    return re.sub(r"-(?=-)", "- ", plain).rstrip("-")


def _encoding(content: bytes) -> tuple[bytes, str]:
    for bom, encoding in _BOMS:
        if content.startswith(bom):
            return bom, encoding
    declared = _DECLARED.match(content)
    return b"", declared[1].decode() if declared else "utf-8"


def _parse(data: bytes, path: Path) -> Element:
    parser = expat.ParserCreate("utf-8")  # the text is in UTF-8 now, whatever the file declares
    stack: list[Element] = []
    roots: list[Element] = []

    def start(tag: str, attributes: dict[str, str]) -> None:
        at = parser.CurrentByteIndex
        match = _START_TAG.match(data, at)
        if match is None or not data.startswith(f"<{tag}".encode(), at):
            raise ModelError(f"{str(path)!r}: <{tag}> comes from an entity, which cannot be edited; expand the entity")
        parent = stack[-1] if stack else None
        closed = not match[0].endswith(b"/>")
        element = Element(tag, attributes, parent, at, match.end(), match.end(), match.end(), closed)
        (parent.children if parent else roots).append(element)
        stack.append(element)

    def end(_: str) -> None:
        element = stack.pop()
        if element.closed:
            element.inside_end = parser.CurrentByteIndex
            element.end = data.index(b">", element.inside_end) + 1

    parser.StartElementHandler, parser.EndElementHandler = start, end
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise ModelError(f"{str(path)!r} is not valid XML: {error}") from error
    return roots[0]
