"""Local edits of XML files: all other bytes stay unchanged."""

import codecs
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from equipoise.errors import ModelError
from equipoise.exports.xml_edit import Document, comment_lines, comment_text, element_lines

PATH = Path("robot.urdf")


def document(text):
    return Document(text.encode(), PATH)


spaces = st.text(" \t\n", min_size=1, max_size=3)
quotes = st.sampled_from("\"'")
words = st.text(st.characters(codec="latin-1", exclude_characters="<>&\"'-]?\r", min_codepoint=32), max_size=8)


@st.composite
def attributes(draw):
    """Draw a start tag's attributes with odd spaces, quotes, and a bracket in a value."""
    parts = []
    for name in draw(st.lists(st.sampled_from(["value", "note", "a.b", "x-y"]), unique=True)):
        quote = draw(quotes)
        value = draw(words) + draw(st.sampled_from(["", ">", "&lt;"]))
        parts.append(f"{draw(spaces)}{name}{draw(st.sampled_from(['', ' ', chr(10)]))}={quote}{value}{quote}")
    return "".join(parts)


@st.composite
def around(draw):
    """Draw text between elements: comments and CDATA that look like the element, and plain text."""
    kinds = [
        draw(words), f"<!-- <mass value='1'/> {draw(words)} -->", "<![CDATA[<mass value='2'/>]]>", "<?tool <mass/> ?>",
        draw(spaces), f"<link{draw(attributes())}/>", f"<mast{draw(attributes())}>{draw(words)}</mast >",
    ]  # fmt: skip
    return "".join(draw(st.lists(st.sampled_from(kinds), max_size=4)))


@st.composite
def files(draw):
    """Draw a file, its text, and the text of the tag <mass ...> in it."""
    tag = f"<mass{draw(attributes())}{draw(st.sampled_from(['', ' ', chr(10)]))}/>"
    encoding, bom = draw(
        st.sampled_from(
            [
                ("utf-8", b""),
                ("utf-8", codecs.BOM_UTF8),
                ("latin-1", b""),
                ("utf-16-le", codecs.BOM_UTF16_LE),
                ("utf-16-be", codecs.BOM_UTF16_BE),
            ]
        )
    )
    declared = {"latin-1": "iso-8859-1", "utf-8": "utf-8"}.get(encoding, "utf-16")
    text = f"<?xml version='1.0' encoding='{declared}'?>\n<robot>{draw(around())}{tag}{draw(around())}</robot>\n"
    text = text.replace("\n", draw(st.sampled_from(["\n", "\r\n"])))
    return bom + text.encode(encoding), encoding


@settings(max_examples=60)
@given(files())
def test_one_attribute_changes_and_nothing_else(case):
    content, encoding = case
    before = Document(content, PATH)
    assert before.edited([]) == content
    mass = before.root.first("mass")
    edited = before.edited([before.set(mass, "value", "4.5")])
    root, old = ET.fromstring(edited), ET.fromstring(content)
    assert root.find("mass").attrib == {**old.find("mass").attrib, "value": "4.5"}
    root.find("mass").attrib = old.find("mass").attrib
    assert ET.tostring(root) == ET.tostring(old)
    unit = len("<".encode(encoding))
    bom = len(content) - len(
        content.decode("utf-16" if unit == 2 else encoding).removeprefix("\ufeff").encode(encoding)
    )
    start = bom + len(before.data[: mass.start].decode().encode(encoding))
    end = len(before.data[mass.end :].decode().encode(encoding))
    assert edited[:start] == content[:start]
    assert edited[len(edited) - end :] == content[len(content) - end :]


@settings(max_examples=60)
@given(files())
def test_an_attribute_is_removed_with_the_space_before_it(case):
    content, _ = case
    before = Document(content, PATH)
    mass = before.root.first("mass")
    edited = ET.fromstring(before.edited(before.unset(mass, "value", "x-y")))
    assert set(edited.find("mass").attrib) == set(mass.attributes) - {"value", "x-y"}


def test_lines_are_put_with_the_indentation_and_the_line_ends_of_the_file():
    text = "<robot>\r\n\t<link>\r\n\t\t<visual/>\r\n\t</link>\r\n</robot>"
    edited = document(text).edited([document(text).put(document(text).root.first("link"), ["<a/>", "<b/>"])])
    assert edited.decode() == text.replace("\t\t<visual/>", "\t\t<a/>\r\n\t\t<b/>\r\n\t\t<visual/>")


def test_lines_are_put_behind_the_last_child():
    text = "<robot>\n  <link/>\n</robot>\n"
    file = document(text)
    assert (
        file.edited([file.put(file.root, ["<joint/>"], last=True)]).decode()
        == "<robot>\n  <link/>\n  <joint/>\n</robot>\n"
    )


def test_an_empty_element_gets_content():
    file = document("<robot>\n  <link name='a'/>\n</robot>")
    edited = file.edited([file.put(file.root.first("link"), ["<inertial/>"])]).decode()
    assert edited == "<robot>\n  <link name='a'>\n    <inertial/>\n  </link>\n</robot>"
    assert document("<a><b/></a>").edited(
        [document("<a><b/></a>").fill(document("<a><b/></a>").root.first("b"), "1")]
    ) == (b"<a><b>1</b></a>")


def test_the_comment_of_an_earlier_export_is_replaced():
    file = document("<robot>\n  <!-- mine -->\n  <mass/>\n</robot>")
    once = Document(file.edited([file.comment(file.root.first("mass"), ["equipoise 1: old", "more"])]), PATH)
    twice = once.edited([once.comment(once.root.first("mass"), ["equipoise 2: new"])]).decode()
    assert twice == "<robot>\n  <!-- mine -->\n  <!-- equipoise 2: new\n  -->\n  <mass/>\n</robot>"


@given(st.lists(st.text(min_size=1), min_size=1, max_size=3))
def test_any_text_can_stand_in_a_comment_of_any_encoding(lines):
    text = "\n".join(comment_lines(lines))
    ET.fromstring(f"<a>{text}</a>")
    assert text.isascii()


def test_hyphens_are_kept_apart():
    assert comment_text("--force a---b -") == "- -force a- - -b "


@pytest.mark.parametrize("quote", ["'", '"'])
def test_a_value_is_escaped_in_quotes_of_either_kind(quote):
    name = "a<b&\"c'd"
    file = document(f"<robot name={quote}old{quote}><link/></robot>")
    root = ET.fromstring(
        file.edited([file.set(file.root, "name", name), file.set(file.root.first("link"), "name", name)])
    )
    assert root.attrib == root.find("link").attrib == {"name": name}


def test_a_new_element_is_escaped():
    element = ET.Element("link", name='a<b&"c')
    assert element_lines(element) == ['<link name="a&lt;b&amp;&quot;c"/>']


def test_elements_of_an_entity_are_refused():
    text = '<!DOCTYPE robot [<!ENTITY e "<mass/>">]><robot>&e;</robot>'
    with pytest.raises(ModelError, match="comes from an entity"):
        document(text)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"<robot", "is not valid XML"),
        (b"<?xml version='1.0' encoding='no-such'?><a/>", "cannot be read in its encoding"),
        (b"<robot>\xff</robot>", "cannot be read in its encoding"),
    ],
)
def test_unreadable_files_are_refused(content, reason):
    with pytest.raises(ModelError, match=reason):
        Document(content, PATH)
