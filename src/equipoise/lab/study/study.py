"""Definition of a study: settings and trial number determine robot, payload and noise on any machine."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from equipoise.errors import SettingsError
from equipoise.method.method import Method
from equipoise.method.table import METHODS
from equipoise.paper.method import PaperMethod
from equipoise.robot.catalog import load_robot
from equipoise.robot.description import RobotDescription
from equipoise.robot.model import RobotModel
from equipoise.robot.scale import Scale
from equipoise.robot.stance import Stance, nominal_stance
from equipoise.simulation.drawn_errors import named_generator
from equipoise.simulation.effects import Contacts, EffectSizes, Noise, sizes_of
from equipoise.simulation.payload import Payload

SOURCES = tuple(row.name for row in EffectSizes.rows() if row.varied)
"""Error sources of a simulated robot."""
# The first ones share a random stream. All others have one each, so that a new source does not change other draws.
_ONE_STREAM = SOURCES[: SOURCES.index("floor_slope") + 1]

# Random payloads: 5 to 30 % of the base's mass in a box on its back, with the size of a battery and a computer.
_PAYLOAD_SHARE = (0.05, 0.30)
_PAYLOAD_BOX = ((-0.12, 0.12), (-0.05, 0.05), (0.03, 0.12))  # [m] on an A1
_PAYLOAD_GYRATION = (0.08, 0.12, 0.10)  # [m] on an A1


@dataclass(frozen=True)
class Study:
    """Distribution of the trials, and the methods to run.

    Attributes:
        robot: name or model file of the robot.
        methods: methods with settings, each on a new simulation of each drawn robot with the same noise.
        preset: name of a preset of effects, scaled to the robot.
        effects: additional effects or other sizes, as in `simulate`.
        disabled_effects: names of effects that are left out.
        contact_model: contact model of the feet, as in `simulate`.
        only: effects to keep, without all others; empty: all.
        vary_effects: true to multiply the size of each effect by a random factor from 0 to 2, which gives its slope.
        payload: "random", "none", or MASS,X,Y,Z[,IXX,IYY,IZZ].
        timestep: time step of the engine [s]; None: the default of each method.
        seed: seed of everything drawn.
        description: robot configuration.
    """

    robot: str = "unitree_a1"
    methods: tuple[Method, ...] = (PaperMethod(),)
    preset: Noise = "realistic"
    effects: Mapping[str, float | None] = field(default_factory=dict[str, "float | None"])
    disabled_effects: tuple[str, ...] = ()
    contact_model: Contacts = "default"
    only: tuple[str, ...] = ()
    vary_effects: bool = False
    payload: str = "random"
    timestep: float | None = None
    seed: int = 0
    description: RobotDescription = field(default_factory=RobotDescription)

    def __post_init__(self) -> None:
        if not self.methods:
            raise SettingsError(f"a study needs at least one method of {', '.join(METHODS)}")
        names = [method.name for method in self.methods]
        if len(set(names)) < len(names):
            raise SettingsError(f"the methods are {', '.join(names)}; name each method once")
        sizes_of(self.preset, Scale(1.0, 1.0), self.effects, self.disabled_effects)
        if unknown := [name for name in self.only if name not in SOURCES]:
            raise SettingsError(f"{unknown[0]!r} is not an error source; use {', '.join(SOURCES)}")
        if self.payload not in ("random", "none"):
            Payload.parse(self.payload)
        if self.seed < 0:
            raise SettingsError(f"the seed is {self.seed}; it must be zero or more")
        if self.timestep is not None and not 0 < self.timestep < math.inf:
            raise SettingsError(f"the time step is {self.timestep:g} s; it must be positive, for example 0.001")
        if "imu_clock_offset" in self.only and "sensor_delay" not in self.only:
            raise SettingsError(
                "imu_clock_offset has no effect without sensor_delay, because IMU samples cannot be newer than the time at "
                "which they are read; add sensor_delay to --only-effects"
            )

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        table = dataclasses.asdict(self)
        methods = [method.to_dict() for method in self.methods]
        return {**table, "methods": methods, "only": list(self.only), "disabled_effects": list(self.disabled_effects)}

    @property
    def fingerprint(self) -> str:
        """Hash of the definition and of the content of a model file: equal fingerprints are the same study."""
        table = self.to_dict()
        if Path(self.robot).is_file():
            table["model"] = hashlib.sha256(Path(self.robot).read_bytes()).hexdigest()
        return hashlib.sha256(json.dumps(table, sort_keys=True).encode()).hexdigest()[:16]


@dataclass(frozen=True, eq=False)
class Draw:
    """Robot of a trial, and its errors.

    Attributes:
        robot: model for the estimator.
        stance: nominal stance of that model.
        payload: payload of the simulated robot only, or None.
        sizes: sizes of the simulated robot's sensor and actuator errors.
        seed: seed of the simulation, for errors and noise.
    """

    robot: RobotModel
    stance: Stance
    payload: Payload | None
    sizes: EffectSizes
    seed: int


def draw(study: Study, trial: int) -> Draw:
    """Return the draw of a trial, which depends only on the study and the trial's number."""
    stream = np.random.SeedSequence(study.seed, spawn_key=(trial,))
    # Separate streams, so that disabling one draw does not change the others. The first and the fourth are unused.
    _, payloads, sizes, _, noise = (np.random.default_rng(child) for child in stream.spawn(5))
    robot, stance = nominal_robot(study)
    return Draw(
        robot,
        stance,
        _payload(study.payload, robot, stance, payloads),
        _sizes(study, robot, stance, sizes),
        int(noise.integers(2**62)),
    )


