"""Settings of platforms from text, as `--set KEY=VALUE` and TOML files have them."""

from __future__ import annotations

import dataclasses
import inspect
import typing
from collections.abc import Mapping
from typing import Any

from equipoise.errors import SettingsError


@dataclasses.dataclass(frozen=True)
class PlatformSetting:
    """Something that can be set.

    Attributes:
        kind: type of the setting.
        default: value if nobody sets it; `inspect.Parameter.empty` if somebody has to.
    """

    kind: Any
    default: Any

    @property
    def needed(self) -> bool:
        """Whether somebody has to set it."""
        return self.default is inspect.Parameter.empty

    def row(self, name: str) -> tuple[str, str, Any]:
        """For a list: the name, the type in words, the default."""
        return name, _named(self.kind), None if self.needed else self.default


def settings_of_class(kind: type[Any]) -> dict[str, PlatformSetting]:
    """By name, the fields of a driver's settings class, which is a dataclass."""
    hints = typing.get_type_hints(kind)
    return {field.name: PlatformSetting(hints[field.name], field.default) for field in dataclasses.fields(kind)}


def settings_of_constructor(kind: type[Any]) -> dict[str, PlatformSetting]:
    """By name, what a platform's constructor takes besides the robot, which comes first."""
    try:
        hints = typing.get_type_hints(kind.__init__)
    except Exception:  # names that are there for type checkers alone
        hints = {}
    variadic = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    settings: dict[str, PlatformSetting] = {}
    for parameter in list(inspect.signature(kind).parameters.values())[1:]:
        if parameter.kind not in variadic:
            default = parameter.default
            known = default is not None and default is not inspect.Parameter.empty
            settings[parameter.name] = PlatformSetting(
                hints.get(parameter.name, type(default) if known else str), default
            )
    return settings


def check_range(settings: Any, name: str, least: float, most: float) -> None:
    """Raise SettingsError if a setting is outside a range; None is inside."""
    value = getattr(settings, name)
    if value is not None and not least <= value <= most:
        raise SettingsError(f"{name} is {value}; it must be from {least:g} to {most:g}")


def read_settings(kind: type[Any], given: Mapping[str, Any], name: str) -> Any:
    """A settings object from values by name; text is read as what the setting is."""
    return kind(**read_values(settings_of_class(kind), given, name))


def read_values(settings: Mapping[str, PlatformSetting], given: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Values by name; text is read as what the setting is.

    Raises:
        SettingsError: there is no such setting, it cannot be what is given, or one is missing.
    """
    unknown = [key for key in given if key not in settings]
    if unknown:
        known = f"it has {', '.join(settings)}" if settings else "it has none"
        raise SettingsError(f"platform {name!r} has no setting {unknown[0]!r}; {known} (see 'equipoise platforms')")
    missing = [key for key, setting in settings.items() if setting.needed and key not in given]
    if missing:
        raise SettingsError(f"platform {name!r} needs the setting {missing[0]!r}: --set {missing[0]}=VALUE")
    return {key: _read(value, settings[key].kind, key) for key, value in given.items()}


def _read(value: Any, hint: Any, key: str) -> Any:
    """A value as its setting's type."""
    kinds = [kind for kind in (typing.get_args(hint) or (hint,)) if kind is not type(None)]
    origin = typing.get_origin(hint)
    if origin is typing.Literal:
        return value  # the settings refuse what they do not know
    if hint is tuple or origin is tuple or any(typing.get_origin(kind) is tuple for kind in kinds):
        return tuple(part.strip() for part in value.split(",")) if isinstance(value, str) else tuple(value)
    if not isinstance(value, str):
        return float(value) if float in kinds and isinstance(value, int) and not isinstance(value, bool) else value
    if value.lower() in ("none", "") and len(typing.get_args(hint)) > len(kinds):
        return None
    for kind, read in ((bool, _truth), (int, int), (float, float)):
        if kind in kinds:
            try:
                return read(value)
            except ValueError:
                raise SettingsError(f"setting {key} is {value!r}; it must be {_named(hint)}") from None
    return value


def _truth(text: str) -> bool:
    words = {"true": True, "yes": True, "on": True, "1": True, "false": False, "no": False, "off": False, "0": False}
    if text.lower() not in words:
        raise ValueError(text)
    return words[text.lower()]


def _named(hint: Any) -> str:
    """A type, as a user says it."""
    if typing.get_origin(hint) is typing.Literal:
        return " or ".join(str(value) for value in typing.get_args(hint))
    words = {str: "text", int: "a whole number", float: "a number", bool: "yes or no", type(None): "none"}
    kinds = typing.get_args(hint) if typing.get_origin(hint) is not tuple else ()
    return " or ".join(words.get(kind, "names, with commas") for kind in (kinds or (hint,)))
