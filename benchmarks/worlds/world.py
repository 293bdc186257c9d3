"""A simulated robot in one of several engines, with the errors of a preset that the engine supports."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module

from rows import NotTriedError

from equipoise import Payload, RobotModel, nominal_stance, simulate
from equipoise.platform.platform import Platform
from equipoise.robot.inertial import InertialParameters
from equipoise.simulation.drawn_errors import DrawnErrors
from equipoise.simulation.effects import PRESETS
from worlds.torque_driven import TorqueDriven

ENGINES = {"mujoco": "MuJoCo", "dart": "DART", "pybullet": "PyBullet", "drake": "Drake"}
"""Names as they are written, by name."""
_FOREIGN = {"pybullet": "worlds.bullet:BulletPlatform", "drake": "worlds.drake:DrakePlatform"}
"""Platforms of engines outside of the package."""


def _foreign(engine: str) -> type[TorqueDriven]:
    module, _, name = _FOREIGN[engine].partition(":")
    try:
        return getattr(import_module(module), name)
    except ModuleNotFoundError as error:
        raise NotTriedError(f"{error.name} is not installed") from error


def lacking(engine: str, preset: str) -> tuple[str, ...]:
    """Return the effects of a preset that an engine does not support."""
    sizes = PRESETS[preset]
    if engine in _FOREIGN:
        without = set(_foreign(engine).LACKS)
    else:
        without = {row.name for row in sizes.rows() if engine not in row.engines}
    return tuple(row.name for row in sizes.rows() if row.name in without and getattr(sizes, row.name) != row.none)


@contextmanager
def world(
    engine: str, preset: str, robot: RobotModel, payload: Payload, seed: int
) -> Iterator[tuple[Platform, InertialParameters]]:
    """Simulate a standing robot; yield it with its true parameters at the nominal stance, from the engine's own bodies."""
    without = lacking(engine, preset)
    if engine not in _FOREIGN:
        with simulate(robot, preset, payload, seed, engine=engine, disabled_effects=without) as simulation:
            yield simulation.platform, simulation.truth.composite
        return
    stance = nominal_stance(robot)
    sizes = PRESETS[preset].scaled_to(stance.scale).without_effects(without)
    errors = DrawnErrors.draw(sizes, len(robot.joint_names), seed)
    with _foreign(engine)(robot, stance, errors, payload) as platform:
        yield platform, platform.truth(stance.joint_position)
