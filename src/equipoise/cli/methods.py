"""Which method a verb is about, and the flags that its settings make."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import arg

from equipoise.cli.settings import Verb, chosen, flags_class, one_of, read_flags, settings_of, unknown_flags
from equipoise.errors import EquipoiseError, SettingsError

if TYPE_CHECKING:
    from equipoise.method.method import Method

DEFAULT_METHOD = "precise"
MOTORS = "motors"
_BASE, _LEGS = "base", "legs"
_ALL = {_BASE, _LEGS, MOTORS}
_WHAT = (
    "What is to be found: 'base' (mass, centre of mass, inertia), 'legs' (masses, first moments and lengths of their links; "
    "with the base), 'motors' (friction, armature, gain and delay of each joint), several with commas, or 'all'."
)


def asked_for(what: str) -> set[str]:
    """Of "base", "legs" and "motors" those that `--what` names; legs are found with the base. Raises SettingsError."""
    words = {word.strip() for word in what.split(",")}
    asked = _ALL if words == {"all"} else words
    if not asked or asked - _ALL:
        raise SettingsError(f"--what is {what!r}; it must be base, legs, motors, several with commas, or all")
    return asked | {_BASE} if _LEGS in asked else asked


def method_asked_for(arguments: Sequence[str]) -> str:
    """The method's name: motors by themselves are one of their own; raises SettingsError."""
    if asked_for(chosen(arguments, "--what", _BASE)) == {MOTORS}:
        if chosen(arguments, "--method", MOTORS) != MOTORS:
            raise SettingsError("--what motors needs no --method; for both use --what base,motors")
        return MOTORS
    method = chosen(arguments, "--method", DEFAULT_METHOD)
    if method == MOTORS and chosen(arguments, "--what", MOTORS) != MOTORS:
        raise SettingsError("--method motors finds motors alone; for more leave it out, as --what base,motors")
    return method


def method_flags(name: str, arguments: Sequence[str]) -> Any:
    """The class of `--method` and of the flags of a method's settings."""
    from equipoise.method.table import METHODS, method_named

    kind = method_named(name)
    words = _summaries() if {"-h", "--help"} & set(arguments) else ""
    choice = Annotated[one_of(METHODS), arg(help=words)]
    what = Annotated[str, arg(help=_WHAT, metavar="WHAT")]
    others = [("method", choice, name), ("what", what, MOTORS if name == MOTORS else _BASE)]
    settings = settings_of(kind)
    if name != MOTORS and MOTORS in asked_for(chosen(arguments, "--what", _BASE)):
        settings += settings_of(method_named(MOTORS))
    return flags_class("MethodFlags", f"What to do, and the settings of {name}.", settings, others)


def read_method(flags: Any) -> Method:
    """The method that flags describe; raises SettingsError."""
    from equipoise.method.table import method_named
    from equipoise.method.together import Together

    method = read_flags(method_named(flags.method), flags)
    if _LEGS in asked_for(flags.what):
        method = _with_legs(method)
    if flags.method == MOTORS or MOTORS not in asked_for(flags.what):
        return method
    return Together(method, read_flags(method_named(MOTORS), flags))


def _with_legs(method: Method) -> Method:
    """The method, which finds what the legs weigh too; raises SettingsError where it cannot."""
    from equipoise.precise.method import Precise

    if not isinstance(method, Precise):
        raise SettingsError(f"--what legs is for --method precise; {method.name} does not find legs: leave them out")
    return dataclasses.replace(method, swings=True)


def refuse_flags_of_other_methods(verb: Verb, arguments: Sequence[str], this: str, judging: bool = False) -> None:
    """Say whose a flag is that a verb has not.

    Args:
        this: method or platform of the verb, as "--method paper".
        judging: whether only flags count with which recordings may be estimated again.

    Raises:
        SettingsError: another method has it.
    """
    for flag in unknown_flags(verb, arguments):
        if whose := owners(flag, judging):
            shown = f"--{flag.replace('_', '-')}"
            where = " and ".join(f"--what {name}" if name == MOTORS else f"--method {name}" for name in whose)
            raise SettingsError(f"{shown} belongs to {where}; this is {this}")


def owners(flag: str, judging: bool = False) -> list[str]:
    """Names of the methods that have a flag."""
    return [name for name, kind in _usable().items() if flag in _flags(kind, judging)]


def _flags(kind: type[Method], judging: bool) -> set[str]:
    names = [setting.name for setting in settings_of(kind, kind.judging if judging else None)]
    return {*names, *(f"no_{name}" for name in names)}


def _usable() -> dict[str, type[Method]]:
    from equipoise.method.table import METHODS, method_named

    found: dict[str, type[Method]] = {}
    for name in METHODS:
        try:
            found[name] = method_named(name)
        except EquipoiseError:  # whoever asks for it by name is told
            continue
    return found


def _summaries() -> str:
    from equipoise.method.table import METHODS, method_named

    said: list[str] = []
    for name in METHODS:
        try:
            said.append(f"{name}: {method_named(name).summary}.")
        except EquipoiseError as error:
            said.append(f"{name}: cannot be used here, {error}.")
    return " ".join([*said, "Each has flags of its own: --method NAME --help."])
