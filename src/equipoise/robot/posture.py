"""Posture of the base of a standing robot, relative to its nominal stance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from equipoise.conventions import FloatArray


@dataclass(frozen=True)
class BodyPosture:
    """Posture of the base, relative to the nominal stance.

    Attributes:
        roll, pitch, yaw: orientation of the base; intrinsic z-y'-x'' angles [rad].
        crouch: lowering of the CoM, over the hip height.
        ahead, aside: displacement of the CoM, forward from the feet's middle, and to the left of the nominal stance's,
            over the hip height.
    """

    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0
    crouch: float = 0.0
    ahead: float = 0.0
    aside: float = 0.0

    @property
    def rotation(self) -> FloatArray:
        """(3, 3) rotation of the base."""
        return np.array(pin.rpy.rpyToMatrix(np.array([self.roll, self.pitch, self.yaw])))
