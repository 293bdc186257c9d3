"""`equipoise lab emulate`."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import Annotated, Any, Literal

from tyro.conf import Positional, arg

from equipoise.cli.settings import Verb

EMULATORS = {
    "unitree-dds": ("unitree_dds", "UnitreeDdsOptions"),
    "unitree-udp": ("unitree_udp", "UnitreeUdpOptions"),
    "ros2": ("ros2", "Ros2Options"),
}
Protocol = Annotated[
    Positional[Literal["unitree-dds", "unitree-udp", "ros2"]],
    arg(metavar="PROTOCOL", help="unitree-dds (Go2, B2), unitree-udp (A1, Go1) or ros2; each has its own flags."),
]


def emulate_for(arguments: Sequence[str]) -> Verb:
    """Return the verb with the flags of the emulator that the arguments name."""
    module_name, options_name = EMULATORS.get(next(iter(arguments), ""), EMULATORS["unitree-dds"])
    module = importlib.import_module(f"equipoise.lab.emulators.{module_name}")

    def emulate(protocol: Protocol, options: Any) -> None:
        module.serve(options)

    emulate.__annotations__ = {"protocol": Protocol, "options": getattr(module, options_name)}
    emulate.__doc__ = """Run a simulated robot that speaks a real robot's protocol, until Ctrl-C.

    Example: equipoise lab emulate unitree-dds --robot go2 --domain 5
    """
    return emulate
