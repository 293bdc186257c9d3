"""What a study is: settings and a trial's number give the same robot, payload and noise, wherever it runs."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from equipoise.errors import SettingsError
from equipoise.method.method import Method
from equipoise.method.table import METHODS
from equipoise.paper.method import Paper
from equipoise.robot.catalog import load_robot
from equipoise.robot.description import RobotDescription
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance, nominal_stance
from equipoise.robot.variation import LARGEST_SPREAD, vary
from equipoise.simulation.payload import Payload
from equipoise.simulation.sensors import PRESETS, Noise, SensorErrors

SOURCES = tuple(f.name for f in dataclasses.fields(SensorErrors) if f.name != "floor_friction")
"""What a simulated robot can be wrong in."""

# Random payloads: 5 to 30 % of the base's mass, in a box on its back, as large as a battery and a computer.
_PAYLOAD_SHARE = (0.05, 0.30)
_PAYLOAD_BOX = ((-0.12, 0.12), (-0.05, 0.05), (0.03, 0.12))  # [m] on an A1
_PAYLOAD_GYRATION = (0.08, 0.12, 0.10)  # [m] on an A1


@dataclass(frozen=True)
class Study:
    """What is drawn for each trial, and what is done with it.

    Attributes:
        robot: name or model file of the robot.
        methods: methods that calibrate each drawn robot, with settings; each on a fresh simulation of it with the same
            noise.
        noise: name of a noise preset, scaled to the robot's m g h.
        only: error sources that are kept, all others being left out; empty: all of the preset.
        vary_noise: each source's size is multiplied by its own random factor between 0 and 2, so that a study shows what
            each source does.
        payload: "random", "none", or MASS,X,Y,Z[,IXX,IYY,IZZ].
        spread: of random robots around the model (see `robot.variation`); 0: always the model itself.
        scale_error: the robot is weighed with this relative error, for the methods that use it; None: it is not weighed.
        timestep: of the engine [s]; None: the largest that leaves a method's results as they are.
        seed: seed of everything drawn.
        description: facts that the user overrides in the model file.
    """

    robot: str = "unitree_a1"
    methods: tuple[Method, ...] = (Paper(),)
    noise: Noise = "realistic"
    only: tuple[str, ...] = ()
    vary_noise: bool = False
    payload: str = "random"
    spread: float = 0.0
    scale_error: float | None = None
    timestep: float | None = None
    seed: int = 0
    description: RobotDescription = field(default_factory=RobotDescription)

    def __post_init__(self) -> None:
        self._check_methods()
        if self.noise not in PRESETS:
            raise SettingsError(f"noise {self.noise!r} is not known; it is one of {', '.join(PRESETS)}")
        if unknown := [name for name in self.only if name not in SOURCES]:
            raise SettingsError(f"{unknown[0]!r} is no error source; those are {', '.join(SOURCES)}")
        if self.payload not in ("random", "none"):
            Payload.parse(self.payload)
        if self.seed < 0:
            raise SettingsError(f"the seed is {self.seed}; it must be zero or more")
        if not 0 <= self.spread <= LARGEST_SPREAD:
            raise SettingsError(
                f"the spread of random robots is {self.spread:g}; it must be from 0 to {LARGEST_SPREAD:g}"
            )
        if self.scale_error is not None and not 0 < self.scale_error < 1:
            raise SettingsError(f"the scale's error is {self.scale_error:g}; give a fraction, as 0.005 for 0.5 %")
        if self.timestep is not None and not 0 < self.timestep < math.inf:
            raise SettingsError(f"the time step is {self.timestep:g} s; it must be positive, as 0.001")
        if "imu_clock_offset" in self.only and "sensor_delay" not in self.only:
            raise SettingsError(
                "imu_clock_offset alone would be none: without a delay IMU samples would be younger than the moment at which "
                "they are read; keep sensor_delay too"
            )

    def _check_methods(self) -> None:
        if not self.methods:
            raise SettingsError(f"name a method at least: {', '.join(METHODS)}")
        names = [method.name for method in self.methods]
        if len(set(names)) < len(names):
            raise SettingsError(f"each method once, not {', '.join(names)}")

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        methods = [method.to_dict() for method in self.methods]
        return {**dataclasses.asdict(self), "methods": methods, "only": list(self.only)}

    @property
    def fingerprint(self) -> str:
        """Tells studies apart: trials of one fingerprint belong together. A model file counts by what it says."""
        table = self.to_dict()
        if Path(self.robot).is_file():
            table["model"] = hashlib.sha256(Path(self.robot).read_bytes()).hexdigest()
        return hashlib.sha256(json.dumps(table, sort_keys=True).encode()).hexdigest()[:16]


@dataclass(frozen=True, eq=False)
class Draw:
    """One trial's robot and its errors.

    Attributes:
        robot: model that the estimator knows.
        stance: nominal stance of that model.
        payload: payload that it does not know, or None.
        sizes: sizes of the simulated robot's sensor and actuator errors.
        seed: seed of the simulation: the errors themselves, and the noise.
        scale_reading: relative error of the scale's reading, or None.
    """

    robot: RobotModel
    stance: Stance
    payload: Payload | None
    sizes: SensorErrors
    seed: int
    scale_reading: float | None


def draw(study: Study, trial: int) -> Draw:
    """What trial number `trial` of a study is. Depends on nothing else: each number has a random stream of its own."""
    stream = np.random.SeedSequence(study.seed, spawn_key=(trial,))
    # One stream for each thing that is drawn, so that switching one off leaves the others as they were.
    robots, payloads, sizes, scales, noise = (np.random.default_rng(child) for child in stream.spawn(5))
    robot, stance = nominal_robot(study)
    if study.spread:
        robot = vary(robot, study.spread, robots)
        stance = nominal_stance(robot)
    return Draw(
        robot,
        stance,
        _payload(study.payload, robot, stance, payloads),
        _sizes(study, robot, stance, sizes),
        int(noise.integers(2**62)),
        None if study.scale_error is None else study.scale_error * float(scales.standard_normal()),
    )


def nominal_robot(study: Study) -> tuple[RobotModel, Stance]:
    """A study's robot as its model file has it, and its stance; they are shared by all who ask."""
    return _load(study.robot, json.dumps(dataclasses.asdict(study.description)))


