"""How far a guarded robot may go."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from equipoise.errors import LimitError, SettingsError, TrackingError
from equipoise.platforms.platform import JointCommand, RobotState
from equipoise.robot.model import A1_TORQUE_SCALE, RobotModel

FloatArray = NDArray[np.float64]

_STUCK_TIME = 1.0  # [s] over which a joint must follow
_STUCK_MOVE, _STUCK_SHARE = (
    0.12,
    0.25,
)  # [rad] that it was sent through, and the share of it that no sound joint stays below


@dataclass(frozen=True)
class Limits:
    """What stops a robot, beyond its model's own limits. Each is wide enough that no calibration of a sound robot meets it.

    Attributes:
        position_margin: by which an encoder may read beyond the model's joint limits [rad]; commands may not.
        speed: of a joint, over the model's limit.
        torque: of a joint, over the model's limit.
        temperature: of a motor [deg C].
        tilt: of the base from upright, on four feet [rad].
        tilt_in_lift: while two feet are up, or coming down [rad].
        following: how far a joint may stay behind its target [rad].
        missing_torque: by which a motor may fall short of the torque that it was sent, on a robot with an A1's m g h [Nm].
        patience: how long a speed, torque or following error may last [s].
        silence: the longest time without a fresh sample [s].
        stall: the longest time without a command while the robot moves [s].
    """

    position_margin: float = 0.15
    speed: float = 1.2
    torque: float = 1.15
    temperature: float = 75.0
    tilt: float = 0.44
    tilt_in_lift: float = 0.7
    following: float = 0.5
    missing_torque: float = 4.0
    patience: float = 0.15
    silence: float = 0.1
    stall: float = 0.2

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not value > 0:
                raise SettingsError(f"limit {field.name} is {value}; it must be a positive number")


class JointWatch:
    """Holds joints against their limits, sample by sample.

    Args:
        limits: how far they may go.
        robot: whose joints they are.
        hip_height: that torques scale with [m].
        control_period: [s].
        knows_gains: whether the motors run the gains that commands ask for, so that their torques can be foretold.
    """

    def __init__(
        self, limits: Limits, robot: RobotModel, hip_height: float, control_period: float, knows_gains: bool
    ) -> None:
        self._limits, self._robot, self._period, self._knows_gains = limits, robot, control_period, knows_gains
        self._missing_torque = limits.missing_torque * robot.torque_scale(hip_height) / A1_TORQUE_SCALE
        self._kp, self._kd = robot.gains(hip_height)
        joints = len(robot.joint_names)
        self._too_fast, self._too_strong, self._behind, self._weak = np.zeros((4, joints))
        self._short = np.zeros(joints)
        self._stuck = StuckWatch(joints, round(limits.patience / control_period), round(_STUCK_TIME / control_period))

    def check_command(self, command: JointCommand, before: FloatArray, here: FloatArray) -> None:
        """Refuse a command that no sound experiment sends.

        Args:
            before: (nj,) targets sent last [rad].
            here: (nj,) where the joints are [rad].

        Raises:
            LimitError: beyond a joint's limits (and farther than the joint is by itself), or a jump.
        """
        target, robot = command.position, self._robot
        if not np.isfinite(target).all():
            raise LimitError(f"joint {self._name(~np.isfinite(target))} was sent to what is no number")
        beyond = np.maximum(np.minimum(robot.lower_limit, here) - target, target - np.maximum(robot.upper_limit, here))
        if (beyond > 1e-3).any():
            joint = int(np.argmax(beyond))
            raise LimitError(
                f"joint {robot.joint_names[joint]!r} was sent to {target[joint]:.3f} rad; its limits are "
                f"{robot.lower_limit[joint]:.3f} to {robot.upper_limit[joint]:.3f} rad"
            )
        speed = np.abs(target - before) / self._period
        joint = int(np.argmax(speed / robot.velocity_limit))
        if speed[joint] > robot.velocity_limit[joint]:
            raise LimitError(
                f"joint {robot.joint_names[joint]!r} was sent a jump of {abs(target[joint] - before[joint]):.3f} rad, which "
                f"is {speed[joint]:.0f} rad/s; its limit is {robot.velocity_limit[joint]:.1f} rad/s"
            )

    def check_state(self, state: RobotState, command: JointCommand) -> None:
        """Hold a sample against the limits, and against what was sent.

        Raises:
            LimitError: position, speed, torque or temperature.
            TrackingError: a joint does not go where it is sent, or its motor does not do what it is told.
        """
        self._check_position(state.joint_position)
        if state.joint_velocity is not None:
            share = np.abs(state.joint_velocity) / self._robot.velocity_limit
            if (joint := self._lasting(self._too_fast, share > self._limits.speed)) is not None:
                raise LimitError(
                    f"joint {self._robot.joint_names[joint]!r} turns at {state.joint_velocity[joint]:.1f} rad/s; its limit is "
                    f"{self._robot.velocity_limit[joint]:.1f} rad/s"
                )
        self._check_following(state, command)
        if state.joint_torque is not None:
            self._check_torque(state, state.joint_torque, command)
        self._check_health(state)

    def _check_position(self, position: FloatArray) -> None:
        robot = self._robot
        beyond = np.maximum(robot.lower_limit - position, position - robot.upper_limit)
        joint = int(np.argmax(beyond))
        if beyond[joint] > self._limits.position_margin:
            raise LimitError(
                f"joint {robot.joint_names[joint]!r} is at {position[joint]:.3f} rad; its limits are "
                f"{robot.lower_limit[joint]:.3f} to {robot.upper_limit[joint]:.3f} rad. Are the joint map and the zeros right?"
            )

    def _check_following(self, state: RobotState, command: JointCommand) -> None:
        if command.kp is not None and not command.kp.any():
            return
        behind = np.abs(command.position - state.joint_position)
        if (joint := self._lasting(self._behind, behind > self._limits.following)) is not None:
            raise TrackingError(
                f"joint {self._robot.joint_names[joint]!r} is {behind[joint]:.2f} rad from where it was sent: is it "
                "stuck, has its motor lost power?"
            )
        if (stuck := self._stuck.feel(command.position, state.joint_position)) is not None:
            joint, sent, moved = stuck
            raise TrackingError(
                f"joint {self._robot.joint_names[joint]!r} was sent through {sent:.2f} rad and moved by {moved:.2f} rad: "
                "is it stuck?"
            )

    def _check_torque(self, state: RobotState, torque: FloatArray, command: JointCommand) -> None:
        names = self._robot.joint_names
        if (
            joint := self._lasting(self._too_strong, np.abs(torque) > self._limits.torque * self._robot.effort_limit)
        ) is not None:
            raise LimitError(
                f"joint {names[joint]!r} gives {torque[joint]:.1f} Nm; its limit is {self._robot.effort_limit[joint]:.1f} Nm"
            )
        if not self._knows_gains:
            return
        kp = self._kp if command.kp is None else command.kp
        kd = self._kd if command.kd is None else command.kd
        velocity = 0.0 if state.joint_velocity is None else state.joint_velocity
        sent = kp * (command.position - state.joint_position) - kd * velocity
        sent = sent + (0.0 if command.torque is None else command.torque)
        sent = np.clip(sent, -self._robot.effort_limit, self._robot.effort_limit)
        self._short += self._period / self._limits.patience * (np.abs(sent - torque) - self._short)
        joint = int(np.argmax(self._short))
        if self._short[joint] > self._missing_torque:
            raise TrackingError(
                f"the motor of joint {names[joint]!r} gives {torque[joint]:.1f} Nm where its position and what it was sent "
                f"make it {sent[joint]:.1f} Nm: is it on, are its gains those that are sent?"
            )

    def _check_health(self, state: RobotState) -> None:
        if state.health is None:
            return
        if state.health.fault is not None:
            raise LimitError(f"the robot says: {state.health.fault}")
        temperature = state.health.motor_temperature
        if temperature is not None and (temperature > self._limits.temperature).any():
            joint = int(np.argmax(temperature))
            raise LimitError(
                f"the motor of joint {self._robot.joint_names[joint]!r} has {temperature[joint]:.0f} deg C; "
                f"{self._limits.temperature:.0f} are allowed. Let it cool down"
            )

    def _lasting(self, since: FloatArray, now: NDArray[np.bool_]) -> int | None:
        """The joint for which something has been so for too long."""
        since += self._period
        since *= now
        joint = int(np.argmax(since))
        return joint if since[joint] > self._limits.patience else None

    def _name(self, which: NDArray[np.bool_]) -> str:
        return repr(self._robot.joint_names[int(np.argmax(which))])


class StuckWatch:
    """Notices a joint that does not move while it is sent elsewhere.

    Args:
        joints: how many.
        delay: control periods by which a joint may be late.
        window: control periods that are looked at.
    """

    def __init__(self, joints: int, delay: int, window: int) -> None:
        self._sent: deque[FloatArray] = deque(maxlen=delay + 1)
        self._window, self._count = window, 0
        self._ranges = np.zeros((2, 2, joints))

    def feel(self, target: FloatArray, position: FloatArray) -> tuple[int, float, float] | None:
        """Take (nj,) targets and positions in; the joint that is stuck, what it was sent through, what it did [rad]."""
        self._sent.append(target)
        now = np.stack([self._sent[0], position])
        if self._count == 0:
            self._ranges[:] = now
        np.minimum(self._ranges[0], now, out=self._ranges[0])
        np.maximum(self._ranges[1], now, out=self._ranges[1])
        self._count = (self._count + 1) % self._window
        if self._count:
            return None
        sent, moved = self._ranges[1] - self._ranges[0]
        stuck = (sent > _STUCK_MOVE) & (moved < _STUCK_SHARE * sent)
        if not stuck.any():
            return None
        joint = int(np.argmax(stuck))
        return joint, float(sent[joint]), float(moved[joint])
