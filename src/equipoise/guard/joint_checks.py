"""Checks of samples: joint tracking, motor torques, limits, and the robot's health."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from equipoise.conventions import FloatArray
from equipoise.errors import UNHEALTHY, MotionError, StoppedError
from equipoise.guard.check_context import Check, CheckContext
from equipoise.guard.limits import Limits
from equipoise.platform.platform import JointCommand, RobotState
from equipoise.robot.model import RobotModel
from equipoise.robot.scale import Scale
from equipoise.small_arrays import any_of

_STUCK_TIME = 0.5  # [s] over which a joint must follow
_STUCK_MOVE, _STUCK_SHARE = 0.12, 0.25  # [rad] of target motion; share that the joint must move (working joints: 0.66)
_RUNAWAY = 2.0  # times the limit: a joint this far from its target fails at once


class JointChecks:
    """Checks of joints and motors against their limits, sample by sample.

    Args:
        limits: limits of the joints.
        robot: model of the robot.
        hip_height: hip height that torques scale with [m].
        control_period: time between commands [s].
        uses_gains: whether the motors use the gains of commands, so that their torques can be predicted.

    Attributes:
        at_rest: checks before the robot is moved; they raise MotionError and StoppedError.
        in_motion: checks of a sample against the limits and the command; they raise MotionError beyond a limit, if
            a joint does not follow its target, or if its motor does not give the commanded torque.
        health: checks of temperatures, battery and faults; they raise StoppedError.
    """

    def __init__(
        self, limits: Limits, robot: RobotModel, hip_height: float, control_period: float, uses_gains: bool
    ) -> None:
        self._limits, self._robot, self._period, self._uses_gains = limits, robot, control_period, uses_gains
        self._missing_torque = limits.missing_torque * Scale.of(robot.mass, hip_height).torque
        self._kp, self._kd = robot.gains(hip_height)
        self._fastest, self._strongest = limits.speed * robot.velocity_limit, limits.torque * robot.effort_limit
        joints = len(robot.joint_names)
        self._too_fast, self._too_strong, self._behind, self._too_hot = np.zeros((4, joints))
        self._short = np.zeros(joints)
        self._newest = -np.inf  # [s]
        self._stuck = StuckDetector(
            joints, round(limits.patience / control_period), round(_STUCK_TIME / control_period)
        )

        self.at_rest: tuple[Check, ...] = (self._check_position, self._check_health)
        self.in_motion: tuple[Check, ...] = (
            self._check_position,
            self._check_speed,
            self._check_following,
            self._check_stuck,
            self._check_torque,
        )
        self.health: tuple[Check, ...] = (self._check_health,)

    def _check_position(self, command: JointCommand, context: CheckContext) -> None:
        robot, position = self._robot, context.state.joint_position
        beyond = np.maximum(robot.lower_limit - position, position - robot.upper_limit)
        joint = int(beyond.argmax())
        if beyond[joint] > self._limits.position_margin:
            raise MotionError(
                f"joint {robot.joint_names[joint]!r} is at {position[joint]:.3f} rad; its limits are "
                f"{robot.lower_limit[joint]:.3f} to {robot.upper_limit[joint]:.3f} rad. Check the joint map and the offsets"
            )

    def _check_speed(self, command: JointCommand, context: CheckContext) -> None:
        velocity, limit = context.state.joint_velocity, self._robot.velocity_limit
        if velocity is None:
            return
        if (joint := self._lasting(self._too_fast, np.abs(velocity) > self._fastest)) is not None:
            raise MotionError(
                f"joint {self._robot.joint_names[joint]!r} turns at {velocity[joint]:.1f} rad/s; its limit is "
                f"{limit[joint]:.1f} rad/s"
            )

    def _check_following(self, command: JointCommand, context: CheckContext) -> None:
        if command.limp:
            return
        behind = np.abs(command.position - context.state.joint_position)
        joint = self._lasting(self._behind, behind > self._limits.following)
        if joint is None and any_of(behind > _RUNAWAY * self._limits.following):
            joint = int(behind.argmax())
        if joint is not None:
            raise MotionError(
                f"joint {self._robot.joint_names[joint]!r} is {behind[joint]:.2f} rad from its target: is it stuck, or has "
                "its motor lost power?"
            )

    def _check_stuck(self, command: JointCommand, context: CheckContext) -> None:
        if command.limp:
            return
        if (stuck := self._stuck.update(command.position, context.state.joint_position)) is not None:
            joint, sent, moved = stuck
            raise MotionError(
                f"joint {self._robot.joint_names[joint]!r} moved by {moved:.2f} rad while its target moved by {sent:.2f} rad: "
                "is it stuck, or has its motor lost power?"
            )

    def _check_torque(self, command: JointCommand, context: CheckContext) -> None:
        state = context.state
        # A repeated sample does not show the response to the newest command.
        if state.joint_torque is not None and state.time > self._newest:
            self._check_strength(state.joint_torque)
            if self._uses_gains:
                self._check_commanded_torque(state, state.joint_torque, context.bounded)
        self._newest = state.time

    def _check_strength(self, torque: FloatArray) -> None:
        limit = self._robot.effort_limit
        if (joint := self._lasting(self._too_strong, np.abs(torque) > self._strongest)) is not None:
            raise MotionError(
                f"joint {self._robot.joint_names[joint]!r} gives {torque[joint]:.1f} Nm; its limit is {limit[joint]:.1f} Nm"
            )

    def _check_commanded_torque(self, state: RobotState, torque: FloatArray, command: JointCommand) -> None:
        kp = self._kp if command.kp is None else command.kp
        kd = self._kd if command.kd is None else command.kd
        velocity = 0.0 if state.joint_velocity is None else state.joint_velocity
        sent = kp * (command.position - state.joint_position) - kd * velocity
        sent = sent + (0.0 if command.torque is None else command.torque)
        sent = np.minimum(np.maximum(sent, -self._robot.effort_limit), self._robot.effort_limit)  # clip() is slow
        self._short += self._period / self._limits.patience * (np.abs(sent - torque) - self._short)
        joint = int(self._short.argmax())
        if self._short[joint] > self._missing_torque:
            raise MotionError(
                f"the motor of joint {self._robot.joint_names[joint]!r} gives {torque[joint]:.1f} Nm; its position and its "
                f"command require {sent[joint]:.1f} Nm: is the motor on, and does it use the commanded gains?"
            )

    def _check_health(self, command: JointCommand, context: CheckContext) -> None:
        health = context.state.health
        if health is None:
            return
        if health.fault is not None:
            raise StoppedError(f"the robot reports a fault: {health.fault}", exit_code=UNHEALTHY)
        if health.battery_charge is not None and health.battery_charge < self._limits.battery:
            raise StoppedError(
                f"the battery charge is {health.battery_charge:.0%}; at least {self._limits.battery:.0%} is needed. Charge it",
                exit_code=UNHEALTHY,
            )
        temperature = health.motor_temperature
        if temperature is None:
            return
        if (joint := self._lasting(self._too_hot, temperature > self._limits.temperature)) is not None:
            raise StoppedError(
                f"the motor of joint {self._robot.joint_names[joint]!r} is at {temperature[joint]:.0f} deg C; "
                f"{self._limits.temperature:.0f} deg C is allowed. Let it cool down",
                exit_code=UNHEALTHY,
            )

    def _lasting(self, since: FloatArray, now: NDArray[np.bool_]) -> int | None:
        """Return the joint whose condition has lasted for too long, or None."""
        if not any_of(now):
            since.fill(0.0)
            return None
        since += self._period
        since *= now
        joint = int(since.argmax())
        return joint if since[joint] > self._limits.patience else None


class StuckDetector:
    """Detector of joints that do not move while their targets do.

    Each time window is judged at its end. Targets are compared as delayed, so that a prompt joint moves before its target
    does: a joint's motion is taken over this window and the previous one.

    Args:
        joints: number of joints.
        delay: number of control periods by which a joint may be late.
        window: number of control periods in a window.
    """

    def __init__(self, joints: int, delay: int, window: int) -> None:
        self._sent: deque[FloatArray] = deque(maxlen=delay + 1)
        self._window, self._count = window, 0
        self._now = np.zeros((2, joints))  # target and position
        self._least, self._most = np.zeros((2, 2, joints))
        self._before: tuple[FloatArray, FloatArray] | None = None  # least and most of the previous window

    def update(self, target: FloatArray, position: FloatArray) -> tuple[int, float, float] | None:
        """Add (nj,) targets and positions; return a stuck joint with the motion of its target and its own [rad], or None."""
        self._sent.append(target)
        now = self._now
        now[0], now[1] = self._sent[0], position
        if self._count == 0:
            self._least[:] = self._most[:] = now
        np.minimum(self._least, now, out=self._least)
        np.maximum(self._most, now, out=self._most)
        self._count = (self._count + 1) % self._window
        return None if self._count else self._judge()

    def _judge(self) -> tuple[int, float, float] | None:
        (sent_least, least), (sent_most, most) = self._least, self._most
        before, self._before = self._before, (least.copy(), most.copy())
        if before is None:
            return None
        sent = sent_most - sent_least
        moved = np.maximum(most, before[1]) - np.minimum(least, before[0])
        stuck = (sent > _STUCK_MOVE) & (moved < _STUCK_SHARE * sent)
        if not stuck.any():
            return None
        joint = int(np.argmax(stuck))
        return joint, float(sent[joint]), float(moved[joint])
