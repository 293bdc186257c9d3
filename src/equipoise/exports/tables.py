"""All numbers with intervals and verdicts, as JSON or YAML, for the user's own tools."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, cast

from equipoise._version import __version__
from equipoise.exports.parameters import BASE, Column
from equipoise.exports.subject import COMPOSITE_WORDS, Subject, Written, number
from equipoise.result.body import Body
from equipoise.robot.inertial import InertialParameters

SCHEMA = "equipoise.inertia/1"
_PLAIN = re.compile(r"[A-Za-z_/][\w/*.-]*", re.ASCII)  # keys that need no quotes
_WORDS = ("y", "n", "yes", "no", "on", "off", "true", "false", "null")  # which YAML 1.1 reads as something else


def write_json(subject: Subject) -> Written:
    """Write all numbers as JSON."""
    about = _about(subject)
    return Written((json.dumps(_table(subject, about), indent=2) + "\n").encode(), about)


def write_yaml(subject: Subject) -> Written:
    """Write all numbers as YAML."""
    about = _about(subject)
    return Written.text(yaml_lines(_table(subject, about)), about)


def _about(subject: Subject) -> str:
    bodies = f"{COMPOSITE_WORDS}; base: {subject.base_words}" if BASE in subject.parts else ""
    columns = subject.columns_words if subject.columns else ""
    return "; ".join(words for words in (bodies, columns) if words)


def _table(subject: Subject, about: str) -> dict[str, Any]:
    table = provenance(subject, SCHEMA, about)
    if BASE in subject.parts:
        table["stance"] = subject.result.stance_dict()
        table["composite"] = _body(subject.result.composite, subject.composite)
        table["base"] = _body(subject.result.base, subject.base)
    return {**table, **columns_table(subject.columns)}


def provenance(subject: Subject, schema: str, about: str) -> dict[str, Any]:
    """Return the provenance of the numbers, and the objections to them."""
    result = subject.result
    return {
        "schema": schema,
        "equipoise": __version__,
        "about": about,
        "contents": subject.contents,
        "robot": result.robot,
        "run": subject.run,
        "method": result.method,
        "time": result.provenance.get("time"),
        "model": dict(result.model),
        "notes": list(subject.notes),
    }


def columns_table(columns: Iterable[Column]) -> dict[str, Any]:
    """Return values, standard deviations and verdicts of sensors and motors, by part and name."""
    table: dict[str, Any] = {}
    for column in columns:
        value = {key: column.number(key) for key in column.values}
        std = {key: float(quantity.std or 0.0) for key, quantity in column.values.items()}
        verdict = {key: quantity.verdict for key, quantity in column.values.items()}
        row = {"unit": column.unit, "meaning": column.meaning, "value": value, "std": std, "verdict": verdict}
        table.setdefault(column.part, {})[column.name] = row
    return table


def _body(found: Body, written: InertialParameters) -> dict[str, Any]:
    table = Body.complete(written).numbers()
    with_std = [quantity for quantity in found if quantity.std is not None]
    if with_std:
        table["std"] = {quantity.name: quantity.std for quantity in with_std}
        table["verdict"] = {quantity.name: quantity.verdict for quantity in with_std}
    return table


def yaml_lines(table: Mapping[str, Any], indent: str = "") -> list[str]:
    """Return a table of tables, numbers, lists and texts as YAML."""
    lines: list[str] = []
    for key, value in table.items():
        name = key if _PLAIN.fullmatch(key) and key.lower() not in _WORDS else json.dumps(key)
        if isinstance(value, Mapping) and value:
            lines += [f"{indent}{name}:", *yaml_lines(cast("Mapping[str, Any]", value), indent + "  ")]
        else:
            lines.append(f"{indent}{name}: {_yaml(value)}")
    return lines


def _yaml(value: Any) -> str:
    """Return one value; numbers suit YAML 1.1 too, which reads 1e-05 as text, but not 1.0e-05."""
    if isinstance(value, float):
        mantissa, e, exponent = number(value).partition("e")
        return f"{mantissa if '.' in mantissa or not e else mantissa + '.0'}{e}{exponent}"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return f"[{', '.join(map(_yaml, cast('Sequence[Any]', value)))}]"
    return json.dumps(value)
