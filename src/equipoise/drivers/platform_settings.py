"""Settings of platforms from the text of `--set KEY=VALUE` and TOML files."""

from __future__ import annotations

import inspect
import math
import typing
from collections.abc import Mapping
from typing import Any

from equipoise.errors import SettingsError


def settings_of_class(kind: type[Any]) -> dict[str, inspect.Parameter]:
    """Return the parameters of a class's constructor by name."""
    try:
        return dict(inspect.signature(kind, eval_str=True).parameters)
    except Exception:  # names that exist for type checkers only
        parameters = inspect.signature(kind).parameters
        return {name: each.replace(annotation=inspect.Parameter.empty) for name, each in parameters.items()}


def settings_of_platform(kind: type[Any]) -> dict[str, inspect.Parameter]:
    """Return the parameters of a platform's constructor without the first one, the robot."""
    variadic = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    settings = list(settings_of_class(kind).items())[1:]
    return {name: setting for name, setting in settings if setting.kind not in variadic}


def setting_row(setting: inspect.Parameter) -> tuple[str, str, Any]:
    """Return the name of a setting, its type in words and its default."""
    return setting.name, _named(_type_of(setting)), None if _is_needed(setting) else setting.default


def _is_needed(setting: inspect.Parameter) -> bool:
    return setting.default is inspect.Parameter.empty


def _type_of(setting: inspect.Parameter) -> Any:
    """Return the type of a setting: its annotation, or else the type of its default."""
    if setting.annotation is not inspect.Parameter.empty:
        return setting.annotation
    return str if setting.default is None or _is_needed(setting) else setting.default.__class__


def check_range(settings: Any, name: str, least: float, most: float) -> None:
    """Raise SettingsError if a setting is outside a range; None is inside."""
    value = getattr(settings, name)
    if value is not None and not least <= value <= most:
        allowed = f"{least:g} or more" if math.isinf(most) else f"from {least:g} to {most:g}"
        raise SettingsError(f"{name} is {value}; it must be {allowed}")


def read_settings(kind: type[Any], given: Mapping[str, Any], name: str) -> Any:
    """Create a settings object from values by name; text is converted to the setting's type."""
    return kind(**read_values(settings_of_class(kind), given, name))


def read_values(settings: Mapping[str, inspect.Parameter], given: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return values by name; text is converted to the setting's type.

    Raises:
        SettingsError: a setting does not exist, has an invalid value, or is missing.
    """
    invalid = [key for key in given if key not in settings]
    if invalid:
        valid = f"it has {', '.join(settings)}" if settings else "it has none"
        raise SettingsError(f"platform {name!r} has no setting {invalid[0]!r}; {valid} (see 'equipoise platforms')")
    missing = [key for key, setting in settings.items() if _is_needed(setting) and key not in given]
    if missing:
        raise SettingsError(f"platform {name!r} needs the setting {missing[0]!r}: --set {missing[0]}=VALUE")
    return {key: _read(value, _type_of(settings[key]), key) for key, value in given.items()}


def _read(value: Any, hint: Any, key: str) -> Any:
    """Convert a value to its setting's type."""
    kinds = [kind for kind in (typing.get_args(hint) or (hint,)) if kind is not type(None)]
    origin = typing.get_origin(hint)
    if origin is typing.Literal:
        return value  # the settings class checks it
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
    """Return the name of a type for users."""
    if typing.get_origin(hint) is typing.Literal:
        return " or ".join(str(value) for value in typing.get_args(hint))
    words = {str: "text", int: "a whole number", float: "a number", bool: "yes or no", type(None): "none"}
    kinds = typing.get_args(hint) if typing.get_origin(hint) is not tuple else ()
    return " or ".join(words.get(kind, "names, with commas") for kind in (kinds or (hint,)))
