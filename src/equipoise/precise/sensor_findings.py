"""What was found wrong with the sensors, in words: people can fix most of it."""

from __future__ import annotations

import numpy as np

from equipoise.precise.posterior import Posterior
from equipoise.result.findings import SensorFinding
from equipoise.robot.model import RobotModel

_SURE = 3.0  # standard deviations from zero


def sensor_findings(robot: RobotModel, posterior: Posterior) -> list[SensorFinding]:
    """Every nuisance parameter of the estimate, the surest first."""
    unknowns, x = posterior.unknowns, posterior.x
    findings: list[SensorFinding] = []

    def add(name: str, block: str, index: int, least: float, sentence: str) -> None:
        value = float(unknowns.value(x, block)[index])
        deviation = float(posterior.deviation(block)[index])
        notable = abs(value) > _SURE * deviation and abs(value) > least
        findings.append(
            SensorFinding(name, value, deviation, sentence.format(value=value, deviation=deviation), notable)
        )

    def add_angle(name: str, block: str, index: int, least: float, sentence: str) -> None:
        value = float(np.degrees(unknowns.value(x, block)[index]))
        deviation = float(np.degrees(posterior.deviation(block)[index]))
        add(name, block, index, least, f"{sentence} by {value:+.2f} deg (sd {deviation:.2f})")

    for index, joint in enumerate(robot.joint_names):
        add_angle(f"{joint} zero", "joint_zero", index, 4e-3, f"{joint}: the encoder's zero is off")
    for index, word in enumerate(("rolled", "pitched", "yawed")):
        add_angle(f"IMU {word}", "imu_tilt", index, 4e-3, f"the IMU is {word}")
    for index, axis in enumerate("xyz"):
        add(f"accelerometer bias {axis}", "accelerometer_bias", index, 0.05,
            f"the accelerometer's {axis} reads {{value:+.3f}} m/s2 too much (sd {{deviation:.3f}})")  # fmt: skip
    add("clock offset", "clock_offset", 0, 1e-3, _clock_sentence(unknowns.value(x, "clock_offset")[0]))
    add("foot radius", "foot_radius", 0, 0.03, "the feet roll as if their radius were {value:+.1%} off the model's")
    for index, axis in enumerate("xy"):
        add_angle(f"floor slope {axis}", "floor_slope", index, 8e-3, f"the floor leans along {axis}")
    if posterior.torque_chi is not None:
        for index, joint in enumerate(robot.joint_names):
            add(f"{joint} torque gain", "torque_gain", index, 0.05,
                f"{joint}: the true torque is {{value:+.1%}} off the reported one (sd {{deviation:.1%}})")  # fmt: skip
        for name, unit in (("coulomb", "Nm"), ("viscous", "Nm s/rad"), ("armature", "kg m2")):
            add(f"{name} of the joints", name, 0, np.inf, f"{name} of the joints: {{value:.3f}} {unit}")
    return sorted(findings, key=lambda finding: -abs(finding.value) / finding.deviation)


def _clock_sentence(value: float) -> str:
    later = "younger" if value > 0 else "older"
    return f"IMU samples are {abs(value) * 1000:.2f} ms {later} than joint samples of the same stamp"
