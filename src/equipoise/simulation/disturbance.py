"""External forces on a simulated robot: a cable, a push."""

from __future__ import annotations

import mujoco
import numpy as np

from equipoise.conventions import FloatArray
from equipoise.simulation.mujoco_model import SimulatedRobot
from equipoise.small_arrays import any_of

_CONTROL, _PUSHED = int(mujoco.mjtState.mjSTATE_CTRL), int(mujoco.mjtState.mjSTATE_XFRC_APPLIED)


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
        return _CONTROL | _PUSHED if any_of(self.wrench != 0) else _CONTROL

    def with_wrench(self, control: FloatArray) -> FloatArray:
        """Return (n, nu) controls, followed by the wrench if `spec` includes it."""
        if not any_of(self.wrench != 0):
            return control
        return np.concatenate([control, np.broadcast_to(self.wrench.ravel(), (len(control), self.wrench.size))], axis=1)
