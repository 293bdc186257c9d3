"""Findings about sensors, motors and legs, in columns of one kind of number each."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from equipoise.estimator.unknown import Unknown
from equipoise.estimator.unknowns import Priors
from equipoise.result.calibration import Calibration
from equipoise.result.findings import Part, SensorFinding
from equipoise.result.quantity import Quantity
from equipoise.result.statistics import verdict_of

BASE, SENSORS, MOTORS, LEGS = "base", "sensors", "motors", "legs"
_OF_SENSORS = (
    "joint_offset", "imu_tilt", "imu_position", "accelerometer_bias", "accelerometer_gain", "gyro_gain", "clock_offset",
)  # fmt: skip
"""Rows of the table of unknowns that are of sensors."""
_OF_MOTORS = {
    "coulomb_friction": ("Nm", "friction torque that does not depend on the speed, against the motion"),
    "viscous_friction": ("Nm s/rad", "friction torque over the speed, against the motion"),
    "stribeck_friction": ("Nm", "friction torque at rest less coulomb_friction, which it falls to with the speed"),
    "armature": ("kg m2", "inertia of the rotor, seen at the joint"),
    "relative_gain": ("1", "true over reported torque, over the mean of that of all motors, less one"),
    "delay": ("s", "age of the command that a torque obeys"),
}
_OF_LINKS = {
    "mass": ("kg", "mass of a link with all that is fixed to it"),
    "moment_x": ("kg m", "the same times x of its CoM, in the frame of its joint"),
    "moment_y": ("kg m", "the same times y of its CoM"),
    "moment_z": ("kg m", "the same times z of its CoM"),
    "length": ("m", "distance across the joint's axis to the next joint, or to the middle of the foot"),
}
_IN_COMMON = {"coulomb_friction": "coulomb_friction", "viscous_friction": "viscous_friction", "armature": "armature"}
"""Rows of the table of unknowns for a motor's number where motors were not estimated one by one."""


@dataclass(frozen=True)
class Column:
    """One kind of number that was found.

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
        """The value of a joint or an axis; 0, which corrects nothing, where the run did not tell it."""
        return float(self.values[key].value or 0.0) if key in self.values else 0.0

    def only(self, wanted: Callable[[Quantity], bool]) -> Column:
        """Return the column with the wanted values alone."""
        return replace(self, values={key: value for key, value in self.values.items() if wanted(value)})


def columns_of(result: Calibration, part: str) -> tuple[Column, ...]:
    """All that a result says of a part but the base, whatever its verdicts; columns without a value are left out."""
    found = {SENSORS: _sensors, MOTORS: _motors, LEGS: _links}[part](result)
    return tuple(column for column in found if column.values)


def _links(result: Calibration) -> list[Column]:
    return [
        Column(LEGS, f"link_{name}", unit, meaning, _known(result.links, name))
        for name, (unit, meaning) in _OF_LINKS.items()
    ]


def _sensors(result: Calibration) -> list[Column]:
    rows = [Priors.row(name) for name in _OF_SENSORS]
    return [Column(SENSORS, row.name, row.unit or "1", row.meaning, _of_row(row, result)) for row in rows]


def _of_row(row: Unknown, result: Calibration) -> dict[str, Quantity]:
    """Return the findings of one row of the table of unknowns, by joint or axis, in the joints' order."""
    pattern = re.compile(re.escape(row.finding).replace(re.escape("{each}"), "(.+)"), re.DOTALL)
    prior = result.settings.get("priors", {}).get(row.name, row.usual)
    found: dict[str, Quantity] = {}
    for finding in result.sensors:
        if match := pattern.fullmatch(finding.name):
            key = match[1] if match.groups() else "imu"
            found[key] = _judged(row.name, row.unit, finding, prior)
    order = [*result.joint_position, "roll", "pitch", "yaw", *"xyz", "imu"]
    return {key: found[key] for key in order if key in found}


def _judged(name: str, unit: str, finding: SensorFinding, beside: float) -> Quantity:
    return Quantity(name, unit, finding.value, finding.std, verdict_of(finding.std, beside))


def _motors(result: Calibration) -> list[Column]:
    return [
        Column(MOTORS, name, unit, meaning, _known(result.motors, name) if result.motors else _in_common(result, name))
        for name, (unit, meaning) in _OF_MOTORS.items()
    ]


def _known(parts: Mapping[str, Part], name: str) -> dict[str, Quantity]:
    found = {each: part.quantities[name] for each, part in parts.items()}
    return {each: quantity for each, quantity in found.items() if quantity.value is not None}


def _in_common(result: Calibration, name: str) -> dict[str, Quantity]:
    """Return one number for all joints, of a run that did not estimate motors one by one."""
    findings = {finding.name: finding for finding in result.sensors}
    row = Priors.row(_IN_COMMON[name]) if name in _IN_COMMON else None
    if row is None or row.finding not in findings:
        return {}
    finding = findings[row.finding]
    return dict.fromkeys(result.joint_position, _judged(name, row.unit, finding, abs(finding.value)))