def nominal_robot(study: Study) -> tuple[RobotModel, Stance]:
    """Return the model of a study's robot and its stance, shared between callers."""
    return _load(study.robot, json.dumps(dataclasses.asdict(study.description)))


@lru_cache(maxsize=8)  # a worker runs many trials of one robot
def _load(robot: str, description: str) -> tuple[RobotModel, Stance]:
    model = load_robot(robot, RobotDescription.from_dict(json.loads(description)))
    return model, nominal_stance(model)


def _payload(text: str, robot: RobotModel, stance: Stance, generator: np.random.Generator) -> Payload | None:
    if text == "none":
        return None
    if text != "random":
        return Payload.parse(text)
    size = stance.scale.length
    mass = generator.uniform(*_PAYLOAD_SHARE) * float(robot.pinocchio.inertias[1].mass)
    place = [size * generator.uniform(*bounds) for bounds in _PAYLOAD_BOX]
    inertia = mass * (size * np.array(_PAYLOAD_GYRATION)) ** 2
    return Payload.parse(",".join(repr(float(value)) for value in (mass, *place, *inertia)))


def _sizes(study: Study, robot: RobotModel, stance: Stance, generator: np.random.Generator) -> EffectSizes:
    sizes = sizes_of(study.preset, stance.scale, study.effects, study.disabled_effects)
    factors = _factors(generator) if study.vary_effects else dict.fromkeys(SOURCES, 1.0)
    kept = study.only or SOURCES
    rows = {name: sizes.row(name) for name in SOURCES}
    changed = {n: row.times(getattr(sizes, n), factors[n]) if n in kept else row.none for n, row in rows.items()}
    # IMU samples cannot be newer than the time at which they are read.
    changed["imu_clock_offset"] = min(changed["imu_clock_offset"], changed["sensor_delay"])
    return dataclasses.replace(sizes, **changed)


def _factors(generator: np.random.Generator) -> dict[str, float]:
    """Return a random factor for each source."""
    factors = dict(zip(_ONE_STREAM, generator.uniform(0, 2, len(_ONE_STREAM)).tolist(), strict=True))
    seed = int(generator.integers(2**62))
    others = {name: named_generator(seed, name).uniform(0, 2) for name in SOURCES if name not in _ONE_STREAM}
    return factors | {name: float(factor) for name, factor in others.items()}
