"""All numbers of both bodies with intervals and verdicts, as JSON or YAML, for tools of the user's own."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, cast

from equipoise._version import __version__
from equipoise.exports.subject import Subject, number
from equipoise.exports.written import Written
from equipoise.result.body import Body, parameters_to_dict
from equipoise.robot.inertial import InertialParameters

SCHEMA = "equipoise.inertia/1"


def write_json(subject: Subject) -> Written:
    """As JSON."""
    about = _about(subject)
    return Written((json.dumps(_table(subject, about), indent=2) + "\n").encode(), about)


def write_yaml(subject: Subject) -> Written:
    """As YAML."""
    about = _about(subject)
    return Written.text(list(_lines(_table(subject, about), "")), about)


def _about(subject: Subject) -> str:
    return f"{subject.composite_words}; base: {subject.base_words}"


def _table(subject: Subject, about: str) -> dict[str, Any]:
    result = subject.result
    return {
        "schema": SCHEMA,
        "equipoise": __version__,
        "about": about,
        "robot": result.robot,
        "run": subject.run,
        "method": result.method,
        "time": result.provenance.get("time"),
        "model": dict(result.model),
        "notes": list(subject.notes),
        "stance": result.stance_dict(),
        "composite": _body(result.composite, subject.composite),
        "base": _body(result.base, subject.base),
    }


def _body(found: Body, written: InertialParameters) -> dict[str, Any]:
    table = parameters_to_dict(written)
    told = [quantity for quantity in found if quantity.deviation is not None]
    if told:
        table["deviation"] = {quantity.name: quantity.deviation for quantity in told}
        table["verdict"] = {quantity.name: quantity.verdict for quantity in told}
    return table


def _lines(table: Mapping[str, Any], indent: str) -> list[str]:
    lines: list[str] = []
    for key, value in table.items():
        if isinstance(value, Mapping) and value:
            lines += [f"{indent}{key}:", *_lines(cast("Mapping[str, Any]", value), indent + "  ")]
        else:
            lines.append(f"{indent}{key}: {_yaml(value)}")
    return lines


def _yaml(value: Any) -> str:
    """One value; a number so that readers of YAML 1.1 take it for one too: 1e-05 is text there, 1.0e-05 is not."""
    if isinstance(value, float):
        mantissa, e, exponent = number(value).partition("e")
        return f"{mantissa if '.' in mantissa or not e else mantissa + '.0'}{e}{exponent}"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return f"[{', '.join(map(_yaml, cast('Sequence[Any]', value)))}]"
    return json.dumps(value)
