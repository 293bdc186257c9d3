"""State that the checks of a guarded robot depend on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from equipoise.guard.tilt_filter import TiltFilter
from equipoise.platform.platform import JointCommand, RobotState


@dataclass(eq=False)
class CheckContext:
    """State of a robot under command.

    Attributes:
        state: newest accepted state.
        sent: the last command, before its force was bounded.
        bounded: the last command, as sent.
        standing: the last command with all feet on the floor.
        up: filter of the vertical direction.
        lifted: whether the last command holds feet above the floor; False for a robot that lies.
    """

    state: RobotState
    sent: JointCommand
    bounded: JointCommand
    standing: JointCommand
    up: TiltFilter
    lifted: bool = False


Check = Callable[[JointCommand, CheckContext], None]
"""Check of a command; raises a MotionError or a SettingsError.

Before a command is sent, the context holds the previous command and the newest state. Afterwards it holds the command itself
and the state after it.
"""
