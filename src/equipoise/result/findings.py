"""Findings of an estimate about sensors, motors, leg links and itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
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
        message: sentence for people; says what can be done where something can.
        significant: whether it is large enough to be worth fixing, and sure.
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
        """Half the 95 % interval."""
        return NORMAL_95 * self.std


# What is not known.
_COULOMB_FRICTION = Quantity("coulomb_friction", "Nm")
_VISCOUS_FRICTION = Quantity("viscous_friction", "Nm s/rad")
_STRIBECK_FRICTION = Quantity("stribeck_friction", "Nm")
_ARMATURE = Quantity("armature", "kg m2")
_RELATIVE_GAIN = Quantity("relative_gain", "1")
_DELAY = Quantity("delay", "s")
_ZERO = Quantity("zero", "rad")
_TORQUE_GAIN = Quantity("torque gain", "1")


Found = TypeVar("Found", bound="Part")


@dataclass(frozen=True)
class Part:
    """Findings about a part of the robot: fields that are quantities, and others."""

    @property
    def quantities(self) -> dict[str, Quantity]:
        """All by name."""
        return {name: value for name, value in vars(self).items() if isinstance(value, Quantity)}

    def with_truth(self: Found, truth: Mapping[str, float]) -> Found:
        """Return the part with true values, by name."""
        joined = {name: replace(q, truth=truth.get(name)) for name, q in self.quantities.items()}
        return replace(self, **joined)

    def doubted(self: Found) -> Found:
        """Return the part as a run gives it of which a check failed."""
        return replace(self, **{name: quantity.doubted() for name, quantity in self.quantities.items()})


@dataclass(frozen=True)
class Motor(Part):
    """Findings about one joint's motor; torques are in the unit in which the motors report them on average.

    Attributes:
        coulomb_friction: friction that does not depend on the speed [Nm].
        viscous_friction: friction over the speed [Nm s/rad].
        stribeck_friction: friction at rest less Coulomb friction, which it falls to as a joint gets faster [Nm]; without a
            value where the data do not want it.
        armature: inertia of the rotor, seen at the joint [kg m2].
        relative_gain: true over reported torque, over the mean of that of all motors, less one.
        delay: age of the command that a torque obeys [s].
        normalized_residual: what the law of friction leaves: rms of the torque that repeats with the speed [Nm]; None: not
            known.
    """

    coulomb_friction: Quantity = _COULOMB_FRICTION
    viscous_friction: Quantity = _VISCOUS_FRICTION
    stribeck_friction: Quantity = _STRIBECK_FRICTION
    armature: Quantity = _ARMATURE
    relative_gain: Quantity = _RELATIVE_GAIN
    delay: Quantity = _DELAY
    normalized_residual: float | None = None


_MASS = Quantity("mass", "kg")
_MOMENT_X, _MOMENT_Y, _MOMENT_Z = (Quantity(f"moment_{axis}", "kg m") for axis in "xyz")
_LENGTH = Quantity("length", "m")


@dataclass(frozen=True)
class Link(Part):
    """Findings about one moving link of a leg, with all that is fixed to it, in the frame of its joint.

    Motions determine its first moment m c; its mass, and so its CoM, they determine less well.

    Attributes:
        mass: mass [kg].
        moment_x, moment_y, moment_z: mass times the coordinates of its CoM [kg m].
        length: distance across the joint's axis to the next joint, or to the middle of the foot [m].
    """

    mass: Quantity = _MASS
    moment_x: Quantity = _MOMENT_X
    moment_y: Quantity = _MOMENT_Y
    moment_z: Quantity = _MOMENT_Z
    length: Quantity = _LENGTH

    @property
    def moment(self) -> tuple[Quantity, Quantity, Quantity]:
        """The first moment about the joint [kg m]."""
        return self.moment_x, self.moment_y, self.moment_z


@dataclass(frozen=True)
class JointFindings(Motor):
    """Findings about one joint and its motor; values are None where the method estimates none.

    Attributes:
        zero: encoder reading less joint position [rad].
        torque_gain: true over reported torque, less one.
    """

    zero: Quantity = _ZERO
    torque_gain: Quantity = _TORQUE_GAIN

    @classmethod
    def of(cls, joint: str, findings: Mapping[str, SensorFinding], motor: Motor | None = None) -> JointFindings:
        """From all findings by name, and from what was found about the joint's motor."""
        zero = _quantity(f"{joint} offset", "rad", findings)
        return cls(zero=zero, torque_gain=_quantity(f"{joint} torque gain", "1", findings), **vars(motor or Motor()))


def _quantity(name: str, unit: str, findings: Mapping[str, SensorFinding]) -> Quantity:
    if name not in findings:
        return Quantity(name, unit)
    return Quantity(name, unit, findings[name].value, findings[name].std)


@dataclass(frozen=True)
class Check:
    """One question to the result about itself.

    Attributes:
        name: name of the check.
        passed: whether the check found no objection.
        message: sentence on what was checked, and the objection.
    """

    name: str
    passed: bool
    message: str
