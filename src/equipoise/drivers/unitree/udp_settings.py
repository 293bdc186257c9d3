"""Settings of the connection to a Unitree A1 or Go1."""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass
from typing import Literal

from equipoise.drivers.platform_settings import check_range
from equipoise.errors import SettingsError

Protocol = Literal["a1", "go1"]
FORM_NAMES: dict[Protocol, tuple[str, ...]] = {"a1": ("compressed", "struct"), "go1": ("plain", "scrambled")}
"""Names of the forms of packets by robot, the likeliest first."""
_LOCAL_PORTS: dict[Protocol, int] = {"a1": 8080, "go1": 8090}


@dataclass(frozen=True)
class UnitreeUdpSettings:
    """Settings of the connection to an A1 or a Go1.

    Attributes:
        protocol: robot of the packets: "a1" or "go1".
        address: address of the robot's motion controller (IPv4).
        port: port that it listens on.
        local_address: address of this computer's network interface; default: the one on the route to the robot.
        local_port: port that this computer listens on; default: 8080 for an A1, 8090 for a Go1.
        silence: time without a sample after which the connection counts as lost [s].
        form: form of the packets: "compressed" or "struct" (A1), "plain" or "scrambled" (Go1); default: detected.
        tick: time step of the robot's clock [s]; 0: it has none, and samples get their time of arrival; default:
            detected.
        check: whether samples with a wrong checksum are rejected.
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
        form_names(self.protocol, self.form)
        for name in ("address", "local_address"):
            if (value := getattr(self, name)) is not None:
                _check_address(name, value)
        check_range(self, "port", 1, 65535)
        check_range(self, "local_port", 1, 65535)
        check_range(self, "silence", 0.02, 10.0)
        check_range(self, "tick", 0.0, 1.0)

    @property
    def name(self) -> str:
        """Name of the platform."""
        return f"unitree-{self.protocol}"

    @property
    def listens_on(self) -> int:
        """Local port."""
        return _LOCAL_PORTS[self.protocol] if self.local_port is None else self.local_port


def form_names(protocol: Protocol, form: str | None) -> tuple[str, ...]:
    """Return the names of a robot's forms, or only the given one.

    Raises:
        SettingsError: the robot or the form does not exist.
    """
    if protocol not in FORM_NAMES:
        raise SettingsError(f"protocol is {protocol!r}; it must be one of {', '.join(FORM_NAMES)}")
    names = FORM_NAMES[protocol]
    if form is None:
        return names
    if form not in names:
        raise SettingsError(f"form is {form!r}; for protocol {protocol!r} it must be one of {', '.join(names)}")
    return (form,)


def _check_address(name: str, value: str) -> None:
    try:
        address = ipaddress.IPv4Address(value)
    except ValueError:
        raise SettingsError(f"{name} is {value!r}; it must be an IPv4 address, as in 192.168.123.10") from None
    if address.is_unspecified:
        raise SettingsError(f"{name} is {value}, which means all addresses; set one, as in 192.168.123.10")
