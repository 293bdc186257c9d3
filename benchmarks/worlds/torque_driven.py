"""Simulated quadruped in an engine outside of the package that takes joint torques and reports joints and base."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

import numpy as np
import pinocchio as pin

from equipoise.conventions import GRAVITY, FloatArray
from equipoise.robot.inertial import InertialParameters
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance
from equipoise.simulation.drawn_errors import DrawnErrors
from equipoise.simulation.effects import EffectSizes
from equipoise.simulation.simulated import SimulatedPlatform

TIMESTEP = 1e-3  # [s]
_SLOW = 0.02  # [rad/s] below which joint friction holds


class TorqueDriven(SimulatedPlatform):
    """Joint PD and joint friction at every engine step, and the IMU's values from changes of the base's velocity.

    Friction is smooth. A subclass loads the robot, and then calls `__init__`, which settles it.

    Attributes:
        LACKS: effects that are not simulated.
    """

    LACKS: ClassVar[tuple[str, ...]] = (
        "armature", "cable", *(row.name for row in EffectSizes.rows() if row.engines == ("mujoco",)),
    )  # fmt: skip

    def __init__(self, robot: RobotModel, stance: Stance, errors: DrawnErrors) -> None:
        kp, kd = (np.full(len(robot.joint_names), gain) for gain in robot.gains(stance.hip_height))
        super().__init__(robot, errors, kp, kd, TIMESTEP, 2e-3)
        self._limit = np.array(robot.effort_limit)
        self._imu_rotation = np.array(robot.imu_in_base.rotation) @ np.array(pin.exp3(errors.drawn["imu_tilt"]))
        self._imu_position = np.array(robot.imu_in_base.translation)
        self._held = np.array(stance.joint_position)  # the targets that act
        self._settle(stance, "standing")

    @abstractmethod
    def truth(self, joint_position: FloatArray) -> InertialParameters:
        """Return the whole robot at (nj,) joint positions in the base frame, from the engine's own bodies."""

    @abstractmethod
    def _joints(self) -> tuple[FloatArray, FloatArray]:
        """Return (nj,) positions and velocities."""

    @abstractmethod
    def _base(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the base's rotation to the world, its angular velocity and the velocity of its origin, in the world."""

    @abstractmethod
    def _drive(self, torque: FloatArray) -> None:
        """Advance by a time step with (nj,) torques."""

    @abstractmethod
    def _saved(self) -> object:
        """Return the engine's state, for `_restore`."""

    @abstractmethod
    def _restore(self, state: object) -> None:
        """Return to a state."""

    def _set_clock_to_zero(self) -> None:
        pass

    def _turn_by(self, angle: float) -> None:
        raise NotImplementedError

    def _base_up(self) -> float:
        return float(self._base()[0][2, 2])

    def _run(self, control: FloatArray, raw: FloatArray) -> None:
        joints, errors = len(self.joint_names), self._errors
        rotations, twists = np.empty((len(control), 3, 3)), np.empty((len(control) + 1, 2, 3))
        speeds = np.empty((len(control) + 1, joints))
        for index, target in enumerate(control):
            position, speeds[index] = self._joints()
            rotations[index], *twists[index] = self._base()
            torque = np.clip(self._kp * (target - position) - self._kd * speeds[index], -self._limit, self._limit)
            raw[index, :joints], raw[index, 2 * joints : 3 * joints] = position, torque
            acting = errors.torque_gain * torque
            sliding = errors.sliding_friction(speeds[index], acting) * np.tanh(speeds[index] / _SLOW)
            self._drive(acting - sliding - errors.viscous_friction * speeds[index])
        self._held, speeds[-1] = control[-1], self._joints()[1]
        _, *twists[-1] = self._base()
        # The engine's velocity belongs to the middle of the step before a state: the mean of two belongs to the state.
        raw[:, joints : 2 * joints] = (speeds[:-1] + speeds[1:]) / 2
        rate, change = (twists[:-1, 0] + twists[1:, 0]) / 2, np.diff(twists, axis=0) / TIMESTEP
        arm = rotations @ self._imu_position
        force = change[:, 1] + np.cross(change[:, 0], arm) + np.cross(rate, np.cross(rate, arm))
        force -= GRAVITY * errors.gravity_direction
        axes = rotations @ self._imu_rotation
        raw[:, -6:-3], raw[:, -3:] = np.einsum("nji,nj->ni", axes, rate), np.einsum("nji,nj->ni", axes, force)

    def _raw_now(self) -> FloatArray:
        before, held, raw = self._saved(), self._held, np.empty((1, self._raw_width))
        self._run((self._late_control[0] if len(self._late_control) else held)[None], raw)
        self._held = held
        self._restore(before)
        return raw[0]
