"""Method of a verb, and the flags of its settings."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, cast

from tyro.conf import arg
from tyro.constructors import StructConstructorSpec, StructFieldSpec
from tyro.extras import literal_type_from_choices

from equipoise.cli.arguments import chosen
from equipoise.cli.parsing import ChosenFlags
from equipoise.cli.setting_flags import flags_of, spec_of, values_of
from equipoise.errors import EquipoiseError, SettingsError
from equipoise.method.method import Method
from equipoise.method.table import METHODS, method_named, settings_of

DEFAULT_METHOD = "bayesian"
DEFAULT_SHOWN = f"(default: {DEFAULT_METHOD})"
"""In help, where the method that the other flags belong to is the parser's default."""
MOTORS = "motors"
_BASE, _LEGS = "base", "legs"
_ALL = {_BASE, _LEGS, MOTORS}
_PARAMETERS = (
    "Parameters to estimate: 'base' (mass, centre of mass, inertia), 'legs' (masses, first moments and lengths of their "
    "links; includes the base), 'motors' (friction, armature, gain and delay of each joint), several with commas, or 'all'."
)


def requested_parameters(names: str) -> set[str]:
    """Return the set of "base", "legs" and "motors" that `--parameters` names; "legs" adds "base". Raises SettingsError."""
    words = {word.strip() for word in names.split(",")}
    requested = _ALL if words == {"all"} else words
    if not requested or requested - _ALL:
        raise SettingsError(f"--parameters is {names!r}; it must be base, legs, motors, several with commas, or all")
    return requested | {_BASE} if _LEGS in requested else requested


def requested_method(arguments: Sequence[str]) -> str:
    """Return the name of the method, "motors" if only motors are requested; raises SettingsError."""
    if requested_parameters(chosen(arguments, "--parameters", _BASE)) == {MOTORS}:
        if chosen(arguments, "--method", MOTORS) != MOTORS:
            raise SettingsError("--parameters motors needs no --method; for both use --parameters base,motors")
        return MOTORS
    method = chosen(arguments, "--method", DEFAULT_METHOD)
    if method == MOTORS and chosen(arguments, "--parameters", MOTORS) != MOTORS:
        raise SettingsError("--method motors estimates motors only; for both use only --parameters base,motors")
    return method


def method_flags(arguments: Sequence[str]) -> StructConstructorSpec:
    """Return `--method`, `--parameters` and the flags of the requested method; raises SettingsError."""
    name = requested_method(arguments)
    with_motors = name != MOTORS and MOTORS in requested_parameters(chosen(arguments, "--parameters", _BASE))
    summaries = _summaries() if {"-h", "--help"} & set(arguments) else ""
    choice = Annotated[literal_type_from_choices([*METHODS]), arg(help=summaries, help_behavior_hint=DEFAULT_SHOWN)]
    parameters = Annotated[str, arg(help=_PARAMETERS, metavar="NAMES")]
    flags = [
        StructFieldSpec("method", cast("Any", choice), name),
        StructFieldSpec("parameters", cast("Any", parameters), MOTORS if name == MOTORS else _BASE),
        *flags_of(settings_of(name)),
        *(flags_of(settings_of(MOTORS)) if with_motors else ()),
    ]
    return spec_of(f"Method, parameters, and the settings of {name}.", flags, _method)


def _method(flags: Mapping[str, Any]) -> Method:
    """Return the method that flags describe; raises SettingsError."""
    method, requested = method_from(flags["method"], flags), requested_parameters(flags["parameters"])
    if _LEGS in requested:
        method = _with_legs(method)
    if method.name == MOTORS or MOTORS not in requested:
        return method
    from equipoise.method.combined import CombinedMethod

    return CombinedMethod(method, method_from(MOTORS, flags))


def method_from(name: str, flags: Mapping[str, Any]) -> Method:
    """Return a method from the values of its flags; raises SettingsError for a wrong value before importing the method."""
    settings = settings_of(name)
    values = values_of(settings, flags)
    settings(**values)
    return method_named(name)(**values)


def _with_legs(method: Method) -> Method:
    """Return the method with the legs' parameters; raises SettingsError if it cannot estimate them."""
    from equipoise.bayesian.method import BayesianMethod

    if not isinstance(method, BayesianMethod):
        raise SettingsError(
            f"--parameters legs needs --method bayesian; {method.name} does not estimate legs: leave them out"
        )
    return dataclasses.replace(method, swings=True)


def refuse_other_method(flag: str, arguments: Sequence[str]) -> None:
    """Raise SettingsError for a flag of another method than the one that the arguments name."""
    refuse_flag_of(owners(flag), flag, f"--method {requested_method(arguments)}")


METHOD_FLAGS: ChosenFlags = (method_flags, refuse_other_method)
"""Flags of a parameter of type `Method`; they depend on `--method` and `--parameters`."""


def refuse_flag_of(names: Sequence[str], flag: str, this: str) -> None:
    """Raise SettingsError if a flag belongs to other methods.

    Args:
        names: names of the methods that have it.
        flag: name of the flag, with underscores.
        this: method of the verb, for example "--method paper".
    """
    if names:
        shown = f"--{flag.replace('_', '-')}"
        where = " and ".join(f"--parameters {name}" if name == MOTORS else f"--method {name}" for name in names)
        raise SettingsError(f"{shown} belongs to {where}; this is {this}")


def owners(flag: str, estimate_only: bool = False) -> list[str]:
    """Return the names of the methods that have a flag.

    Args:
        flag: name of the flag, with underscores.
        estimate_only: true for only the flags that may change in a new estimate of the same recordings.
    """
    name = flag.removeprefix("no_")
    return [
        method
        for method, kind in _settings().items()
        if not isinstance(kind, EquipoiseError)
        and name in {setting.name for setting in flags_of(kind)}
        and (not estimate_only or name in kind.estimate_only)
    ]


def _settings() -> dict[str, type[Any] | EquipoiseError]:
    """Return the class of each method's settings, or the error of a method that cannot be used."""
    found: dict[str, type[Any] | EquipoiseError] = {}
    for name in METHODS:
        try:
            found[name] = settings_of(name)
        except EquipoiseError as error:  # raised again if the method is requested by name
            found[name] = error
    return found


def _summaries() -> str:
    summaries = [
        f"{name}: cannot be used here, {kind}." if isinstance(kind, EquipoiseError) else f"{name}: {kind.summary}."
        for name, kind in _settings().items()
    ]
    return " ".join([*summaries, "For the flags of a method: --method NAME --help."])
