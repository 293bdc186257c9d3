"""How the parser reads numbers: what is none is called so, and not by the types that it was tried as."""

from __future__ import annotations

import typing
from typing import Any, cast

from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo


def number_rules() -> ConstructorRegistry:
    """Rules for flags that are a number, or None where they are not given."""
    registry = ConstructorRegistry()
    cast("Any", registry).primitive_rule(_number)
    return registry


def _number(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[Any] | None:
    asked = cast("Any", info).type
    kinds = {*(typing.get_args(asked) or (asked,))} - {type(None)}
    if kinds not in ({int}, {float}):
        return None
    kind = cast("type[Any]", kinds.pop())

    def read(words: list[str]) -> Any:
        try:
            return kind(words[0])
        except ValueError:
            raise ValueError(f"{words[0]!r} is no {'whole ' if kind is int else ''}number") from None

    return PrimitiveConstructorSpec(
        1,
        kind.__name__.upper(),
        read,
        lambda value: value is None or isinstance(value, kind),
        lambda value: [str(value)],
    )
