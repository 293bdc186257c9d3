"""Flags from dataclasses of settings: times, units, files and values by name."""

from __future__ import annotations

import dataclasses
import functools
import re
import types
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, cast

import tyro
from tyro.conf import UseAppendAction, arg
from tyro.constructors import ConstructorRegistry, StructConstructorSpec, StructFieldSpec, StructTypeInfo

from equipoise.errors import SettingsError
from equipoise.robot.description import RobotDescription

Settings = TypeVar("Settings")
_METAVARS = {"m": "METRES", "s": "TIME", "kg": "KG", "Hz": "HERTZ", "rad": "RADIANS"}  # by unit
_VECTORS = {"m": "X Y Z", "rad": "ROLL PITCH YAW"}  # by unit
_BY_NAME = {
    float: (str, "NAME=ANGLE"),
    str: (str, "NAME=FRAME"),
    tuple[float, float]: (tuple[str, float, float], "NAME LO HI"),
}
"""Type and metavar of a repeatable flag with a name, by the type of its value."""


def fields_of(kind: type[Any]) -> tuple[StructFieldSpec, ...]:
    """Return the fields of a dataclass as tyro reads them: type, default and help."""
    info = cast("Any", StructTypeInfo).make(kind, tyro.MISSING_NONPROP, False)
    return cast("StructConstructorSpec", ConstructorRegistry.get_struct_spec(info)).fields


def flags_of(kind: type[Any], prefix: str = "") -> Iterator[StructFieldSpec]:
    """Yield a flag for each setting of a dataclass and its nested dataclasses; see `Method` for the metadata."""
    for setting, metadata, nested in _settings_in(kind, prefix):
        if nested is None:
            yield _flag(prefix + setting.name, setting, metadata)
        else:
            yield from flags_of(cast("Any", setting).type, nested)


def settings_from(kind: type[Settings], flags: Mapping[str, Any]) -> Settings:
    """Return a dataclass of settings from the values of its flags; raises SettingsError."""
    return kind(**values_of(kind, flags))


def values_of(kind: type[Any], flags: Mapping[str, Any], prefix: str = "") -> Mapping[str, Any]:
    """Return the settings whose flags are given, by field name; raises SettingsError."""
    found: dict[str, Any] = {}
    for setting, metadata, nested in _settings_in(kind, prefix):
        inner = cast("Any", setting).type
        if nested is not None:
            if within := values_of(inner, flags, nested):
                found[setting.name] = inner(**within)
        elif (value := flags.get(prefix + setting.name)) is not None:
            found[setting.name] = _read(value, prefix + setting.name, setting, metadata)
    return found


def optional(flag: StructFieldSpec) -> StructFieldSpec:
    """Return a flag that defaults to None; a switch is unchanged."""
    kind, *config = typing.get_args(cast("Any", flag).type)
    if kind is bool:
        return flag
    unset = Annotated[(kind | None, *config, arg(help_behavior_hint=""))]  # pyright: ignore
    return dataclasses.replace(flag, type=cast("Any", unset), default=None)


def spec_of(
    words: str, flags: Iterable[StructFieldSpec], make: Callable[[Mapping[str, Any]], Any]
) -> StructConstructorSpec:
    """Return the specification of a group of flags for tyro.

    Args:
        words: text above the flags in help.
        flags: flags; of several with the same name the first is used.
        make: function that returns the value of the group from the values of its flags, called after parsing.
    """

    def given(**values: Any) -> Any:
        return functools.partial(make, values)

    given.__doc__ = words
    by_name: dict[str, StructFieldSpec] = {}
    for flag in flags:
        by_name.setdefault(flag.name, flag)
    return StructConstructorSpec(given, tuple(by_name.values()))


def description_flags(arguments: Sequence[str]) -> StructConstructorSpec:
    """Return the flags of a robot configuration and of its file; flags override the file."""
    del arguments
    words = "TOML file with a robot configuration; flags override it."
    file = Annotated[Path | None, arg(metavar="PATH", help=words, help_behavior_hint="")]
    flags = [StructFieldSpec("robot_config", cast("Any", file), None), *flags_of(RobotDescription)]

    def described(values: Mapping[str, Any]) -> RobotDescription:
        description = settings_from(RobotDescription, values)
        path = values["robot_config"]
        return description if path is None else RobotDescription.from_toml(path).overridden_by(description)

    return spec_of("Values that the model file lacks or has wrong.", flags, described)


def without_none(kind: Any) -> Any:
    """Return a type without None, if exactly one other type remains."""
    union = typing.get_origin(kind) in (typing.Union, types.UnionType)
    kinds = [part for part in (typing.get_args(kind) if union else (kind,)) if part is not type(None)]
    return kinds[0] if len(kinds) == 1 else kind


