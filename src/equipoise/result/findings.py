"""What an estimate says about itself and about the sensors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from equipoise.result.quantity import Quantity
from equipoise.result.statistics import NORMAL_95


@dataclass(frozen=True)
class SensorFinding:
    """What a sensor, a joint or the floor was found to be off by.

    Attributes:
        name: name of the sensor error, as "FL_thigh_joint zero".
        value: estimate of the error, in SI units.
        deviation: posterior standard deviation, in the same unit.
        sentence: sentence for people; says what can be done where something can.
        notable: whether it is large enough to be worth fixing, and sure.
    """

    name: str
    value: float
    deviation: float
    sentence: str
    notable: bool

    @property
    def half(self) -> float:
        """Half the 95 % interval."""
        return NORMAL_95 * self.deviation


@dataclass(frozen=True)
class JointFindings:
    """What was found about one joint; values are None where the method finds none.

    Attributes:
        zero: encoder reading less joint position [rad].
        torque_gain: true over reported torque, less one.
    """

    zero: Quantity
    torque_gain: Quantity

    @classmethod
    def of(cls, joint: str, findings: Mapping[str, SensorFinding]) -> JointFindings:
        """From all findings by name."""
        return cls(_quantity(f"{joint} zero", "rad", findings), _quantity(f"{joint} torque gain", "1", findings))


def _quantity(name: str, unit: str, findings: Mapping[str, SensorFinding]) -> Quantity:
    if name not in findings:
        return Quantity(name, unit)
    return Quantity(name, unit, findings[name].value, findings[name].deviation)


@dataclass(frozen=True)
class Check:
    """One question to the result about itself.

    Attributes:
        name: name of the check.
        passed: whether nothing speaks against the result.
        message: sentence on what was looked at, and what speaks against it.
    """

    name: str
    passed: bool
    message: str
