"""Scale of a robot: factors for lengths, times and torques relative to an A1."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from equipoise.conventions import GRAVITY

HEAVIEST = 5000.0
"""Mass above any legged robot's [kg]; larger values are in grams."""

_A1_HIP_HEIGHT = 0.312  # [m] at the nominal stance
_A1_TORQUE = 38.0  # m g h there [Nm]


@dataclass(frozen=True)
class Scale:
    """Scale factors of a robot at its stance, relative to an A1 at its own.

    Robots of one build move alike if lengths scale with the hip height h, times with sqrt(h / g), and torques with the
    weight at that height, m g h (Froude's similarity). So a constant that depends on the robot's size is given as its value
    "on an A1", in plain units, and is multiplied by one of these factors. A speed takes length over time, a frequency one
    over time.

    Attributes:
        length: factor on lengths.
        torque: factor on torques, and on gains, friction and armature.
    """

    length: float
    torque: float

    @classmethod
    def of(cls, mass: float, hip_height: float) -> Scale:
        """Return the scale of a robot from its mass [kg] and the height of its hip pitch axes above the floor [m]."""
        return cls(hip_height / _A1_HIP_HEIGHT, mass * GRAVITY * hip_height / _A1_TORQUE)

    @property
    def hip_height(self) -> float:
        """Height of the hip pitch axes above the floor [m]."""
        return self.length * _A1_HIP_HEIGHT

    @property
    def time(self) -> float:
        """Factor on times: the square root of that on lengths."""
        return float(np.sqrt(self.length))
