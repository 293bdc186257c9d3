"""Motion on two feet to replay."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from equipoise.conventions import FloatArray


@dataclass(frozen=True, eq=False)
class TwoFootMotion:
    """Joint motion over time, and initial state of the base.

    Attributes:
        stance_feet: indices of the left and the right standing foot among FL FR RL RR.
        step: time between samples [s].
        joint_position, joint_velocity: (n, nj) joint positions [rad] and velocities [rad/s], in the model's order.
        up_in_base: (3,) direction against gravity at the first sample.
        angular_velocity_base_in_base: (3,) angular velocity of the base at the first sample [rad/s].
    """

    stance_feet: tuple[int, int]
    step: float
    joint_position: FloatArray
    joint_velocity: FloatArray
    up_in_base: FloatArray
    angular_velocity_base_in_base: FloatArray

    @property
    def time(self) -> FloatArray:
        """Times (n,) of the samples [s]."""
        return np.asarray(self.step * np.arange(len(self.joint_position)), dtype=float)

    def joints_at(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return (k, nj) positions [rad] and velocities [rad/s] at (k,) times by cubic Hermite interpolation."""
        before = np.minimum((time / self.step).astype(int), len(self.joint_position) - 2)
        s = np.minimum(time / self.step - before, 1.0)[:, None]
        (a, b), (u, v) = ((of[before], of[before + 1]) for of in (self.joint_position, self.step * self.joint_velocity))
        position = a + s * u + s**2 * (3 * (b - a) - 2 * u - v) + s**3 * (2 * (a - b) + u + v)
        change = u + 2 * s * (3 * (b - a) - 2 * u - v) + 3 * s**2 * (2 * (a - b) + u + v)
        return position, change / self.step
