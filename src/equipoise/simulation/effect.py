"""Effects: the ways in which a simulated robot differs from its model file, each a row of the table in `effects.py`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.robot.scale import Scale

ROW = "effect"
"""Key of a row among the metadata of its field."""


PARTS: Mapping[str, Callable[[int], int]] = {
    "robot": lambda joints: 1,
    "joint": lambda joints: joints,
    "joint, two directions": lambda joints: 2 * joints,
    "leg link, three axes": lambda joints: 3 * joints,
    "kind of leg link": lambda joints: max(joints // 4, 1),
    "kind of leg link, three axes": lambda joints: 3 * max(joints // 4, 1),
    "leg": lambda joints: 4,
    "leg, three axes": lambda joints: 12,
    "axis": lambda joints: 3,
    "pair of axes": lambda joints: 6,
}
"""Kinds of parts with a drawn value each: their number on a robot with a number of leg joints."""

LAWS: Mapping[str, Callable[[np.random.Generator, float, int], FloatArray]] = {
    "exact": lambda generator, size, count: np.full(count, size),
    "rms": lambda generator, size, count: size * generator.standard_normal(count),
    "rms of a factor's logarithm": lambda generator, size, count: np.exp(size * generator.standard_normal(count)),
    "half width": lambda generator, size, count: size * generator.uniform(-1, 1, count),
    "exact, its direction drawn": lambda generator, size, count: generator.uniform(0, 2 * np.pi, count),  # angles [rad]
}
"""Meaning of a size, and the values that a generator draws with it, as many as there are parts."""

MEASURES: Mapping[str, Callable[[Scale], float]] = {
    "": lambda scale: 1.0,
    "torque": lambda scale: scale.torque,
    "length": lambda scale: scale.length,
    "mass": lambda scale: scale.torque / scale.length,
    "force": lambda scale: scale.torque / scale.length,
    "force over length": lambda scale: scale.torque / scale.length**2,
}
"""Quantity with which an effect's size grows, and its factor on a robot other than an A1; "": the same on all robots."""

ALL_ENGINES = ("mujoco", "dart")
MUJOCO = ("mujoco",)


@dataclass(frozen=True)
class Effect:
    """Row of the table.

    Attributes:
        meaning: noun phrase, with sign and frame.
        unit: SI unit; empty for a fraction.
        each: part of the robot that has one each, of `PARTS`.
        law: law by which values are drawn, of `LAWS`.
        source: reason for the size.
        name: name in code, in settings and as a flag.
        realistic: size in the preset `realistic`, on an A1.
        stress: size in the preset `stress`, on an A1; default: that in `realistic`.
        alone: size when it is simulated alone, on an A1; default: that in `stress`.
        none: size without such an effect.
        measure: quantity that the size grows with, of `MEASURES`.
        inverse: whether a larger number is a smaller effect, as a spring's stiffness is.
        signed: whether a size may be negative.
        most: largest size, and the reason.
        varied: whether studies vary it; effects that every robot has are not varied.
        engines: engines that support it.
    """

    meaning: str
    unit: str
    each: str
    law: str
    source: str
    name: str = ""
    realistic: float = 0.0
    stress: float | None = None
    alone: float | None = None
    none: float = 0.0
    measure: str = ""
    inverse: bool = False
    signed: bool = False
    most: tuple[float, str] = (np.inf, "")
    varied: bool = True
    engines: tuple[str, ...] = ALL_ENGINES

    def drawn(self, generator: np.random.Generator, size: float, joints: int) -> FloatArray:
        """Return the values of a robot with a number of leg joints."""
        return LAWS[self.law](generator, size, PARTS[self.each](joints))

    def scaled(self, size: float, scale: Scale) -> float:
        """Return the size on a robot of a scale, given that on an A1."""
        return size * MEASURES[self.measure](scale)

    @property
    def in_stress(self) -> float:
        """Size in the preset `stress`, on an A1."""
        return self.realistic if self.stress is None else self.stress

    @property
    def size_alone(self) -> float:
        """Size when it is simulated alone, on an A1."""
        return self.in_stress if self.alone is None else self.alone

    def amount(self, size: float) -> float:
        """Return the amount of the effect at a size: the reciprocal for a spring or a filter."""
        if not self.inverse:
            return float(size)
        return 1 / size if size else 0.0

    def times(self, size: float, factor: float) -> float:
        """Return the size of a multiple of the effect."""
        if not self.inverse:
            return size * factor
        return size / factor if factor else self.none


def effect(meaning: str, unit: str, each: str, law: str, source: str, **more: Any) -> Any:
    """Return a row of the table as a field; the arguments are those of `Effect`."""
    row = Effect(meaning, unit, each, law, source, **more)
    return field(default=row.none, metadata={ROW: row})


def exact(meaning: str, unit: str, source: str, **more: Any) -> Any:
    """Return the row of an effect that a robot has once, exactly of its size."""
    return effect(meaning, unit, "robot", "exact", source, **more)


def rms(meaning: str, unit: str, each: str, source: str, **more: Any) -> Any:
    """Return the row of an effect that is drawn for each part from a normal distribution."""
    return effect(meaning, unit, each, "rms", source, **more)
