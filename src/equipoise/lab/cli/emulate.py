"""`equipoise lab emulate`."""

from __future__ import annotations

import dataclasses
import importlib
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from types import ModuleType
from typing import Annotated, Any, Literal, cast

from tyro.conf import Positional, arg
from tyro.constructors import StructConstructorSpec, StructFieldSpec

from equipoise.cli.flags import PayloadGiven, PresetName, WithEffects, WithoutEffects
from equipoise.cli.parsing import ChosenFlags
from equipoise.cli.setting_flags import flags_of, spec_of, values_of

EMULATORS = {
    "unitree-dds": ("unitree_dds", "UnitreeDdsOptions"),
    "unitree-udp": ("unitree_udp", "UnitreeUdpOptions"),
    "ros2": ("ros2", "Ros2Options"),
}
_OF_CALIBRATE: dict[str, Any] = {
    "sim_preset": PresetName, "enable_effect": WithEffects, "disable_effect": WithoutEffects, "payload": PayloadGiven
}  # fmt: skip
Protocol = Annotated[
    Positional[Literal["unitree-dds", "unitree-udp", "ros2"]],
    arg(metavar="PROTOCOL", help="unitree-dds (Go2, B2), unitree-udp (A1, Go1) or ros2, each with its own flags."),
]


def emulate(protocol: Protocol, *, options: Annotated[object, arg(name="emulator")]) -> None:
    """Run an emulator with the protocol of a real robot until Ctrl-C.

    Example: equipoise lab emulate unitree-dds --robot go2 --domain 5
    """
    _module(protocol).serve(options)


def _module(protocol: str) -> ModuleType:
    return importlib.import_module(f"equipoise.lab.emulators.{EMULATORS[protocol][0]}")


def _options_flags(arguments: Sequence[str]) -> StructConstructorSpec:
    """Return the flags of the emulator that the arguments name."""
    protocol = next((argument for argument in arguments if argument in EMULATORS), "unitree-dds")
    kind: Any = getattr(_module(protocol), EMULATORS[protocol][1])
    defaults = kind()
    settings = cast("dict[str, Any]", defaults.__dict__)
    groups: dict[str, Any] = {name: settings[name] for name in settings if dataclasses.is_dataclass(settings[name])}
    own = [flag for flag in flags_of(kind) if flag.name not in groups]

    def options(values: Mapping[str, Any]) -> Any:
        made = {name: dataclasses.replace(one, **values_of(one.__class__, values)) for name, one in groups.items()}
        return dataclasses.replace(defaults, **values_of(kind, values), **made)

    return spec_of(kind.__doc__.splitlines()[0], [*own, *chain(*map(_flags_in, groups.values()))], options)


def _flags_in(group: Any) -> Iterator[StructFieldSpec]:
    """Yield the flags of a group of settings with its defaults, those of a simulated robot as in `calibrate`."""
    usual = group.__class__()
    for flag in flags_of(group.__class__):
        value, named = getattr(group, flag.name), cast("Any", flag)
        default = flag.default if value == getattr(usual, flag.name) else value
        yield dataclasses.replace(flag, type=_OF_CALIBRATE.get(flag.name, named.type), default=default)


CHOSEN: dict[type, ChosenFlags] = {object: (_options_flags, None)}
