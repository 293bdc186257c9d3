"""Accuracy goals of a calibration by the Bayesian method."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from equipoise.conventions import FloatArray

if TYPE_CHECKING:
    from equipoise.robot.stance import Stance


@dataclass(frozen=True)
class Goals:
    """Posterior standard deviations at which a calibration may stop, for an A1; lengths scale with the leg.

    Attributes:
        com_planar, com_height: [m].
        mass: as a fraction.
        inertia: moments, each as a fraction of itself.
        products: as a fraction of Ixx.
    """

    com_planar: float = 0.25e-3
    com_height: float = 0.5e-3
    mass: float = 0.012
    inertia: float = 0.01
    products: float = 0.01

    def vector(self, body: FloatArray, stance: Stance) -> FloatArray:
        """Return the (10,) goals of a body in the order of COMPONENTS."""
        lengths = stance.scale.length * np.array([self.com_planar, self.com_planar, self.com_height])
        return np.concatenate(
            [[self.mass * body[0]], lengths, self.inertia * body[4:7], np.full(3, self.products * body[4])]
        )
