"""Settings of the method that estimates motors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal, get_args

from equipoise.errors import SettingsError

_SHORTEST, _LONGEST = 3.0, 300.0  # [s]

MotorStance = Literal["auto", "belly", "three-feet"]
"""Stance of the robot while its joints swing."""


@dataclass(frozen=True)
class MotorsSettings:
    """Settings of the method that estimates motors.

    Attributes:
        motor_time: duration of the swing of all joints, or of the four legs' swings together [s].
        motor_stance: "belly" with all legs up, "three-feet" with one leg up, or "auto": belly if its legs can turn up.
    """

    summary: ClassVar[str] = (
        "the robot lies on its belly and swings all legs in the air, or stands and swings one after the other; friction, "
        "rotor inertia, relative torque gain and delay of each joint, with intervals"
    )
    estimate_only: ClassVar[tuple[str, ...]] = ()

    motor_time: float = 10.0
    motor_stance: MotorStance = "auto"

    def __post_init__(self) -> None:
        if not _SHORTEST <= self.motor_time <= _LONGEST:
            raise SettingsError(f"motor_time is {self.motor_time}; it must be from {_SHORTEST:g} to {_LONGEST:g}")
        if self.motor_stance not in (stances := get_args(MotorStance)):
            raise SettingsError(f"motor_stance is {self.motor_stance!r}; it must be one of {', '.join(stances)}")
