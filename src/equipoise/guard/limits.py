"""Limits of a guarded robot."""

from __future__ import annotations

from dataclasses import dataclass, fields

from equipoise.errors import SettingsError


@dataclass(frozen=True)
class Limits:
    """Limits beyond those of the robot's model. No calibration of a working robot reaches them.

    In brackets: the largest value in 26 guarded calibrations of the catalogue's robots (bayesian and paper, standing and
    lying at first, realistic preset, 10 or 15 % of the robot's mass on top and off centre).

    Attributes:
        position_margin: encoder reading beyond the model's joint limits [rad]; commands may not exceed those limits
            (0.03).
        speed: joint speed over the model's limit (0.49).
        torque: joint torque over the model's limit (1.05: a motor at its limit, misread by a few percent).
        gains: commanded gains over the model's (1).
        temperature: motor temperature [deg C].
        lean: angle of the base from its commanded posture on a level floor, on four feet or on three [rad] (0.15).
        lean_in_lift: the same angle while two feet are up, or coming down [rad] (0.34).
        following: distance of a joint from its target [rad] (0.26); twice this distance fails at once.
        excess_torque: torque beyond the feed-forward torque of a command, over the model's limit; see `ForceLimit`.
        excess_force: force at a foot beyond that of the feed-forward torque [N].
        excess_weight: the same force over the robot's weight; it applies where it exceeds the previous two (heavy robots).
        battery: smallest battery charge, from 0 to 1.
        missing_torque: largest torque error of a motor, on a robot with an A1's m g h [Nm] (0.7).
        patience: longest time for which a speed, a torque, a temperature or a tracking error may last [s].
        silence: longest time without a fresh sample [s].
        stall: longest time without a command, or without a heartbeat of the calibration process [s].
        idle: longest time to hold the robot without a motion [s].
    """

    position_margin: float = 0.15
    speed: float = 1.2
    torque: float = 1.15
    gains: float = 3.0
    temperature: float = 75.0
    lean: float = 0.35
    lean_in_lift: float = 0.6
    following: float = 0.5
    excess_torque: float = 0.3
    excess_force: float = 60.0
    excess_weight: float = 0.25
    battery: float = 0.1
    missing_torque: float = 4.0
    patience: float = 0.15
    silence: float = 0.1
    stall: float = 0.2
    idle: float = 600.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not value > 0:
                raise SettingsError(f"limit {field.name} is {value}; it must be a positive number")
