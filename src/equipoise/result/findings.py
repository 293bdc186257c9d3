"""What an estimate says about itself and about the sensors."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SensorFinding:
    """What a sensor, a joint or the floor was found to be off by.

    Attributes:
        name: what, as "FL_thigh_joint zero".
        value: in SI units.
        deviation: posterior standard deviation.
        sentence: for people; says what can be done where something can.
        notable: whether it is large enough to be worth fixing, and sure.
    """

    name: str
    value: float
    deviation: float
    sentence: str
    notable: bool


@dataclass(frozen=True)
class Check:
    """One question to the result about itself.

    Attributes:
        name: of the check.
        passed: whether nothing speaks against the result.
        message: what was looked at, and what speaks against it.
    """

    name: str
    passed: bool
    message: str
