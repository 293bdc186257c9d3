"""Checks that commands keep the robot's links apart."""

from __future__ import annotations

from equipoise.clearance.clearance import Clearance, Contact
from equipoise.errors import MotionError
from equipoise.guard.known import Check, Known
from equipoise.platform.platform import JointCommand, Trajectory
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance


class ClearanceChecks:
    """Refuse commands that bring links together.

    Targets are checked, not joint positions: those follow within the guard's other limits.

    Attributes:
        at_rest: checks before a robot is moved; they raise nothing.
        in_motion: checks of a command before it is sent; they raise MotionError.
    """

    def __init__(self, robot: RobotModel, stance: Stance) -> None:
        self._clearance = Clearance(robot, stance.joint_position)
        self._ahead = Clearance(robot, stance.joint_position)
        self.at_rest: tuple[Check, ...] = (self._begin,)
        self.in_motion: tuple[Check, ...] = (self._check_command,)

    def check_ahead(self, trajectory: Trajectory) -> None:
        """Refuse a whole motion before it begins (MotionError); where it begins the robot is already."""
        self._ahead.begin(trajectory.position[0])
        _refuse(self._ahead.first_contact(trajectory.position))

    def _begin(self, command: JointCommand, known: Known) -> None:
        self._clearance.begin(known.state.joint_position)

    def _check_command(self, command: JointCommand, known: Known) -> None:
        if known.sent.limp:  # limp joints are where somebody has moved them
            self._begin(command, known)
        if not command.limp:
            _refuse(self._clearance.next_contact(command.position))


def _refuse(contact: Contact | None) -> None:
    if contact is not None:
        raise MotionError(f"{contact}: it was not sent there")
