"""Bounds on the force that a command can exert beyond what the motion needs, as on a hand in a leg or a blocked joint."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from equipoise.conventions import GRAVITY, FloatArray
from equipoise.guard.limits import Limits
from equipoise.platform.platform import JointCommand, RobotState
from equipoise.robot.kinematics import foot_jacobians
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance
from equipoise.small_arrays import all_of

_FIRST_LIFTS, _GENTLE, _RATE = 2, 0.5, 5.0  # number; share of the stiffness; its change [1/s]


class ForceLimit:
    """Bound on the distance of a target from its joint, with less stiffness in the first lifts.

    A command's feed-forward torque is the motion's torque according to the model; the stiffness adds kp (target - position).
    That addition is bounded by a share of the motor's torque, or by a force at the foot if that is less. On a heavy robot
    the bound may be a share of the weight at the foot: the load of a foot is not predicted better while the robot tips.
    Commands without feed-forward are not bounded. Gains of a command are kept: the estimate relies on them.

    Args:
        own_gains: (nj,) kp [Nm/rad] and kd [Nm s/rad] of commands without gains.
        period: control period [s].

    Attributes:
        excess: (nj,) largest torque beyond the feed-forward [Nm].
    """

    def __init__(
        self, limits: Limits, robot: RobotModel, stance: Stance, own_gains: tuple[FloatArray, FloatArray], period: float
    ) -> None:
        self._kp, self._step = own_gains[0], _RATE * period
        lever = np.zeros(len(robot.joint_names))
        lever[robot.leg_joints] = np.linalg.norm(foot_jacobians(robot, stance.joint_position), axis=1)
        usual = np.minimum(limits.excess_torque * robot.effort_limit, limits.excess_force * lever)
        self.excess = np.maximum(usual, limits.excess_weight * robot.mass * GRAVITY * lever)
        self._lifts, self._up, self._share = 0, False, 1.0

    def bounded(self, command: JointCommand, state: RobotState, lifted: bool) -> JointCommand:
        """Return a command within the bounds.

        Args:
            state: newest state of the robot.
            lifted: whether the command holds feet above the floor.
        """
        self._lifts += self._up and not lifted
        self._up = lifted
        gentle = lifted and self._lifts < _FIRST_LIFTS and command.kp is None
        wanted = _GENTLE if gentle else 1.0
        self._share += min(max(wanted - self._share, -self._step), self._step)
        if command.limp or command.torque is None:
            return command
        kp = self._kp if command.kp is None else command.kp
        gains = command.kp if self._share == 1.0 else self._share * kp
        reach = self.excess / np.maximum(self._share * kp, 1e-9)
        behind = command.position - state.joint_position
        if gains is command.kp and all_of(np.abs(behind) <= reach):
            return command
        position = state.joint_position + np.minimum(np.maximum(behind, -reach), reach)
        return replace(command, position=position, kp=gains)
