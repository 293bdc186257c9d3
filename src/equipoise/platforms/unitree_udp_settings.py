"""What can be set about the link to a Unitree A1 or Go1."""

from __future__ import annotations

import dataclasses
import ipaddress
from dataclasses import dataclass

from equipoise.errors import SettingsError
from equipoise.platforms.unitree_formats import FORMATS, GO1, PacketFormat, Protocol

_LOCAL_PORTS: dict[Protocol, int] = {"a1": 8080, "go1": 8090}


@dataclass(frozen=True)
class UnitreeUdpSettings:
    """How the robot is reached, and what is not sure about its packets.

    Attributes:
        protocol: whose packets: "a1" or "go1".
        address: of the robot's motion controller (IPv4).
        port: that it listens on.
        local_address: of this computer's network interface; default: any.
        local_port: that this computer listens on; default: 8080 for an A1, 8090 for a Go1.
        silence: without a sample after which the link counts as lost [s].
        tick: a step of the robot's clock [s]; 0: it has none, samples get the time when they arrive.
        check: whether samples with a wrong checksum are left out.
        scrambled: whether the checksum of commands is scrambled; default: a Go1's is, an A1's is not.
        kd_counts: Go1: of the integer that carries a kd of 1 Nm s/rad; public programs disagree between 16 and 32.
    """

    protocol: Protocol = "a1"
    address: str = "192.168.123.10"
    port: int = 8007
    local_address: str = "0.0.0.0"
    local_port: int | None = None
    silence: float = 1.0
    tick: float = 1e-3
    check: bool = True
    scrambled: bool | None = None
    kd_counts: float = GO1.counts["kd"]

    def __post_init__(self) -> None:
        if self.protocol not in FORMATS:
            raise SettingsError(f"protocol is {self.protocol!r}; it is one of {', '.join(FORMATS)}")
        for name in ("address", "local_address"):
            try:
                ipaddress.IPv4Address(getattr(self, name))
            except ValueError:
                raise SettingsError(
                    f"{name} is {getattr(self, name)!r}, no IPv4 address as in 192.168.123.10"
                ) from None
        for name, least, most in (
            ("port", 1, 65535),
            ("listens_on", 1, 65535),
            ("silence", 0.02, 10.0),
            ("tick", 0.0, 1.0),
            ("kd_counts", 1.0, 4096.0),
        ):
            if not least <= (value := getattr(self, name)) <= most:
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
    def packets(self) -> PacketFormat:
        """How the robot writes."""
        known = FORMATS[self.protocol]
        scrambled = known.scrambled if self.scrambled is None else self.scrambled
        counts = {**known.counts, "kd": self.kd_counts} if known.counts else {}
        return dataclasses.replace(known, scrambled=scrambled, counts=counts)
