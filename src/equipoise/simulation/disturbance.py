"""External forces on a simulated robot: a cable, a push."""

from __future__ import annotations

import mujoco
import numpy as np

from equipoise.conventions import FloatArray
from equipoise.simulation.mujoco_model import SimulatedRobot


class Disturbance:
    """External forces on the simulation: a robot's cable, and pushes for tests of guards and estimates.

    Attributes:
        wrench: (nbody, 6) forces [N] and torques [Nm] on the engine's bodies, in world axes, applied from now on.
    """

    def __init__(self, simulated: SimulatedRobot) -> None:
        self._model, self._base = simulated.model, simulated.base_body
        self.wrench = np.zeros((self._model.nbody, 6))
        self._cable_in_world = simulated.errors.cable_in_world
        self.push(np.zeros(3))

    def push(self, force_in_world: FloatArray) -> None:
        """Apply a (3,) force [N] at the base's CoM, in addition to the cable's, until the next call."""
        self.wrench[self._base, :3] = self._cable_in_world + force_in_world

    @property
    def spec(self) -> int:
        """Bit mask of the engine inputs that a rollout needs."""
        control, pushed = int(mujoco.mjtState.mjSTATE_CTRL), int(mujoco.mjtState.mjSTATE_XFRC_APPLIED)
        return control | pushed if self.wrench.any() else control

    def with_wrench(self, control: FloatArray) -> FloatArray:
        """Return (n, nu) controls, followed by the wrench if `spec` includes it."""
        if not self.wrench.any():
            return control
        return np.hstack([control, np.tile(self.wrench.ravel(), (len(control), 1))])
