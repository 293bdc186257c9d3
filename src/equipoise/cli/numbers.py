"""How the parser reads numbers, and the errors that name the flag and the value."""

from __future__ import annotations

import types
import typing
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, cast

from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo

from equipoise.errors import SettingsError


def number_rules() -> ConstructorRegistry:
    """Return parser rules for a number, and for a fixed count of words and numbers; None where the flag is not given."""
    registry = ConstructorRegistry()
    cast("Any", registry).primitive_rule(_number)
    return registry


def refuse_surplus_numbers(hints: Mapping[str, Any], arguments: Sequence[str]) -> None:
    """Refuse a number too many, which the parser takes for the robot or the run.

    Args:
        hints: type of each flag, by its name with underscores.
        arguments: words of the command line.

    Raises:
        SettingsError: more numbers than a flag takes follow it.
    """
    for place, word in enumerate(arguments):
        kinds = _kinds_of(hints.get(word[2:].replace("-", "_"))) if word.startswith("--") else ()
        if not kinds or kinds[-1] is str:
            continue
        given = list(arguments[place + 1 :])
        surplus = given[len(kinds) : len(kinds) + 1]
        if surplus and _is_number(surplus[0]) and not Path(surplus[0]).exists():
            takes = "one number" if len(kinds) == 1 else f"{len(kinds)} values"
            raise SettingsError(f"{word} takes {takes}, not {' '.join(given[: len(kinds) + 1])!r}")


def _is_number(word: str) -> bool:
    with suppress(ValueError):
        float(word)
        return True
    return False


def _kinds_of(asked: Any) -> tuple[type[Any], ...]:
    """Return the types of the words that a flag takes, or nothing if it does not take a fixed count of words and numbers."""
    if typing.get_origin(asked) is Annotated:
        return _kinds_of(typing.get_args(asked)[0])
    if typing.get_origin(asked) in (typing.Union, types.UnionType):
        kinds = [kind for kind in typing.get_args(asked) if kind is not type(None)]
        return _kinds_of(kinds[0]) if len(kinds) == 1 else ()
    parts = typing.get_args(asked)
    if typing.get_origin(asked) is tuple and len(parts) == 2 and parts[1] is Ellipsis:
        return _kinds_of(parts[0]) if typing.get_origin(parts[0]) is tuple else ()
    words = parts if typing.get_origin(asked) is tuple else (asked,)
    return words if {*words} <= {int, float, str} and {*words} & {int, float} else ()


def _number(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[Any] | None:
    asked = cast("Any", info).type
    kinds = _kinds_of(asked)
    if not kinds or Ellipsis in typing.get_args(asked):
        return None
    one = len(kinds) == 1

    def read(words: list[str]) -> Any:
        values = tuple(_read(word, kind) for word, kind in zip(words, kinds, strict=True))
        return values[0] if one else values

    return PrimitiveConstructorSpec(
        len(kinds),
        " ".join(kind.__name__.upper() for kind in kinds),
        read,
        lambda value: value is None or isinstance(value, kinds[0] if one else tuple),
        lambda value: [*map(str, cast("tuple[Any, ...]", value))] if isinstance(value, tuple) else [str(value)],
    )


def _read(word: str, kind: type[Any]) -> Any:
    try:
        return kind(word)
    except ValueError:
        raise ValueError(f"{word!r} is not a {'whole ' if kind is int else ''}number") from None
