"""Audit findings as GitHub workflow commands, which annotate the lines of a change."""

from __future__ import annotations

import re

from equipoise.errors import EquipoiseError
from equipoise.robot.audit import Audit
from equipoise.user_file import read_bytes

_LEVELS = {"error": "error", "warning": "warning", "note": "notice"}
_ESCAPES = {"%": "%25", "\r": "%0D", "\n": "%0A"}
_ESCAPES_OF_PROPERTIES = {**_ESCAPES, ":": "%3A", ",": "%2C"}


def annotation_lines(path: str, result: Audit) -> list[str]:
    """Return one annotation for each finding, at the line of the first body that it names.

    Args:
        path: path of the model file as passed by the user, or name of a robot, which has no lines.
    """
    text = _text(path)
    return [
        _annotation(
            _LEVELS[finding.severity], path, _line(text, finding.body.split(",")[0]), finding.body, finding.text
        )
        for finding in result.findings
    ]


def error_annotation(path: str, error: EquipoiseError) -> str:
    """Return the annotation of a file that cannot be read, or is not a quadruped."""
    return _annotation("error", path, 1, "", str(error))


def _text(path: str) -> str:
    try:
        return read_bytes(path).decode(errors="replace")
    except OSError:
        return ""


def _line(text: str, body: str) -> int:
    """Return the line of <link name="body"> or <body name="body">, or 1 if there is none."""
    found = re.search(rf"<(?:link|body)\b[^>]*?\bname\s*=\s*[\"']{re.escape(body)}[\"']", text)
    return 1 + text.count("\n", 0, found.start()) if body and found else 1


def _annotation(level: str, path: str, line: int, body: str, text: str) -> str:
    properties = {"file": path, "line": str(line), "title": f"equipoise audit{': ' if body else ''}{body}"}
    words = ",".join(f"{key}={_escaped(value, _ESCAPES_OF_PROPERTIES)}" for key, value in properties.items())
    return f"::{level} {words}::{_escaped(text, _ESCAPES)}"


def _escaped(text: str, escapes: dict[str, str]) -> str:
    return "".join(escapes.get(letter, letter) for letter in text)
