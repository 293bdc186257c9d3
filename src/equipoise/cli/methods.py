"""Which method a verb is about, and the flags that its settings make."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
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
MOTORS = "motors"
_BASE, _LEGS = "base", "legs"
_ALL = {_BASE, _LEGS, MOTORS}
_WHAT = (
    "What is to be found: 'base' (mass, centre of mass, inertia), 'legs' (masses, first moments and lengths of their links; "
    "with the base), 'motors' (friction, armature, gain and delay of each joint), several with commas, or 'all'."
)


def asked_for(what: str) -> set[str]:
    """Of "base", "legs" and "motors" those that `--parameters` names; legs are found with the base. Raises SettingsError."""
    words = {word.strip() for word in what.split(",")}
    asked = _ALL if words == {"all"} else words
    if not asked or asked - _ALL:
        raise SettingsError(f"--parameters is {what!r}; it must be base, legs, motors, several with commas, or all")
    return asked | {_BASE} if _LEGS in asked else asked


def method_asked_for(arguments: Sequence[str]) -> str:
    """The method's name: motors by themselves are one of their own; raises SettingsError."""
    if asked_for(chosen(arguments, "--parameters", _BASE)) == {MOTORS}:
        if chosen(arguments, "--method", MOTORS) != MOTORS:
            raise SettingsError("--parameters motors needs no --method; for both use --parameters base,motors")
        return MOTORS
    method = chosen(arguments, "--method", DEFAULT_METHOD)
    if method == MOTORS and chosen(arguments, "--parameters", MOTORS) != MOTORS:
        raise SettingsError("--method motors finds motors alone; for more leave it out, as --parameters base,motors")
    return method


def method_flags(arguments: Sequence[str]) -> StructConstructorSpec:
    """Return `--method`, `--parameters` and the flags of the settings of the method that they name; raises SettingsError."""
    name = method_asked_for(arguments)
    with_motors = name != MOTORS and MOTORS in asked_for(chosen(arguments, "--parameters", _BASE))
    words = _summaries() if {"-h", "--help"} & set(arguments) else ""
    choice = Annotated[literal_type_from_choices([*METHODS]), arg(help=words)]
    what = Annotated[str, arg(help=_WHAT, metavar="NAMES")]
    flags = [
        StructFieldSpec("method", cast("Any", choice), name),
        StructFieldSpec("parameters", cast("Any", what), MOTORS if name == MOTORS else _BASE),
        *flags_of(settings_of(name)),
        *(flags_of(settings_of(MOTORS)) if with_motors else ()),
    ]
    return spec_of(f"What to do, and the settings of {name}.", flags, _method)


def _method(flags: Mapping[str, Any]) -> Method:
    """Return the method that flags describe; raises SettingsError."""
    method, asked = method_from(flags["method"], flags), asked_for(flags["parameters"])
    if _LEGS in asked:
        method = _with_legs(method)
    if method.name == MOTORS or MOTORS not in asked:
        return method
    from equipoise.method.combined import CombinedMethod

    return CombinedMethod(method, method_from(MOTORS, flags))


def method_from(name: str, flags: Mapping[str, Any]) -> Method:
    """Return a method from the values of its flags; raises SettingsError, before it is imported where a value is wrong."""
    settings = settings_of(name)
    values = values_of(settings, flags)
    settings(**values)
    return method_named(name)(**values)


def _with_legs(method: Method) -> Method:
    """The method, which finds what the legs weigh too; raises SettingsError where it cannot."""
    from equipoise.bayesian.method import BayesianMethod

    if not isinstance(method, BayesianMethod):
        raise SettingsError(
            f"--parameters legs is for --method bayesian; {method.name} does not find legs: leave them out"
        )
    return dataclasses.replace(method, swings=True)


def refuse_other_method(flag: str, arguments: Sequence[str]) -> None:
    """Raise SettingsError for a flag of another method than the one that the arguments name."""
    refuse_flag_of(owners(flag), flag, f"--method {method_asked_for(arguments)}")


METHOD_FLAGS: ChosenFlags = (method_flags, refuse_other_method)
"""Flags of a parameter of the type `Method`, which `--method` and `--parameters` choose."""


def refuse_flag_of(names: Sequence[str], flag: str, this: str) -> None:
    """Raise SettingsError if other methods have a flag.

    Args:
        names: names of the methods that have it.
        flag: name of the flag, with underscores.
        this: method of the verb, as "--method paper".
    """
    if names:
        shown = f"--{flag.replace('_', '-')}"
        where = " and ".join(f"--parameters {name}" if name == MOTORS else f"--method {name}" for name in names)
        raise SettingsError(f"{shown} belongs to {where}; this is {this}")


def owners(flag: str, judging: bool = False) -> list[str]:
    """Return the names of the methods that have a flag.

    Args:
        flag: name of the flag, with underscores.
        judging: whether only flags count with which recordings may be estimated again.
    """
    name = flag.removeprefix("no_")
    return [
        method
        for method, kind in _methods(settings_of).items()
        if not isinstance(kind, EquipoiseError)
        and name in {setting.name for setting in flags_of(kind)}
        and (not judging or name in kind.judging)
    ]


def _methods(find: Callable[[str], type[Any]]) -> dict[str, type[Any] | EquipoiseError]:
    """Return the class that a function finds for each method, or why the method cannot be used."""
    found: dict[str, type[Any] | EquipoiseError] = {}
    for name in METHODS:
        try:
            found[name] = find(name)
        except EquipoiseError as error:  # raised again where the method is asked for by name
            found[name] = error
    return found


def _summaries() -> str:
    said = [
        f"{name}: cannot be used here, {kind}." if isinstance(kind, EquipoiseError) else f"{name}: {kind.summary}."
        for name, kind in _methods(method_named).items()
    ]
    return " ".join([*said, "Each has flags of its own: --method NAME --help."])
