"""Parser of command lines on tyro, with clear errors for surplus numbers and for flags of other methods."""

from __future__ import annotations

import functools
import io
import shutil
import sys
import textwrap
import typing
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, redirect_stdout, suppress
from pathlib import Path
from typing import Any, cast

import tyro
from tyro.constructors import (
    ConstructorRegistry,
    PrimitiveConstructorSpec,
    PrimitiveTypeInfo,
    StructConstructorSpec,
    StructTypeInfo,
)

from equipoise.cli.setting_flags import description_flags, without_none
from equipoise.errors import SettingsError
from equipoise.robot.description import RobotDescription

Verb = Callable[..., Any]
ChosenFlags = tuple[Callable[[Sequence[str]], StructConstructorSpec], Callable[[str, Sequence[str]], None] | None]
"""Function that returns the flags of a parameter from the arguments, and one that raises for flags of another choice."""


def parse(
    verb: Verb, words: Sequence[str], program: str, chosen: Mapping[Any, ChosenFlags]
) -> Callable[[], int | None]:
    """Return a verb, bound to its arguments.

    Args:
        verb: function whose parameters are flags.
        words: words after the verb.
        program: name of the verb in help, for example "equipoise plan".
        chosen: flags that depend on other arguments, by the type of their parameter.

    Raises:
        SettingsError: a flag belongs to another method or another kind of platform, or has a surplus number.
        SystemExit: tyro has printed help or an error.
    """
    hints = typing.get_type_hints(verb)
    used = {kind: flags for kind, flags in _ALWAYS.items() | chosen.items() if kind in hints.values()}
    specs = {kind: flags(words) for kind, (flags, _) in used.items()}

    @functools.wraps(verb)
    def given(**values: Any) -> dict[str, Any]:
        return values

    run_tyro = functools.partial(
        tyro.cli, given, args=words, prog=program, registry=_rules(specs),
        config=(tyro.conf.OmitArgPrefixes, tyro.conf.FlagCreatePairsOff),
    )  # fmt: skip
    with _help_in_width() if {"-h", "--help"} & {*words} else nullcontext():
        values, unknown = run_tyro(return_unknown_args=True)
    _refuse_surplus_numbers([*unknown, *_words_in(values)], words)
    for flag in (word.partition("=")[0] for word in unknown if word.startswith("--")):
        for _, refuse in used.values():
            if refuse is not None:
                refuse(flag[2:].replace("-", "_"), words)
    if unknown:
        run_tyro()  # prints the error of tyro
    return functools.partial(call, verb, values)


def call(verb: Verb, values: Mapping[str, Any]) -> int | None:
    """Call a verb with the values of its parameters; groups of flags are constructed first, in reverse order.

    Raises:
        SettingsError: a value cannot be used.
    """
    made: dict[str, Any] = {}
    for name, value in reversed([*values.items()]):  # the method, which imports most, comes last
        made[name] = cast("Any", value)() if isinstance(value, functools.partial) else value
    return verb(**made)


_ALWAYS: Mapping[Any, ChosenFlags] = {RobotDescription: (description_flags, None)}


def _rules(specs: Mapping[Any, StructConstructorSpec]) -> ConstructorRegistry:
    registry = cast("Any", ConstructorRegistry())
    registry.primitive_rule(_number)

    def chosen(info: StructTypeInfo) -> StructConstructorSpec | None:
        return specs.get(cast("Any", info).type)

    registry.struct_rule(chosen)
    return registry


def _number(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[Any] | None:
    """Return the parser of a number or of a fixed count of words and numbers; None for other types."""
    kind = without_none(cast("Any", info).type)
    one = typing.get_origin(kind) is not tuple
    kinds = (kind,) if one else typing.get_args(kind)
    if not {*kinds} <= {int, float, str} or {*kinds} == {str}:
        return None

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


def _words_in(values: Mapping[str, Any]) -> list[str]:
    """Return the words and paths among the values of a verb, including its robot or run."""
    found: list[str] = []
    for value in values.values():
        words = cast("tuple[Any, ...]", value) if isinstance(value, tuple) else (value,)
        found += [str(word) for word in words if isinstance(word, (str, Path))]
    return found


def _refuse_surplus_numbers(taken: Sequence[str], words: Sequence[str]) -> None:
    """Raise SettingsError for a surplus number after a flag, which the parser reads as the robot or the run."""
    for word in taken:
        place = len(words) - 1 - words[::-1].index(word) if word in words else 0
        flags = [index for index, before in enumerate(words[:place]) if before.startswith("--")]
        if flags and flags[-1] < place - 1 and _is_number(word) and not Path(word).exists():
            count = place - flags[-1] - 1
            takes = "one number" if count == 1 else f"{count} values"
            raise SettingsError(f"{words[flags[-1]]} takes {takes}, not {' '.join(words[flags[-1] + 1 : place + 1])!r}")


def _is_number(word: str) -> bool:
    with suppress(ValueError):
        float(word)
        return True
    return False


class _Captured(io.StringIO):
    """Captured text; coloured if stdout is a terminal."""

    def isatty(self) -> bool:
        return sys.__stdout__ is not None and sys.__stdout__.isatty()


@contextmanager
def _help_in_width() -> Generator[None]:
    """Wrap the paragraphs of help, which tyro does not wrap."""
    written, width = _Captured(), shutil.get_terminal_size().columns
    try:
        with redirect_stdout(written):
            yield
    finally:
        for line in written.getvalue().splitlines():
            long = len(line) > width and not line.startswith((" ", "\x1b", "╭", "│", "╰", "usage"))
            print(textwrap.fill(line, width) if long else line)
