"""What can be set about the link to a Unitree A1 or Go1."""

from __future__ import annotations

import ipaddress
from collections.abc import Mapping
from dataclasses import dataclass

from equipoise.drivers.unitree.formats import PacketFormat, Protocol, forms_of
from equipoise.errors import SettingsError

_LOCAL_PORTS: dict[Protocol, int] = {"a1": 8080, "go1": 8090}


@dataclass(frozen=True)
class UnitreeUdpSettings:
    """How the robot is reached, and what is not known about it before it answers.

    Attributes:
        protocol: whose packets: "a1" or "go1".
        address: of the robot's motion controller (IPv4).
        port: that it listens on.
        local_address: of this computer's network interface; default: the one on the way to the robot.
        local_port: that this computer listens on; default: 8080 for an A1, 8090 for a Go1.
        silence: without a sample after which the link counts as lost [s].
        form: of the packets: "compressed" or "struct" (A1), "plain" or "scrambled" (Go1); default: what the robot answers.
        tick: a step of the robot's clock [s]; 0: it has none, samples get the time when they arrive; default: learnt.
        check: whether samples with a wrong checksum are left out.
    """

    protocol: Protocol = "a1"
    address: str = "192.168.123.10"
    port: int = 8007
    local_address: str | None = None
    local_port: int | None = None
    silence: float = 1.0
    form: str | None = None
    tick: float | None = None
    check: bool = True

    def __post_init__(self) -> None:
        forms_of(self.protocol, self.form)
        for name in ("address", "local_address"):
            if (value := getattr(self, name)) is not None:
                _check_address(name, value)
        for name, least, most in (
            ("port", 1, 65535),
            ("listens_on", 1, 65535),
            ("silence", 0.02, 10.0),
            ("tick", 0.0, 1.0),
        ):
            if (value := getattr(self, name)) is not None and not least <= value <= most:
                raise SettingsError(
                    f"{name.replace('listens_on', 'local_port')} is {value}; it must be from {least:g} to {most:g}"
                )

    @property
    def name(self) -> str:
        """Of the platform."""
        return f"unitree-{self.protocol}"

    @property
    def listens_on(self) -> int:
        """The local port."""
        return _LOCAL_PORTS[self.protocol] if self.local_port is None else self.local_port

    @property
    def forms(self) -> Mapping[str, PacketFormat]:
        """How the robot may write, by name, the likeliest first."""
        return forms_of(self.protocol, self.form)


def _check_address(name: str, value: str) -> None:
    try:
        address = ipaddress.IPv4Address(value)
    except ValueError:
        raise SettingsError(f"{name} is {value!r}, no IPv4 address as in 192.168.123.10") from None
    if address.is_unspecified:
        raise SettingsError(f"{name} is {value}, which is all of them; name one, as in 192.168.123.10")
