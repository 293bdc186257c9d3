"""What can be set about the link to a Unitree Go2 or B2."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from equipoise.errors import SettingsError


@dataclass(frozen=True)
class UnitreeDdsSettings:
    """How a Go2 is reached.

    Attributes:
        interface: network interface of this computer, that the robot's cable is in; "lo" for a simulated robot.
        domain: number of the DDS domain; 0 on the robots, 1 in their makers' simulator.
        peers: addresses at which to look for the robot, where multicast does not find it.
        release_sport_mode: whether to have the robot's own controller let go of the motors before the first command.
        hanging: whether the robot hangs in a frame; otherwise it must lie when its controller lets go.
        check_crc: whether samples with a wrong checksum are left out.
        silence: time without a sample after which the link counts as lost [s].
        accept_cyclonedds: version of cyclonedds to use though robots, or others on the domain, run another.
    """

    interface: str = "eth0"
    domain: int = 0
    peers: tuple[str, ...] = ()
    release_sport_mode: bool = True
    hanging: bool = False
    check_crc: bool = True
    silence: float = 0.5
    accept_cyclonedds: str = ""

    kind: ClassVar[str] = "unitree-go2"

    def __post_init__(self) -> None:
        if not 0 <= self.domain <= 232:
            raise SettingsError(f"domain is {self.domain}; it must be from 0 to 232")
        if not 0.02 <= self.silence <= 10:
            raise SettingsError(f"silence is {self.silence} s; it must be from 0.02 to 10")


@dataclass(frozen=True)
class UnitreeB2Settings(UnitreeDdsSettings):
    """How a B2 is reached; it speaks as a Go2 does."""

    kind: ClassVar[str] = "unitree-b2"
