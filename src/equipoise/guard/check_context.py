"""State on which the checks of a guarded robot depend."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from equipoise.guard.tilt_filter import TiltFilter
from equipoise.platform.platform import JointCommand, RobotState


@dataclass(eq=False)
class Known:
    """State of a robot that is moved.

    Attributes:
        state: newest accepted state.
        sent: the last command, before its force was bounded.
        bounded: the last command as it was sent.
        standing: the last command with all feet on the floor.
        up: filter of the vertical direction.
        lifted: whether the last command holds feet above the floor that the others stand on; not of a robot that lies.
    """

    state: RobotState
    sent: JointCommand
    bounded: JointCommand
    standing: JointCommand
    up: TiltFilter
    lifted: bool = False


Check = Callable[[JointCommand, Known], None]
"""Checks a command against what is known; raises a MotionError, or a SettingsError, that says what is wrong.

Before a command is sent, `Known.sent` is the one before it, and `Known.state` the state in which it meets the robot;
afterwards `Known.sent` is the command itself, and `Known.state` the state after it.
"""
