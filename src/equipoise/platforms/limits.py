"""How far a guarded robot may go."""

from __future__ import annotations

from dataclasses import dataclass, fields

from equipoise.errors import SettingsError


@dataclass(frozen=True)
class Limits:
    """What stops a robot, beyond its model's own limits. Each is wide enough that no calibration of a sound robot meets it.

    Attributes:
        position_margin: by which an encoder may read beyond the model's joint limits [rad]; commands may not.
        speed: of a joint, over the model's limit.
        torque: of a joint, over the model's limit.
        gains: of a command, over the model's.
        temperature: of a motor [deg C].
        tilt: of the base from upright, on four feet [rad].
        tilt_in_lift: while two feet are up, or coming down [rad].
        following: how far a joint may stay behind its target [rad].
        missing_torque: by which a motor may fall short of the torque that it was sent, on a robot with an A1's m g h [Nm].
        patience: how long a speed, torque or following error may last [s].
        silence: the longest time without a fresh sample [s].
        stall: the longest time without a command while the robot moves [s].
    """

    position_margin: float = 0.15
    speed: float = 1.2
    torque: float = 1.15
    gains: float = 3.0
    temperature: float = 75.0
    tilt: float = 0.44
    tilt_in_lift: float = 0.7
    following: float = 0.5
    missing_torque: float = 4.0
    patience: float = 0.15
    silence: float = 0.1
    stall: float = 0.2

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not value > 0:
                raise SettingsError(f"limit {field.name} is {value}; it must be a positive number")
