"""Checks of a command before it is sent."""

from __future__ import annotations

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import MotionError, SettingsError
from equipoise.guard.check_context import Check, CheckContext
from equipoise.guard.limits import Limits
from equipoise.platform.platform import JointCommand
from equipoise.robot.model import RobotModel
from equipoise.small_arrays import all_of, any_of

_ROUNDING = 1e-3  # [rad] by which a command may exceed a joint's limit
_FIRST_JUMP = 0.1  # [rad] between a joint's position and its first target


class CommandChecks:
    """Checks that reject commands that no valid experiment sends.

    Args:
        own_gains: (nj,) kp [Nm/rad] and kd [Nm s/rad] of the robot's model.
        control_period: time between commands [s].

    Attributes:
        at_rest: checks of the first command, before the robot is moved; they raise the same errors.
        in_motion: checks of a command before it is sent; they raise MotionError, and SettingsError for a wrong number of
            joints.
    """

    def __init__(
        self, limits: Limits, robot: RobotModel, own_gains: tuple[float, float], control_period: float
    ) -> None:
        self._robot, self._period = robot, control_period
        self._farthest = robot.velocity_limit * control_period  # [rad] between two commands
        kp, kd = own_gains
        joints = np.ones(len(robot.joint_names))
        velocity, torque = limits.speed * robot.velocity_limit, limits.torque * robot.effort_limit
        self._ranges = (
            ("velocity", "rad/s", -velocity, velocity),
            ("torque", "Nm", -torque, torque),
            ("kp", "Nm/rad", 0 * joints, limits.gains * kp * joints),
            ("kd", "Nm s/rad", 0 * joints, limits.gains * kd * joints),
        )
        self.in_motion: tuple[Check, ...] = (self._check_position, self._check_ranges)
        self.at_rest: tuple[Check, ...] = (*self.in_motion, self._check_start)

    def _check_position(self, command: JointCommand, context: CheckContext) -> None:
        """Raise MotionError if targets are not numbers, exceed the joint limits, or jump."""
        robot, target = self._robot, command.position
        here = context.state.joint_position
        before = here if context.sent.limp else context.sent.position  # the operator may have moved limp joints
        self.check_shape(target)
        # Comparisons with NaN are false: negated, so that NaN is rejected.
        if not all_of((target >= robot.lower_limit) & (target <= robot.upper_limit)):
            self._check_beyond(target, here)
        moved = np.abs(target - before)
        if any_of(moved > self._farthest) and not command.limp:
            speed = moved / self._period
            joint = int(np.argmax(speed / robot.velocity_limit))
            raise MotionError(
                f"the target of joint {robot.joint_names[joint]!r} jumps by {abs(target[joint] - before[joint]):.3f} rad, at "
                f"{speed[joint]:.0f} rad/s; its limit is {robot.velocity_limit[joint]:.1f} rad/s"
            )

    def _check_beyond(self, target: FloatArray, here: FloatArray) -> None:
        """Raise MotionError if targets are farther beyond a joint's limits than the joint itself."""
        robot = self._robot
        beyond = np.maximum(np.minimum(robot.lower_limit, here) - target, target - np.maximum(robot.upper_limit, here))
        if not (beyond <= _ROUNDING).all():
            self._check_finite("position", target)
            joint = int(np.argmax(beyond))
            raise MotionError(
                f"the target of joint {robot.joint_names[joint]!r} is {target[joint]:.3f} rad; its limits are "
                f"{robot.lower_limit[joint]:.3f} to {robot.upper_limit[joint]:.3f} rad"
            )

    def _check_ranges(self, command: JointCommand, context: CheckContext) -> None:
        for name, unit, least, most in self._ranges:
            values: FloatArray | None = getattr(command, name)
            if values is None:
                continue
            self.check_shape(values)
            within = (values >= least) & (values <= most)
            if not all_of(within):
                self._check_finite(name, values)
                joint = int(np.argmin(within))
                raise MotionError(
                    f"the commanded {name} of joint {self._robot.joint_names[joint]!r} is {values[joint]:.2f} {unit}; it must "
                    f"be from {least[joint]:.2f} to {most[joint]:.2f}"
                )

    def _check_start(self, command: JointCommand, context: CheckContext) -> None:
        here = context.state.joint_position
        jump = np.abs(command.position - here)
        if jump.max() > _FIRST_JUMP:
            joint = int(np.argmax(jump))
            raise MotionError(
                f"the first command would move joint {self._robot.joint_names[joint]!r} at once from {here[joint]:.3f} to "
                f"{command.position[joint]:.3f} rad; begin the motion at the robot's joint positions"
            )

    def check_shape(self, values: FloatArray) -> None:
        """Raise SettingsError unless there is one value per joint."""
        joints = len(self._robot.joint_names)
        if values.shape != (joints,):
            count = len(values) if values.ndim == 1 else f"{values.shape}"
            raise SettingsError(f"commands for {count} joints; {self._robot.name!r} has {joints}")

    def _check_finite(self, name: str, values: FloatArray) -> None:
        if not np.isfinite(values).all():
            joint = int(np.argmax(~np.isfinite(values)))
            raise MotionError(f"the commanded {name} of joint {self._robot.joint_names[joint]!r} is not finite")
