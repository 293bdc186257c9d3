"""A simulated robot in any of three engines, with the errors of a preset as far as the engine can have them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from equipoise import Payload, RobotModel, nominal_stance, simulate
from equipoise.platform.platform import Platform
from equipoise.robot.inertial import InertialParameters
from equipoise.simulation.drawn_errors import DrawnErrors
from equipoise.simulation.effects import PRESETS

ENGINES = {"mujoco": "MuJoCo", "dart": "DART", "pybullet": "PyBullet"}
"""Names as they are written, by name."""


def lacking(engine: str, preset: str) -> tuple[str, ...]:
    """Effects of a preset that an engine cannot have."""
    sizes = PRESETS[preset]
    if engine == "pybullet":
        from worlds.bullet import BulletPlatform  # noqa: PLC0415 - rows of other engines need no PyBullet

        without = set(BulletPlatform.LACKS)
    else:
        without = {row.name for row in sizes.rows() if engine not in row.engines}
    return tuple(row.name for row in sizes.rows() if row.name in without and getattr(sizes, row.name) != row.none)


@contextmanager
def world(
    engine: str, preset: str, robot: RobotModel, payload: Payload, seed: int
) -> Iterator[tuple[Platform, InertialParameters]]:
    """A standing robot, and what it is, whole, at its nominal stance, by the engine's own bodies."""
    without = lacking(engine, preset)
    if engine != "pybullet":
        with simulate(robot, preset, payload, seed, engine=engine, disabled_effects=without) as simulation:
            yield simulation.platform, simulation.truth.composite
        return
    from worlds.bullet import BulletPlatform  # noqa: PLC0415

    stance = nominal_stance(robot)
    sizes = PRESETS[preset].scaled_to(stance.scale).without_effects(without)
    with BulletPlatform(robot, stance, DrawnErrors.draw(sizes, len(robot.joint_names), seed), payload) as platform:
        yield platform, platform.truth(stance.joint_position)
