"""Settings of the connection to a Unitree Go2 or B2."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from equipoise.drivers.platform_settings import check_range
from equipoise.errors import SettingsError


@dataclass(frozen=True)
class UnitreeDdsSettings:
    """Settings of the connection to a Go2.

    Attributes:
        interface: network interface of the robot's cable; "lo" for an emulator.
        domain: number of the DDS domain; 0 on the robots, 1 in their makers' simulator.
        peers: addresses for discovery of the robot, if multicast does not find it.
        release_sport_mode: whether the robot's own controller must release the motors before the first command.
        hanging: whether the robot hangs in a frame; otherwise it must lie when its controller releases the motors.
        check_crc: whether samples with a wrong checksum are rejected; public simulators send no checksum, and need false.
        silence: time without a sample after which the connection counts as lost [s].
        motor_mode: motor mode of commands, 1 or 10. The maker's C++ examples send 1 to a Go2 and 10 to a B2; its Python
            example sends 1 to a B2 too. Default: as the C++ examples.
        accept_cyclonedds: version of cyclonedds to use although robots, or others on the domain, run another.
    """

    interface: str = "eth0"
    domain: int = 0
    peers: tuple[str, ...] = ()
    release_sport_mode: bool = True
    hanging: bool = False
    check_crc: bool = True
    silence: float = 0.5
    motor_mode: int = 1
    accept_cyclonedds: str = ""

    kind: ClassVar[str] = "unitree-go2"

    def __post_init__(self) -> None:
        check_range(self, "domain", 0, 232)
        check_range(self, "silence", 0.02, 10)
        if self.motor_mode not in (1, 10):
            raise SettingsError(
                f"motor_mode is {self.motor_mode}; it must be 1 or 10 (0x0A), as in the maker's examples"
            )


@dataclass(frozen=True)
class UnitreeB2Settings(UnitreeDdsSettings):
    """Settings of the connection to a B2, which has the messages of a Go2."""

    motor_mode: int = 10

    kind: ClassVar[str] = "unitree-b2"
