"""`equipoise lab emulate`."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from types import ModuleType
from typing import Annotated, Any, Literal

from tyro.conf import Positional, arg
from tyro.constructors import StructConstructorSpec

from equipoise.cli.parsing import ChosenFlags
from equipoise.cli.setting_flags import fields_of, spec_of

EMULATORS = {
    "unitree-dds": ("unitree_dds", "UnitreeDdsOptions"),
    "unitree-udp": ("unitree_udp", "UnitreeUdpOptions"),
    "ros2": ("ros2", "Ros2Options"),
}
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
    return spec_of(kind.__doc__ or "", fields_of(kind), lambda values: kind(**values))


CHOSEN: dict[type, ChosenFlags] = {object: (_options_flags, None)}
