"""`equipoise lab emulate`."""

from __future__ import annotations

import dataclasses
import functools
import importlib
import signal
from collections.abc import Sequence
from typing import Annotated, Any, Literal, cast

from tyro.conf import Positional, arg
from tyro.constructors import StructConstructorSpec

from equipoise.cli.flags import PayloadGiven, PresetName, WithEffects, WithoutEffects
from equipoise.cli.parsing import ChosenFlags
from equipoise.cli.setting_flags import flags_of, settings_from, spec_of

EMULATORS = {"unitree-dds": "UnitreeDds", "unitree-udp": "UnitreeUdp", "ros2": "Ros2"}
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
    from equipoise.lab.emulators.emulated_robot import EmulatedRobot
    from equipoise.robot.catalog import load_robot

    settings = cast("Any", options)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # a background process may ignore Ctrl-C
    robot = load_robot(settings.robot)
    emulated = EmulatedRobot(robot, settings)
    module = importlib.import_module(f"equipoise.lab.emulators.{protocol.replace('-', '_')}")
    emulated.serve(getattr(module, f"{EMULATORS[protocol]}Wire")(robot, settings, emulated.log))


def _options_flags(arguments: Sequence[str]) -> StructConstructorSpec:
    """Return the flags of the emulator that the arguments name, those of a simulated robot as in `calibrate`."""
    from equipoise.lab.emulators import options

    protocol = next((argument for argument in arguments if argument in EMULATORS), "unitree-dds")
    kind: Any = getattr(options, f"{EMULATORS[protocol]}Options")
    flags = (
        dataclasses.replace(flag, type=_OF_CALIBRATE.get(flag.name, cast("Any", flag).type)) for flag in flags_of(kind)
    )
    return spec_of(kind.__doc__.splitlines()[0], flags, functools.partial(settings_from, kind))


CHOSEN: dict[type, ChosenFlags] = {object: (_options_flags, None)}
