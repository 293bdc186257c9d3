"""Flags for settings: a dataclass of settings says names, types, defaults, and in its docstring what each is."""

from __future__ import annotations

import dataclasses
import re
import types
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, cast

from tyro.conf import UseAppendAction, arg

from equipoise.errors import SettingsError

Settings = TypeVar("Settings")
Verb = Callable[..., Any]

_METAVARS = {"m": "METRES", "s": "TIME", "kg": "KG", "Hz": "HERTZ", "rad": "RADIANS"}  # by unit
_VECTORS = {"m": "X Y Z", "rad": "ROLL PITCH YAW"}  # by unit
_BY_NAME = {
    float: (str, "NAME=ANGLE"),
    str: (str, "NAME=FRAME"),
    tuple[float, float]: (tuple[str, float, float], "NAME LO HI"),
}
"""Type and words of a flag that may be repeated, one name each, by the type of the value."""


@dataclass(frozen=True)
class SettingFlag:
    """A setting as a flag.

    Attributes:
        name: name of the flag, with underscores.
        path: names of the fields that lead to it.
        kind: type of the value.
        default: value where the flag is not given.
        words: help of the flag.
        read: function that reads the value from a file, which is what the flag is given then; None: it is the value.
        metavar: word for that file in help.
    """

    name: str
    path: tuple[str, ...]
    kind: Any
    default: Any
    words: str
    read: Callable[[Path], Any] | None = None
    metavar: str = "FILE"

    @property
    def is_by_name(self) -> bool:
        """Whether each name is given with a flag of its own."""
        return typing.get_origin(self.kind) is dict

    @property
    def is_time(self) -> bool:
        """Whether it is given as 60s or 2min."""
        return _plain(self.kind) is float and _unit(self.words) == "s"

    def or_none(self) -> SettingFlag:
        """The same, None where the flag is not given."""
        return dataclasses.replace(self, kind=self.kind | None, default=None)

    def annotated(self) -> Any:
        """Its type for the parser, which shows no default that the words tell already."""
        words, plain = self.words[:1].upper() + self.words[1:], _plain(self.kind)
        if plain is bool:
            return Annotated[
                bool, arg(help=f"Leave out {self.words}" if self.default else words, help_behavior_hint="")
            ]
        if self.is_by_name:
            kind, metavar = _BY_NAME[typing.get_args(self.kind)[1]]
            words = f"{words} May be given again."
            return UseAppendAction[Annotated[tuple[kind, ...], arg(help=words, metavar=metavar, help_behavior_hint="")]]
        hint = "" if self.default is None or self.default in ((), {}) else None
        kind = (str | None) if self.is_time else self.kind
        metavar = self.metavar if self.read is not None else _metavar(plain, self.words)
        return Annotated[kind, arg(help=words, metavar=metavar, help_behavior_hint=hint)]


def settings_of(kind: type[Any], only: Sequence[str] | None = None) -> list[SettingFlag]:
    """All settings in a dataclass and in those that it holds; `only` those of these names."""
    return [setting for setting in _settings_in(kind, "", ()) if only is None or setting.name in only]


def _settings_in(kind: type[Any], prefix: str, path: tuple[str, ...]) -> Iterator[SettingFlag]:
    hints, words = typing.get_type_hints(kind), attribute_words(kind)
    for field in dataclasses.fields(kind):
        if not field.metadata.get("flag", True):
            continue
        below = field.metadata.get("prefix", f"{field.name}_")
        if (read := field.metadata.get("file")) is not None:
            told = words.get(field.name, "")
            shown = field.metadata.get("metavar", "FILE")
            yield SettingFlag(field.name, (*path, field.name), str | None, None, told, read, shown)
            continue
        if dataclasses.is_dataclass(hints[field.name]):
            if below is not None:
                yield from _settings_in(hints[field.name], prefix + below, (*path, field.name))
            continue
        default = field.default if field.default_factory is dataclasses.MISSING else field.default_factory()
        told = words.get(field.name, "")
        yield SettingFlag(prefix + field.name, (*path, field.name), hints[field.name], default, told)


def attribute_words(kind: type[Any]) -> dict[str, str]:
    """What a class's docstring says of its attributes."""
    found: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        found |= _own_attribute_words(base.__doc__ or "")
    return found


def _own_attribute_words(docstring: str) -> dict[str, str]:
    _, _, section = docstring.partition("Attributes:\n")
    found: dict[str, str] = {}
    names: list[str] = []
    for line in section.split("\n\n")[0].splitlines():
        begin = re.match(r"\s{8}(\w+(?:, \w+)*): (.*)", line)
        if begin is not None:
            names = begin[1].split(", ")
            found |= dict.fromkeys(names, begin[2])
        else:
            found |= {name: f"{found[name]} {line.strip()}".strip() for name in names}
    return found


def flags_class(
    title: str, words: str, settings: Sequence[SettingFlag], others: Sequence[tuple[str, Any, Any]] = ()
) -> type[Any]:
    """A class whose fields are flags.

    Args:
        title: name of the class.
        words: text that stands above its flags.
        settings: settings, with one flag each; of those with one name the first.
        others: name, type and default of further flags, which come first.
    """
    rows: dict[str, Any] = {name: (name, kind, dataclasses.field(default=default)) for name, kind, default in others}
    for setting in settings:
        value = f"{setting.default:g}s" if setting.is_time and setting.default is not None else setting.default
        value = () if setting.is_by_name else value
        default: Any = dataclasses.field(default_factory=lambda value=value: copy(value))
        rows.setdefault(setting.name, (setting.name, setting.annotated(), default))
    made = dataclasses.make_dataclass(title, rows.values(), frozen=True, namespace={"SETTINGS": tuple(settings)})
    made.__doc__ = words
    return made


