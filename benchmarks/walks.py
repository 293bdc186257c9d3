"""Simulated walks with a payload, and their tables as other programs write them."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from equipoise import Payload, Recording, RobotModel, nominal_stance
from equipoise.lab.gaits.crawl import crawl
from equipoise.lab.gaits.trot import trot
from equipoise.robot.inertial import InertialParameters

GAITS = {"trot": trot, "crawl": crawl}


def payload_on_trunk(robot: RobotModel, seed: int, mass: float | None = None) -> Payload:
    """Return a payload at a random position on the trunk, by default of a twelfth of the robot's mass."""
    generator, stance = np.random.default_rng([seed, 78]), nominal_stance(robot)
    half = np.abs(stance.feet_in_base[:, :2]).mean(axis=0)
    place = [*(generator.uniform(-0.4, 0.4, 2) * half), generator.uniform(0.1, 0.3) * stance.hip_height]
    return Payload(InertialParameters(mass or 0.08 * robot.mass, np.array(place), np.zeros((3, 3))))


def write_table(recording: Recording, file: Path) -> None:
    """Write a table with the standard columns of logs."""
    joints, imu = recording.joints, recording.imu
    signals = [f"{signal}.{joint}" for signal in ("position", "velocity", "torque") for joint in recording.joint_names]
    sensors = [f"{sensor}.{axis}" for sensor in ("gyro", "accelerometer") for axis in "xyz"]
    rows = (
        joints.time, joints.position, joints.velocity, joints.torque, imu.angular_velocity_in_imu, imu.acceleration_in_imu,
    )  # fmt: skip
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(["time", *signals, *sensors])
        writer.writerows(np.column_stack(rows).tolist())
