"""Estimated parameters of sensors, motors and legs, in columns of one kind of number each."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace

from equipoise.estimator.unknowns import Priors, Unknown
from equipoise.result.calibration import Calibration
from equipoise.result.findings import Part, SensorFinding
from equipoise.result.quantity import Quantity
from equipoise.result.statistics import verdict_of

BASE, SENSORS, MOTORS, LEGS = "base", "sensors", "motors", "legs"
_OF_SENSORS = (
    "joint_offset", "imu_tilt", "imu_position", "accelerometer_bias", "accelerometer_gain", "gyro_gain", "clock_offset",
)  # fmt: skip
"""Rows of the parameter table that describe sensors."""
_OF_MOTORS = {
    "coulomb_friction": ("Nm", "speed-independent friction torque, against the motion"),
    "viscous_friction": ("Nm s/rad", "friction torque per speed, against the motion"),
    "stribeck_friction": ("Nm", "friction torque at rest minus coulomb_friction, to which it falls with speed"),
    "armature": ("kg m2", "inertia of the rotor, reflected to the joint"),
    "relative_gain": ("1", "ratio of true to reported torque, over its mean over all motors, minus one"),
    "delay": ("s", "delay from command to torque"),
}
_OF_LINKS = {
    "mass": ("kg", "mass of a link with all links fixed to it"),
    "moment_x": ("kg m", "that mass times x of its CoM, in the frame of its joint"),
    "moment_y": ("kg m", "that mass times y of its CoM"),
    "moment_z": ("kg m", "that mass times z of its CoM"),
    "length": ("m", "distance across the joint's axis to the next joint, or to the middle of the foot"),
}
_IN_COMMON = ("coulomb_friction", "viscous_friction", "armature")
"""Rows of the parameter table for motors that share one value."""


@dataclass(frozen=True)
class Column:
    """Estimates of one kind.

    Attributes:
        part: part of the result that it belongs to, "sensors", "motors" or "legs".
        name: name of the number: "joint_offset", "armature", "link_mass", ...
        unit: SI unit of the values.
        meaning: noun phrase, with sign and frame.
        values: quantities by the model's name of the joint or link, by axis, or by "imu".
    """

    part: str
    name: str
    unit: str
    meaning: str
    values: dict[str, Quantity]

    def number(self, key: str) -> float:
        """Return the value of a joint or an axis; 0 (without effect) if the run did not identify it."""
        return float(self.values[key].value or 0.0) if key in self.values else 0.0

    def identified(self) -> Column:
        """Return the column without the values that are not identified."""
        values = {key: quantity for key, quantity in self.values.items() if quantity.verdict != "not identified"}
        return replace(self, values=values)


def columns_of(result: Calibration, part: str) -> tuple[Column, ...]:
    """Return all columns of a part other than the base, with any verdict; columns without values are left out."""
    found = {SENSORS: _sensors, MOTORS: _motors, LEGS: _links}[part](result)
    return tuple(column for column in found if column.values)


def _links(result: Calibration) -> list[Column]:
    return [
        Column(LEGS, f"link_{name}", unit, meaning, _given(result.links, name))
        for name, (unit, meaning) in _OF_LINKS.items()
    ]


def _sensors(result: Calibration) -> list[Column]:
    rows = [Priors.row(name) for name in _OF_SENSORS]
    return [Column(SENSORS, row.name, row.unit or "1", row.meaning, _of_row(row, result)) for row in rows]


def _of_row(row: Unknown, result: Calibration) -> dict[str, Quantity]:
    """Return the findings of one row of the parameter table, by joint or axis, in the joints' order."""
    pattern = re.compile(re.escape(row.finding).replace(re.escape("{each}"), "(.+)"), re.DOTALL)
    prior = result.settings.get("priors", {}).get(row.name, row.usual)
    found: dict[str, Quantity] = {}
    for finding in result.sensors:
        if match := pattern.fullmatch(finding.name):
            key = match[1] if match.groups() else "imu"
            found[key] = _quantity(row.name, row.unit, finding, prior)
    order = [*result.joint_position, "roll", "pitch", "yaw", *"xyz", "imu"]
    return {key: found[key] for key in order if key in found}


def _quantity(name: str, unit: str, finding: SensorFinding, prior_std: float) -> Quantity:
    return Quantity(name, unit, finding.value, finding.std, verdict_of(finding.std, prior_std))


def _motors(result: Calibration) -> list[Column]:
    return [
        Column(MOTORS, name, unit, meaning, _given(result.motors, name) if result.motors else _in_common(result, name))
        for name, (unit, meaning) in _OF_MOTORS.items()
    ]


def _given(parts: Mapping[str, Part], name: str) -> dict[str, Quantity]:
    found = {each: part.quantities[name] for each, part in parts.items()}
    return {each: quantity for each, quantity in found.items() if quantity.value is not None}


def _in_common(result: Calibration, name: str) -> dict[str, Quantity]:
    """Return the shared value of all joints, for a run that did not estimate motors one by one."""
    findings = {finding.name: finding for finding in result.sensors}
    row = Priors.row(name) if name in _IN_COMMON else None
    if row is None or row.finding not in findings:
        return {}
    finding = findings[row.finding]
    return dict.fromkeys(result.joint_position, _quantity(name, row.unit, finding, abs(finding.value)))
