"""Flags of `equipoise calibrate` that do not go together: one that would be ignored is refused instead."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from inspect import signature

from equipoise.errors import SettingsError

Verb = Callable[..., None]

_FLAGS_OF_SIMULATORS = ("noise", "payload", "start", "seed", "noise_seed")
_FLAGS_OF_ROBOTS = ("set", "settings", "yes")
_FLAGS_OF_RESUME = (
    "resume",
    "yes",
    "view",
    "view_port",
    "rerun",
    "report",
    "pictures",
    "json",
    "quiet",
    "verbose",
    "debug",
)

_FLAGS_OF_METHOD = {
    "precise": ("budget", "mass", "mass_sd", "sway"),
    "paper": (
        "feet", "tolerance", "lower", "upper", "t_thres", "lift_height", "speed", "sway_amplitude", "sway_frequency",
        "sway_duration",
    ),
}  # fmt: skip


def refuse_flags_beside_resume(verb: Verb, given: Mapping[str, object]) -> None:
    """A run goes on as it began: a flag that would change it would be ignored without a word."""
    for name, parameter in signature(verb).parameters.items():
        if name not in _FLAGS_OF_RESUME and given[name] != parameter.default:
            what = "a robot" if name == "robot" else f"--{_flag(name)}"
            raise SettingsError(f"--resume goes on as the run began; {what} cannot be given with it")


def refuse_flags_of_other_methods(verb: Verb, method: str, given: Mapping[str, object]) -> None:
    """A flag that a method does not know would be ignored without a word."""
    defaults = signature(verb).parameters
    for owner, names in _FLAGS_OF_METHOD.items():
        for name in names:
            if owner != method and given[name] != defaults[name].default:
                raise SettingsError(f"--{_flag(name)} belongs to --method {owner}; this is --method {method}")


def refuse_flags_of_other_platforms(verb: Verb, platform: str, given: Mapping[str, object]) -> None:
    """A flag that a platform does not know would be ignored without a word."""
    from equipoise.drivers.catalog import SIMULATED

    simulated = platform in SIMULATED
    defaults = signature(verb).parameters
    for name in _FLAGS_OF_ROBOTS if simulated else _FLAGS_OF_SIMULATORS:
        if given[name] != defaults[name].default:
            kind = "real robots" if simulated else "simulators"
            raise SettingsError(f"--{_flag(name)} is for {kind}; {platform} is none")


def _flag(name: str) -> str:
    return "no-sway" if name == "sway" else name.replace("_", "-")
