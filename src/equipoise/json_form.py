"""Conversion of dataclasses to JSON tables by field name, and back by the types of the fields.

A class with its own form has `to_dict` and `from_dict`. `COMPUTED` of a class names properties that are written in addition
to its fields, and are not read.
"""

from __future__ import annotations

import dataclasses
import functools
import numbers
import types
import typing
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar, cast

from equipoise.errors import SettingsError

Kind = TypeVar("Kind")
_PLAIN: Mapping[type, tuple[type, str]] = {
    float: (numbers.Real, "a number"),
    int: (numbers.Integral, "a whole number"),
    bool: (bool, "true or false"),
    str: (str, "a text"),
}
"""Types of JSON values for each type of a field, and words for them."""


def to_json(value: Any) -> Any:
    """Return dataclasses, mappings, sequences and arrays as JSON values; others as they are."""
    if hasattr(value, "to_dict"):
        return value.to_dict()
    if dataclasses.is_dataclass(value):
        return fields_to_json(value)
    if isinstance(value, Mapping):
        return {name: to_json(entry) for name, entry in cast("Mapping[str, Any]", value).items()}
    if isinstance(value, (tuple, list)):
        return [to_json(entry) for entry in cast("Sequence[Any]", value)]
    return value.tolist() if hasattr(value, "tolist") else value


def fields_to_json(value: Any) -> dict[str, Any]:
    """Return the fields and computed properties of a dataclass as a table of JSON values."""
    names = (*(field.name for field in dataclasses.fields(value)), *getattr(value, "COMPUTED", ()))
    return {name: to_json(getattr(value, name)) for name in names}


def from_json(kind: type[Kind], value: Any, name: str = "") -> Kind:
    """Return a dataclass from a table by field name; fields that the table lacks have their defaults.

    Args:
        name: name of the table in messages, as in "com_search".

    Raises:
        SettingsError: a name is unknown or missing, or a value is not of its field's type.
    """
    fields = dataclasses.fields(cast("Any", kind))
    hints, above = _type_hints(kind), f"{name}." if name else ""
    given: dict[str, Any] = {}
    for key, entry in _checked(value, Mapping, name, "a table").items():
        if key in getattr(kind, "COMPUTED", ()):
            continue
        if key not in (names := [field.name for field in fields]):
            raise SettingsError(f"unknown key {above + key!r}; known are {', '.join(names)}")
        given[key] = _converted(hints[key], entry, above + key)
    for field in fields:
        if field.name not in given and field.default is field.default_factory is dataclasses.MISSING:
            raise SettingsError(f"{name or 'it'} lacks {field.name!r}")
    return kind(**given)


# Evaluating the annotations of a class takes longer than reading a table of it, and each trial is read many times.
_type_hints = functools.cache(typing.get_type_hints)


def _converted(hint: Any, value: Any, name: str) -> Any:
    """Return a JSON value as a field's type; the class itself converts other types and unions."""
    origin, kinds = typing.get_origin(hint) or hint, typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        others = [kind for kind in kinds if kind is not types.NoneType]
        is_none = value is None and len(others) < len(kinds)
        return value if is_none or len(others) > 1 else _converted(others[0], value, name)
    if hasattr(origin, "from_dict"):
        return origin.from_dict(value)
    if dataclasses.is_dataclass(origin):
        return from_json(cast("type[Any]", origin), value, name)
    if origin is Mapping or origin is dict:
        table = _checked(value, Mapping, name, "a table")
        return {str(key): _converted(kinds[1], entry, f"{name}.{key}") for key, entry in table.items()}
    if origin in (tuple, Sequence):
        return _items(origin, kinds, value, name)
    if origin in _PLAIN:
        return origin(_checked(value, *_PLAIN[origin][:1], name, _PLAIN[origin][1]))
    return value


def _items(origin: Any, kinds: Sequence[Any], value: Any, name: str) -> Any:
    """Return a list as a tuple or list, and check a tuple's length."""
    of_any_length = origin is not tuple or kinds[-1] is Ellipsis
    words = "a list" if of_any_length else f"{len(kinds)} numbers"
    items = _checked(value, (list, tuple), name, words)
    if not of_any_length and len(items) != len(kinds):
        raise SettingsError(f"{name} is {value!r}; it must be {words}")
    each = [kinds[0]] * len(items) if of_any_length else kinds
    made = [_converted(kind, item, f"{name}[{at}]") for at, (kind, item) in enumerate(zip(each, items, strict=True))]
    return tuple(made) if origin is tuple else made


def _checked(value: Any, kinds: Any, name: str, words: str) -> Any:
    if not isinstance(value, kinds) or (isinstance(value, bool) and kinds is not bool):
        raise SettingsError(f"{name or 'it'} is {value!r}; it must be {words}")
    return value