def read_flags(kind: type[Settings], flags: Any) -> Settings:
    """A dataclass of settings from flags; raises SettingsError."""
    given = [(setting, _value_of(setting, flags)) for setting in settings_of(kind)]
    values = {setting.path: value for setting, value in given if value is not None or setting.read is None}
    return cast("Settings", _made(kind, values))


def given_flags(flags: Any) -> dict[str, Any]:
    """Those of a class's flags that were given, by name of the setting; raises SettingsError."""
    values = {setting.path[-1]: _value_of(setting, flags) for setting in flags.SETTINGS}
    return {name: value for name, value in values.items() if value is not None}


def _value_of(setting: SettingFlag, flags: Any) -> Any:
    """A setting's value; raises SettingsError for a time that is none, or a file that cannot be read."""
    value = getattr(flags, setting.name)
    if setting.read is not None:
        return None if value is None else setting.read(Path(value))
    if setting.is_by_name:
        return values_by_name(value, setting)
    return seconds(value, setting.name) if setting.is_time else value


def values_by_name(given: Iterable[str | tuple[str, float, float]], setting: SettingFlag) -> dict[str, Any]:
    """Return values by name from NAME=VALUE, or from a name and its values; raises SettingsError for anything else."""
    kind, found = typing.get_args(setting.kind)[1], dict[str, Any]()
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
            flag, form = setting.name.replace("_", "-"), _BY_NAME[kind][1]
            raise SettingsError(f"--{flag} {words} is not {form}{', in radians' if kind is float else ''}") from None
    return found


def _made(kind: type[Any], values: Mapping[tuple[str, ...], Any]) -> Any:
    hints = typing.get_type_hints(kind)
    given = {path[0]: value for path, value in values.items() if len(path) == 1}
    for name in dict.fromkeys(path[0] for path in values if len(path) > 1):
        given[name] = _made(hints[name], {path[1:]: value for path, value in values.items() if path[0] == name})
    return kind(**given)


def seconds(text: str | None, flag: str) -> float | None:
    """Return a flag's time [s] from 60, 60s, 1.5min, 2m or 1h; raises SettingsError for anything else."""
    if text is None:
        return None
    match = re.fullmatch(r"\s*([0-9]*\.?[0-9]+(?:e[+-]?[0-9]+)?)\s*(s|sec|m|min|h)?\s*", text)
    if match is None:
        raise SettingsError(f"--{flag.replace('_', '-')} {text!r} is not a time; give it as 60s, 2min or 1h")
    return float(match[1]) * {"s": 1.0, "m": 60.0, "h": 3600.0}[(match[2] or "s")[0]]


def one_of(names: Iterable[str]) -> Any:
    """The type of a flag that is one of some names."""
    return cast("Any", Literal).__getitem__(tuple(names))


def chosen(arguments: Sequence[str], flag: str, default: str) -> str:
    """What a flag says that decides which other flags there are."""
    said = default
    for index, argument in enumerate(arguments):
        if argument == flag and index + 1 < len(arguments):
            said = arguments[index + 1]
        elif argument.startswith(f"{flag}="):
            said = argument.partition("=")[2]
    return said


def shaped(verb: Verb, **kinds: Any) -> Verb:
    """A copy of a verb whose parameters have other types, and instances of those as defaults."""
    code = cast("types.FunctionType", verb)
    other = types.FunctionType(code.__code__, code.__globals__, code.__name__, code.__defaults__, code.__closure__)
    other.__doc__, other.__module__ = code.__doc__, code.__module__
    other.__annotations__ = {**code.__annotations__, **kinds}
    defaults = {name: (typing.get_args(kind) or (kind,))[0]() for name, kind in kinds.items()}
    other.__kwdefaults__ = {**(code.__kwdefaults__ or {}), **defaults}
    return other


def unknown_flags(verb: Verb, arguments: Sequence[str]) -> list[str]:
    """Flags among the arguments that a verb has not, without dashes, with underscores."""
    known = {"help", "h", *flag_types(verb)}
    given = [argument.partition("=")[0][2:] for argument in arguments if re.match(r"--[a-z]", argument)]
    return [flag for flag in (name.replace("-", "_") for name in given) if flag not in known]


def flag_types(verb: Verb) -> dict[str, Any]:
    """Return the type of every flag of a verb, by its name with underscores."""
    found: dict[str, Any] = {}
    for name, hint in typing.get_type_hints(verb, include_extras=True).items():
        kind = (typing.get_args(hint) or (hint,))[0] if typing.get_origin(hint) is Annotated else hint
        if not dataclasses.is_dataclass(kind):
            found |= dict.fromkeys(_names(name, hint), hint)
            continue
        fields = typing.get_type_hints(kind, include_extras=True)
        for field in dataclasses.fields(kind):
            found |= dict.fromkeys(_names(field.name, fields[field.name]), fields[field.name])
    return found


def _names(name: str, hint: Any) -> set[str]:
    renamed = [told.name for told in getattr(hint, "__metadata__", ()) if getattr(told, "name", None)]
    return {name, f"no_{name}", *renamed}


def _plain(kind: Any) -> Any:
    """A type without None, if one is left."""
    union = typing.get_origin(kind) in (typing.Union, types.UnionType)
    kinds = [part for part in (typing.get_args(kind) if union else (kind,)) if part is not type(None)]
    return kinds[0] if len(kinds) == 1 else kind


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
        return _VECTORS[_unit(words) or ""]
    return {int: "N", str: "NAME"}.get(plain)
