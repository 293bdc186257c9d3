"""Scale of a robot: factors for lengths, times and torques that were tried on an A1."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from equipoise.conventions import GRAVITY

HEAVIEST = 5000.0
"""Mass above any legged robot's [kg]; more than this is in grams."""

_A1_HIP_HEIGHT = 0.312  # [m] at the nominal stance
_A1_TORQUE = 38.0  # m g h there [Nm]


@dataclass(frozen=True)
class Scale:
    """A robot at a stance, over an A1 at its own: three factors, one each on an A1.

    Robots of one build move alike if lengths go with the height h of their hips, times with that of a pendulum as long,
    sqrt(h / g), and torques with their weight at that height, m g h: gravity, which all share, allows nothing else (Froude's
    similarity). So a constant that depends on how large a robot is stands in the code as what was tried on an A1, in plain
    units, with the words "on an A1", and is multiplied by one of these where it is used. A speed takes length over
    time, a frequency one over time.

    Attributes:
        length: factor on lengths.
        torque: factor on torques, and on what gives one: gains, friction, armature.
    """

    length: float
    torque: float

    @classmethod
    def of(cls, mass: float, hip_height: float) -> Scale:
        """Return the scale of a robot of a mass [kg] whose hip pitch axes are so high above the floor [m]."""
        return cls(hip_height / _A1_HIP_HEIGHT, mass * GRAVITY * hip_height / _A1_TORQUE)

    @property
    def time(self) -> float:
        """Factor on times: the square root of that on lengths."""
        return float(np.sqrt(self.length))