@lru_cache(maxsize=8)  # a worker runs many trials of one robot
def _load(robot: str, description: str) -> tuple[RobotModel, Stance]:
    model = load_robot(robot, RobotDescription.from_dict(json.loads(description)))
    return model, nominal_stance(model)


def _payload(wanted: str, robot: RobotModel, stance: Stance, generator: np.random.Generator) -> Payload | None:
    if wanted == "none":
        return None
    if wanted != "random":
        return Payload.parse(wanted)
    size = stance.scale.length
    mass = generator.uniform(*_PAYLOAD_SHARE) * float(robot.pinocchio.inertias[1].mass)
    place = [size * generator.uniform(*bounds) for bounds in _PAYLOAD_BOX]
    inertia = mass * (size * np.array(_PAYLOAD_GYRATION)) ** 2
    return Payload.parse(",".join(repr(float(value)) for value in (mass, *place, *inertia)))


def _sizes(study: Study, robot: RobotModel, stance: Stance, generator: np.random.Generator) -> SensorErrors:
    sizes = PRESETS[study.noise].scaled_to(stance.scale)
    factors = generator.uniform(0, 2, len(SOURCES)) if study.vary_noise else np.ones(len(SOURCES))
    kept = study.only or SOURCES
    changed = {name: getattr(sizes, name) * float(f) * (name in kept) for name, f in zip(SOURCES, factors, strict=True)}
    # The IMU's clock may not lead the moment at which it is read.
    changed["imu_clock_offset"] = min(changed["imu_clock_offset"], changed["sensor_delay"])
    return dataclasses.replace(sizes, **changed)