def _settings_in(kind: type[Any], prefix: str) -> Iterator[tuple[StructFieldSpec, Mapping[str, Any], str | None]]:
    """Yield each setting that has flags, its metadata and, for nested settings, the prefix of their flags."""
    metadata = {field.name: field.metadata for field in dataclasses.fields(kind)}
    for setting in fields_of(kind):
        about = metadata[setting.name]
        nested = dataclasses.is_dataclass(cast("Any", setting).type) and "file" not in about
        below = about.get("prefix", f"{setting.name}_")
        if about.get("flag", True) and not (nested and below is None):
            yield setting, about, prefix + below if nested else None


def _words(setting: StructFieldSpec) -> str:
    words = setting.helptext() if callable(setting.helptext) else setting.helptext
    return words or ""


def _is_time(setting: StructFieldSpec) -> bool:
    """Return true if the setting is a time, given as 60s or 2min."""
    return without_none(cast("Any", setting).type) is float and _unit(_words(setting)) == "s"


def _flag(name: str, setting: StructFieldSpec, metadata: Mapping[str, Any]) -> StructFieldSpec:
    """Return the flag of a setting; defaults that the help text states are not repeated."""
    kind, default, words = cast("Any", setting).type, setting.default, _words(setting)
    plain, metavar = without_none(kind), _metavar(without_none(kind), words)
    if plain is bool:
        words = f"leave out {words}" if default else words
    elif "file" in metadata:
        kind, default, metavar = str | None, None, metadata.get("metavar", "FILE")
    elif typing.get_origin(plain) is dict:
        kind, metavar = _BY_NAME[typing.get_args(plain)[1]]
        kind, default, words = UseAppendAction[tuple[kind, ...]], (), f"{words} May be repeated."
    elif _is_time(setting):
        kind, default = str | None, None if default is None else f"{default:g}s"
    hint = "" if default is None or default == () or plain is bool else None
    config = arg(help=words[:1].upper() + words[1:], metavar=metavar, help_behavior_hint=hint)
    return StructFieldSpec(name, cast("Any", Annotated[kind, config]), default)


def _read(value: Any, name: str, setting: StructFieldSpec, metadata: Mapping[str, Any]) -> Any:
    """Return a setting's value; raises SettingsError for a wrong time or a file that cannot be read."""
    kind = cast("Any", setting).type
    if "file" in metadata:
        return metadata["file"](Path(value))
    if typing.get_origin(kind) is dict:
        return _values_by_name(value, typing.get_args(kind)[1], name)
    return seconds(value, name) if _is_time(setting) else value


def _values_by_name(given: Iterable[str | tuple[str, float, float]], kind: Any, flag: str) -> dict[str, Any]:
    """Return values by name from NAME=VALUE, or from a name and its values; raises SettingsError for other text."""
    found: dict[str, Any] = {}
    for words in given:
        if isinstance(words, tuple):
            found[words[0]] = words[1:]
            continue
        name, _, value = words.rpartition("=")
        try:
            found[name] = kind(value)
        except ValueError:
            name = ""
        if not name:
            form = f"{_BY_NAME[kind][1]}{', in radians' if kind is float else ''}"
            raise SettingsError(f"--{flag.replace('_', '-')} {words} is not {form}") from None
    return found


def seconds(text: str | None, flag: str) -> float | None:
    """Return a time [s] from 60, 60s, 1.5min, 2m or 1h; raises SettingsError for other text."""
    if text is None:
        return None
    match = re.fullmatch(r"\s*([0-9]*\.?[0-9]+(?:e[+-]?[0-9]+)?)\s*(s|sec|m|min|h)?\s*", text)
    if match is None:
        raise SettingsError(f"--{flag.replace('_', '-')} {text!r} is not a time; give it as 60s, 2min or 1h")
    return float(match[1]) * {"s": 1.0, "m": 60.0, "h": 3600.0}[(match[2] or "s")[0]]


def _unit(words: str) -> str | None:
    found = re.search(r"\[([^\]]+)\]", words)
    return None if found is None else found[1]


def _metavar(plain: Any, words: str) -> str | None:
    if plain is float:
        return _METAVARS.get(_unit(words) or "", "NUMBER")
    if typing.get_origin(plain) is Literal:
        return f"{{{','.join(map(str, typing.get_args(plain)))}}}"
    parts = typing.get_args(plain)
    if parts == (float, float, float):
        return _VECTORS.get(_unit(words) or "", "A B C")
    return {int: "N", str: "NAME"}.get(plain)
