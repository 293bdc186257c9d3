"""What is known of a guarded robot, and what a check is: something that looks at it and raises."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from equipoise.guard.tilt_filter import TiltFilter
from equipoise.platform.platform import JointCommand, RobotState


@dataclass(eq=False)
class Known:
    """What is known of a robot that is moved: what checks go by, and at last the safe ending.

    Attributes:
        state: newest state that is believed.
        sent: the last command.
        planted: the last command with all feet on the floor.
        up: filter that says which way is up.
        well: whether nothing is wrong with the robot itself.
        heard: whether the link lives.
        believed: whether sensors can be believed.
    """

    state: RobotState
    sent: JointCommand
    planted: JointCommand
    up: TiltFilter
    well: bool = True
    heard: bool = True
    believed: bool = True


Check = Callable[[JointCommand, Known], None]
"""Looks at a command and at what is known; raises a MotionError, or a SettingsError, that says what is wrong.

Before a command is sent, `Known.sent` is the one before it, and `Known.state` where it meets the robot; afterwards
`Known.sent` is the command itself, and `Known.state` what came of it.
"""
