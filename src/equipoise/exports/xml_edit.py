"""XML files changed at a few places, and to the byte as they were everywhere else.

Expat, the parser behind Python's readers, says where each element begins; what is found there is replaced as text. So
comments, white space, line ends, attribute quotes, encoding and byte order mark stay what they are.
"""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from equipoise.errors import ModelError

_BOMS = ((codecs.BOM_UTF8, "utf-8"), (codecs.BOM_UTF16_LE, "utf-16-le"), (codecs.BOM_UTF16_BE, "utf-16-be"))
_DECLARED = re.compile(rb"<\?xml[^>]*?encoding\s*=\s*[\"']([A-Za-z0-9._:-]+)")
_ATTRIBUTE = re.compile(rb"\s+([^\s=/>]+)\s*=\s*(\"[^\"]*\"|'[^']*')")
_START_TAG = re.compile(rb"<[^\s/>]+(?:" + _ATTRIBUTE.pattern + rb")*\s*/?>")
_OUR_COMMENT = re.compile(rb"<!-- equipoise (?:(?!-->).)*-->\s*\Z", re.DOTALL)


@dataclass(frozen=True)
class Edit:
    """New text for the bytes from start to end, positions in `Document.data`."""

    start: int
    end: int
    text: str


@dataclass(eq=False)
class Element:
    """An element and where it is in `Document.data`.

    Attributes:
        tag: name of the element as written, prefix included.
        attributes: values of the attributes by name, entities resolved.
        start, inside, inside_end, end: where it begins, its content begins and ends, and it ends; an element without
            content (`<a/>`) has none, and inside = inside_end = end.
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
        """Its children of these tags."""
        return [child for child in self.children if child.tag in tags]

    def first(self, tag: str) -> Element | None:
        """Its first child of that tag, or None."""
        return next(iter(self.all(tag)), None)

    def walk(self) -> Iterator[Element]:
        """Itself and all below, in the order of the file."""
        yield self
        for child in self.children:
            yield from child.walk()


class Document:
    """An XML file that is to be edited.

    Attributes:
        path: path that messages call it by.
        data: text of the file in UTF-8, without the byte order mark.
        root: outermost element.
    """

    def __init__(self, content: bytes, path: Path) -> None:
        self.path = path
        self._bom, self._encoding = _encoding(content)
        try:
            text = content[len(self._bom) :].decode(self._encoding)
            if text.encode(self._encoding) != content[len(self._bom) :]:
                raise ModelError(f"{str(path)!r} does not come through its encoding, {self._encoding}, unchanged")
        except (UnicodeError, LookupError) as error:
            raise ModelError(f"{str(path)!r} cannot be read in its encoding: {error}") from error
        self.data = text.encode()
        self.root = _parse(self.data, path)

    def edited(self, edits: Iterable[Edit]) -> bytes:
        """The file with edits, in its own encoding."""
        data = self.data
        for edit in sorted(edits, key=lambda edit: (edit.start, edit.end), reverse=True):
            data = data[: edit.start] + edit.text.encode() + data[edit.end :]
        return self._bom + data.decode().encode(self._encoding)

    def set(self, element: Element, name: str, value: str) -> Edit:
        """Give an attribute a value: a number or a name, with nothing in it that XML would have to escape."""
        at = element.start + 1 + len(element.tag.encode())
        for match in self._attributes(element):
            if match[1].decode() == name:
                return Edit(match.start(2) + 1, match.end(2) - 1, value)
            at = match.end()
        return Edit(at, at, f' {name}="{value}"')

    def unset(self, element: Element, *names: str) -> list[Edit]:
        """Take attributes out, with the space before each."""
        return [Edit(m.start(), m.end(), "") for m in self._attributes(element) if m[1].decode() in names]

    def fill(self, element: Element, text: str) -> Edit:
        """Give an element other content."""
        if element.closed:
            return Edit(element.inside, element.inside_end, text)
        slash = self.data.rindex(b"/", element.start, element.end)
        return Edit(slash, element.end, f">{text}</{element.tag}>")

    def put(self, element: Element, lines: Iterable[str], last: bool = False) -> Edit:
        """Put lines before an element's first child, or behind its last one."""
        margin = self.margin(element.children[0]) if element.children else self.margin(element) + "  "
        text = "".join(f"{margin}{line}" for line in lines)
        if not element.closed:
            return self.fill(element, text + self.margin(element))
        if not last:
            return Edit(element.inside, element.inside, text)
        content = self.data[element.inside : element.inside_end]
        at = element.inside + len(content.rstrip())  # before the end tag's own indentation
        return Edit(at, at, text)

    def margin(self, element: Element) -> str:
        """The line end and indentation before an element; nothing where it does not begin its line."""
        before = self.data[: element.start]
        blank = before[len(before.rstrip(b" \t")) :]
        before = before[: len(before) - len(blank)]
        if not before.endswith((b"\n", b"\r")):
            return ""
        end = "\r\n" if before.endswith(b"\r\n") else before[-1:].decode()
        return end + blank.decode()

    def comment(self, element: Element, lines: Iterable[str]) -> Edit:
        """Say something before an element; takes the place of what an earlier export said there."""
        said = _OUR_COMMENT.search(self.data, 0, element.start)
        margin = self.margin(element)
        text = (margin or " ").join(comment_lines(lines))
        return Edit(said.start() if said else element.start, element.start, text + margin)

    def _attributes(self, element: Element) -> Iterator[re.Match[bytes]]:
        tag_end = element.inside if element.closed else element.end
        return _ATTRIBUTE.finditer(self.data, element.start + 1 + len(element.tag.encode()), tag_end)


def comment_lines(lines: Iterable[str]) -> list[str]:
    """A comment, line by line."""
    first, *others = (comment_text(line) for line in lines)
    return [f"<!-- {first}", *(f"     {line}" for line in others), "-->"]


def escaped(name: str) -> str:
    """A name as an attribute in double quotes may hold it."""
    return name.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")


def comment_text(line: str) -> str:
    """A line as an XML comment may hold it in any encoding: printable ASCII, and no two hyphens in a row."""
    plain = re.sub(r"[^ -~]", "?", line.encode("ascii", "backslashreplace").decode())
    return re.sub(r"-(?=-)", "- ", plain).rstrip("-")


def _encoding(content: bytes) -> tuple[bytes, str]:
    for bom, encoding in _BOMS:
        if content.startswith(bom):
            return bom, encoding
    declared = _DECLARED.match(content)
    return b"", declared[1].decode() if declared else "utf-8"


def _parse(data: bytes, path: Path) -> Element:
    parser = expat.ParserCreate("utf-8")  # whatever the file declares: the text is in UTF-8 by now
    stack: list[Element] = []
    roots: list[Element] = []

    def start(tag: str, attributes: dict[str, str]) -> None:
        at = parser.CurrentByteIndex
        match = _START_TAG.match(data, at)
        if match is None or not data.startswith(f"<{tag}".encode(), at):
            raise ModelError(f"{str(path)!r}: <{tag}> comes from an entity, which cannot be edited; write it out")
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
