"""Effects: the ways in which a simulated robot differs from its model file, each a row of the table in `effects.py`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.robot.scale import Scale

Function = TypeVar("Function")
ROW = "effect"
"""Key of a row among the metadata of its field."""


@dataclass(frozen=True)
class NamedFunction(Generic[Function]):
    """A function with a name in words.

    Attributes:
        name: name in words.
        of: function itself.
    """

    name: str
    of: Function


PartOfRobot = NamedFunction[Callable[[int], int]]
"""A kind of part of which each has its own drawn value: number of them, of a robot with so many leg joints."""
Law = NamedFunction[Callable[[np.random.Generator, float, int], FloatArray]]
"""Meaning of a size, and the values that a generator draws with it: of a size, as many as there are parts."""
Magnitude = NamedFunction[Callable[[Scale], float]]
"""Factor of an effect's size on a robot other than an A1; without a name it is the same on all robots."""

ROBOT = PartOfRobot("robot", lambda joints: 1)
JOINT = PartOfRobot("joint", lambda joints: joints)
JOINT_DIRECTION = PartOfRobot("joint, two directions", lambda joints: 2 * joints)
LINK_DIRECTION = PartOfRobot("leg link, along and twice across", lambda joints: 3 * joints)
LINK_KIND = PartOfRobot("kind of leg link", lambda joints: max(joints // 4, 1))
LINK_KIND_DIRECTION = PartOfRobot("kind of leg link, along and twice across", lambda joints: 3 * max(joints // 4, 1))
LEG = PartOfRobot("leg", lambda joints: 4)
LEG_DIRECTION = PartOfRobot("leg, three axes", lambda joints: 12)
AXIS = PartOfRobot("axis", lambda joints: 3)
AXIS_PAIR = PartOfRobot("pair of axes", lambda joints: 6)

EXACT = Law("exact", lambda generator, size, count: np.full(count, size))
NORMAL = Law("rms", lambda generator, size, count: size * generator.standard_normal(count))
FACTOR = Law(
    "rms of a factor's logarithm", lambda generator, size, count: np.exp(size * generator.standard_normal(count))
)
UNIFORM = Law("half width", lambda generator, size, count: size * generator.uniform(-1, 1, count))
AZIMUTH = Law("exact, its direction drawn", lambda generator, size, count: generator.uniform(0, 2 * np.pi, count))
"""The values are angles, whatever the size [rad]."""

SAME = Magnitude("", lambda scale: 1.0)
TORQUE = Magnitude("torque", lambda scale: scale.torque)
LENGTH = Magnitude("length", lambda scale: scale.length)
MASS = Magnitude("mass", lambda scale: scale.torque / scale.length)
STIFFNESS = Magnitude("force over length", lambda scale: scale.torque / scale.length**2)

ALL_ENGINES = ("mujoco", "dart")
MUJOCO = ("mujoco",)


@dataclass(frozen=True)
class Effect:
    """A row of the table.

    Attributes:
        meaning: noun phrase, with sign and frame.
        unit: SI unit; empty for a fraction.
        each: parts of the robot that have one each, as its joints.
        law: law by which values are drawn.
        source: reason for the size.
        name: name in code, in settings and as a flag.
        realistic: size in the preset `realistic`, on an A1.
        stress: size in the preset `stress`, on an A1; default: that in `realistic`.
        alone: size that it is tried with alone, on an A1; default: that in `stress`.
        none: size without such an effect.
        measure: quantity that the size grows with.
        inverse: whether a larger number is a smaller effect, as a spring's stiffness is.
        varied: whether studies vary it; what a robot cannot be without is not.
        engines: engines that have it.
    """

    meaning: str
    unit: str
    each: PartOfRobot
    law: Law
    source: str
    name: str = ""
    realistic: float = 0.0
    stress: float | None = None
    alone: float | None = None
    none: float = 0.0
    measure: Magnitude = SAME
    inverse: bool = False
    varied: bool = True
    engines: tuple[str, ...] = ALL_ENGINES

    @property
    def in_stress(self) -> float:
        """Size in the preset `stress`, on an A1."""
        return self.realistic if self.stress is None else self.stress

    @property
    def by_itself(self) -> float:
        """Return the size that it is tried with alone, on an A1."""
        return self.in_stress if self.alone is None else self.alone

    def amount(self, size: float) -> float:
        """Return the amount of the effect at a size: of a spring or a filter, one over it."""
        if not self.inverse:
            return float(size)
        return 1 / size if size else 0.0

    def times(self, size: float, factor: float) -> float:
        """The size of so many times the effect."""
        if not self.inverse:
            return size * factor
        return size / factor if factor else self.none


def effect(meaning: str, unit: str, each: PartOfRobot, law: Law, source: str, **more: Any) -> Any:
    """A row of the table as a field; the arguments are those of `Effect`."""
    row = Effect(meaning, unit, each, law, source, **more)
    return field(default=row.none, metadata={ROW: row})
