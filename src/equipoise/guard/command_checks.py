"""Checks of a command before it is sent."""

from __future__ import annotations

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import MotionError, SettingsError
from equipoise.guard.known import Check, Known
from equipoise.guard.limits import Limits
from equipoise.platform.platform import JointCommand
from equipoise.robot.model import RobotModel

_ROUNDING = 1e-3  # [rad] by which a command may be beyond a joint's limit
_FIRST_JUMP = 0.1  # [rad] between where a joint is and where it is first sent


class CommandChecks:
    """Refuse commands that no sound experiment sends.

    Args:
        own_gains: (nj,) kp [Nm/rad] and kd [Nm s/rad] of the robot's model.
        control_period: time between commands [s].

    Attributes:
        at_rest: checks of the first command, before a robot is moved; they raise as the others do.
        in_motion: checks of a command before it is sent; they raise MotionError, and SettingsError if it is for another number
            of joints.
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

    def _check_position(self, command: JointCommand, known: Known) -> None:
        """Refuse targets that are not numbers, are beyond the limits and the joint, or jump from the targets before."""
        robot, target = self._robot, command.position
        here = known.state.joint_position
        before = here if known.sent.limp else known.sent.position  # limp joints are where somebody has moved them
        self.check_shape(target)
        # Of what is no number nothing is true: it is refused because it is not known to be within the limits.
        if not ((target >= robot.lower_limit) & (target <= robot.upper_limit)).all():
            self._check_beyond(target, here)
        moved = np.abs(target - before)
        if (moved > self._farthest).any() and not command.limp:
            speed = moved / self._period
            joint = int(np.argmax(speed / robot.velocity_limit))
            raise MotionError(
                f"joint {robot.joint_names[joint]!r} was sent a jump of {abs(target[joint] - before[joint]):.3f} rad, which "
                f"is {speed[joint]:.0f} rad/s; its limit is {robot.velocity_limit[joint]:.1f} rad/s"
            )

    def _check_beyond(self, target: FloatArray, here: FloatArray) -> None:
        """Refuse targets that are farther beyond a joint's limits than the joint itself."""
        robot = self._robot
        beyond = np.maximum(np.minimum(robot.lower_limit, here) - target, target - np.maximum(robot.upper_limit, here))
        if not (beyond <= _ROUNDING).all():
            self._refuse_what_is_no_number("position", target)
            joint = int(np.argmax(beyond))
            raise MotionError(
                f"joint {robot.joint_names[joint]!r} was sent to {target[joint]:.3f} rad; its limits are "
                f"{robot.lower_limit[joint]:.3f} to {robot.upper_limit[joint]:.3f} rad"
            )

    def _check_ranges(self, command: JointCommand, known: Known) -> None:
        for name, unit, least, most in self._ranges:
            values = getattr(command, name)
            if values is not None:
                self._check_range(name, unit, values, least, most)

    def _check_start(self, command: JointCommand, known: Known) -> None:
        here = known.state.joint_position
        jump = np.abs(command.position - here)
        if jump.max() > _FIRST_JUMP:
            joint = int(np.argmax(jump))
            raise MotionError(
                f"the first command would move joint {self._robot.joint_names[joint]!r} at once from {here[joint]:.3f} to "
                f"{command.position[joint]:.3f} rad; motions start where the robot is"
            )

    def _check_range(self, name: str, unit: str, values: FloatArray, least: FloatArray, most: FloatArray) -> None:
        self.check_shape(values)
        within = (values >= least) & (values <= most)
        if not within.all():
            self._refuse_what_is_no_number(name, values)
            joint = int(np.argmin(within))
            raise MotionError(
                f"joint {self._robot.joint_names[joint]!r} was sent a {name} of {values[joint]:.2f} {unit}; from "
                f"{least[joint]:.2f} to {most[joint]:.2f} is allowed"
            )

    def check_shape(self, values: FloatArray) -> None:
        """Refuse values that are not one a joint (SettingsError)."""
        joints = len(self._robot.joint_names)
        if values.shape != (joints,):
            count = len(values) if values.ndim == 1 else f"{values.shape}"
            raise SettingsError(f"commands for {count} joints; {self._robot.name!r} has {joints}")

    def _refuse_what_is_no_number(self, name: str, values: FloatArray) -> None:
        if not np.isfinite(values).all():
            joint = int(np.argmax(~np.isfinite(values)))
            raise MotionError(f"joint {self._robot.joint_names[joint]!r} was sent a {name} that is no number")
