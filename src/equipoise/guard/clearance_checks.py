"""Collision checks of commands between the robot's links."""

from __future__ import annotations

from equipoise.clearance.clearance import Clearance, Contact
from equipoise.errors import MotionError
from equipoise.guard.check_context import Check, CheckContext
from equipoise.platform.platform import JointCommand, Trajectory
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance


class ClearanceChecks:
    """Checks that reject commands that bring links together.

    They check targets, not joint positions: the guard's other limits bound the difference.

    Attributes:
        at_rest: checks before the robot is moved; they raise nothing.
        in_motion: checks of a command before it is sent; they raise MotionError.
    """

    def __init__(self, robot: RobotModel, stance: Stance) -> None:
        self._clearance = Clearance(robot, stance.joint_position)
        self._ahead = Clearance(robot, stance.joint_position)
        self.at_rest: tuple[Check, ...] = (self._begin,)
        self.in_motion: tuple[Check, ...] = (self._check_command,)

    def check_ahead(self, trajectory: Trajectory) -> None:
        """Raise MotionError if a motion, from its first position on, brings links together."""
        self._ahead.begin(trajectory.position[0])
        _reject(self._ahead.first_contact(trajectory.position))

    def _begin(self, command: JointCommand, context: CheckContext) -> None:
        self._clearance.begin(context.state.joint_position)

    def _check_command(self, command: JointCommand, context: CheckContext) -> None:
        if context.sent.limp:  # the operator may have moved limp joints
            self._begin(command, context)
        if not command.limp:
            _reject(self._clearance.next_contact(command.position))


def _reject(contact: Contact | None) -> None:
    if contact is not None:
        raise MotionError(f"{contact}: the command was not sent")
