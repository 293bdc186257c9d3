"""Simulated robots of the benchmarks: drawn payloads, the scale, and the row of a result."""

from __future__ import annotations

from functools import cache

import numpy as np
from rows import Row

from equipoise import Calibration, RobotModel, load_robot, nominal_stance

FIRST_SEED = 30_000
"""First seed of all pages; seeds below 10,000 are for development."""
SCALE_ERROR = 0.005
"""Standard deviation of a scale's reading, as a fraction."""


@cache
def robot_called(name: str) -> RobotModel:
    """Return a robot of the catalogue or of a file, once for each process."""
    return load_robot(name)


def payload_of(robot: RobotModel, generator: np.random.Generator) -> str:
    """Draw a payload of 5 to 30 % of the base's mass on the back, of random position and size, as text of `--payload`."""
    size = nominal_stance(robot).scale.length
    mass = generator.uniform(0.05, 0.30) * float(robot.pinocchio.inertias[1].mass)
    at = size * np.array(
        [generator.uniform(-0.12, 0.12), generator.uniform(-0.05, 0.05), generator.uniform(0.03, 0.12)]
    )
    inertia = mass * (size * np.array([0.08, 0.12, 0.10])) ** 2
    return ",".join(f"{value:.6g}" for value in (mass, *at, *inertia))


def weighed(mass: float, generator: np.random.Generator) -> float:
    """Return a scale's reading of a mass [kg]."""
    return mass * (1 + SCALE_ERROR * generator.standard_normal())


def judged(result: Calibration) -> Row:
    """Return the row of a result with its truth: all ten values of the whole robot, intervals and failed checks."""
    body = list(result.composite)
    return {
        "truth": [quantity.truth for quantity in body],
        "error": [quantity.error for quantity in body],
        "sd": [quantity.std for quantity in body],
        "holds": [not quantity.missed for quantity in body],
        "file_error": [quantity.model - quantity.truth for quantity in body],
        "alarms": [check.name for check in result.checks if not check.passed],
        "robot_time": sum(trial.duration for trial in result.trials),
    }
