"""Findings of an estimate about sensors, motors, leg links and itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TypeVar

from equipoise.result.quantity import Quantity
from equipoise.result.statistics import NORMAL_95


@dataclass(frozen=True)
class SensorFinding:
    """Error of a sensor, a joint or the floor.

    Attributes:
        name: name of the sensor error, as "FL_thigh_joint offset".
        value: estimate of the error, in SI units.
        std: posterior standard deviation, in the same unit.
        message: description for the user, with a remedy if there is one.
        significant: True if the error is large and certain enough to correct.
        unit: SI unit of the value; empty for a fraction.
    """

    name: str
    value: float
    std: float
    message: str
    significant: bool
    unit: str = ""

    @property
    def half_width(self) -> float:
        """Half width of the 95 % interval, in the unit of the value."""
        return NORMAL_95 * self.std


Found = TypeVar("Found", bound="Part")


@dataclass(frozen=True)
class Part:
    """Estimates about one part of the robot: quantities and other fields."""

    @property
    def quantities(self) -> dict[str, Quantity]:
        """Quantities of the part, by name."""
        return {name: value for name, value in vars(self).items() if isinstance(value, Quantity)}

    def with_truth(self: Found, truth: Mapping[str, float]) -> Found:
        """Return the part with ground truth, by quantity name, SI units."""
        joined = {name: replace(q, truth=truth.get(name)) for name, q in self.quantities.items()}
        return replace(self, **joined)

    def doubted(self: Found) -> Found:
        """Return the part with the verdict "doubtful", for a run with a failed check."""
        return replace(self, **{name: quantity.doubted() for name, quantity in self.quantities.items()})


@dataclass(frozen=True)
class Motor(Part):
    """Estimates about one joint's motor. Torques have the mean scale of the torques that the motors report.

    Attributes:
        coulomb_friction: friction that does not depend on the speed [Nm].
        viscous_friction: friction per joint speed [Nm s/rad].
        stribeck_friction: friction at rest minus Coulomb friction [Nm]; without a value if the data do not support it.
        armature: inertia of the rotor, reflected to the joint [kg m2].
        relative_gain: ratio of true to reported torque, relative to its mean over all motors, minus one.
        delay: delay from a command to its torque [s].
        residual: systematic residual of the motor model: rms of its means in bins of speed or load [Nm]; None if not
            computed.
    """

    coulomb_friction: Quantity = field(default=Quantity("coulomb_friction", "Nm"))
    viscous_friction: Quantity = field(default=Quantity("viscous_friction", "Nm s/rad"))
    stribeck_friction: Quantity = field(default=Quantity("stribeck_friction", "Nm"))
    armature: Quantity = field(default=Quantity("armature", "kg m2"))
    relative_gain: Quantity = field(default=Quantity("relative_gain", "1"))
    delay: Quantity = field(default=Quantity("delay", "s"))
    residual: float | None = None


@dataclass(frozen=True)
class Link(Part):
    """Estimates about one moving leg link with everything fixed to it, in the frame of its joint.

    Motions determine the first moment m c well; they determine mass and CoM less accurately.

    Attributes:
        mass: mass [kg].
        moment_x, moment_y, moment_z: first moment, mass times CoM coordinates [kg m].
        length: distance, perpendicular to the joint's axis, to the next joint or to the foot centre [m].
    """

    mass: Quantity = field(default=Quantity("mass", "kg"))
    moment_x: Quantity = field(default=Quantity("moment_x", "kg m"))
    moment_y: Quantity = field(default=Quantity("moment_y", "kg m"))
    moment_z: Quantity = field(default=Quantity("moment_z", "kg m"))
    length: Quantity = field(default=Quantity("length", "m"))

    @property
    def moment(self) -> tuple[Quantity, Quantity, Quantity]:
        """First moment about the joint, in the joint's frame [kg m]."""
        return self.moment_x, self.moment_y, self.moment_z


@dataclass(frozen=True)
class JointFindings(Motor):
    """Estimates about one joint and its motor; a value is None if the method does not estimate it.

    Attributes:
        offset: joint offset, encoder reading minus joint position [rad].
        torque_gain: ratio of true to reported torque, minus one.
    """

    offset: Quantity = field(default=Quantity("offset", "rad"))
    torque_gain: Quantity = field(default=Quantity("torque gain", "1"))

    @classmethod
    def of(cls, joint: str, errors: Mapping[str, SensorFinding], motor: Motor | None = None) -> JointFindings:
        """Return the estimates about a joint from all sensor errors by name and from its motor."""
        offset = _quantity(f"{joint} offset", "rad", errors)
        return cls(offset=offset, torque_gain=_quantity(f"{joint} torque gain", "1", errors), **vars(motor or Motor()))


def _quantity(name: str, unit: str, findings: Mapping[str, SensorFinding]) -> Quantity:
    if name not in findings:
        return Quantity(name, unit)
    return Quantity(name, unit, findings[name].value, findings[name].std)


@dataclass(frozen=True)
class Check:
    """One check of a result.

    Attributes:
        name: name of the check.
        passed: True if the check passed.
        message: finding of the check.
    """

    name: str
    passed: bool
    message: str
