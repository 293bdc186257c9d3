"""What the calibration process and the robot process say to each other over their pipe."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from equipoise import _version
from equipoise.guard.limits import Limits
from equipoise.guard.report import GuardReport
from equipoise.guard.robot_loop import Tick
from equipoise.robot.description import RobotDescription
from equipoise.robot.source import ModelSource

# --- to the robot process


@dataclass(frozen=True, eq=False)
class Setup:
    """The first message. Other messages of this direction: a `MotionOrder`, and None as a sign of life.

    Attributes:
        platform, given: name and settings of the platform.
        name, source, description: robot model.
        limits: limits that motions must keep.
        ending_file: path of the file to which the ending is appended; empty: none.
        realtime: whether to claim real-time priority and locked memory.
        version: version of the calibration process.
    """

    platform: str
    given: Mapping[str, Any]
    name: str
    source: ModelSource
    description: RobotDescription
    limits: Limits
    ending_file: str = ""
    realtime: bool = True
    version: str = field(default=_version.__version__)


@dataclass(frozen=True)
class StopMotion:
    """End the present motion early, if it is the one with that number."""

    number: int


@dataclass(frozen=True, eq=False)
class End:
    """Put the robot down.

    Attributes:
        urgent: whether to skip lowering the robot.
        request: request of the operator, as `RobotState.request`; empty: none.
    """

    urgent: bool = False
    request: str = ""


# --- from the robot process


@dataclass(frozen=True, eq=False)
class Ready:
    """The connection is open.

    Attributes:
        platform: name of the platform in messages.
        joint_names, control_period, accepts: as a platform's.
        learned: settings that a second connection needs not find out.
        realtime: what the system granted, in words.
    """

    platform: str
    joint_names: tuple[str, ...]
    control_period: float
    accepts: frozenset[str]
    learned: Mapping[str, Any]
    realtime: str


@dataclass(frozen=True, eq=False)
class Batch:
    """Control periods since the last batch.

    Attributes:
        ticks: what happened in each.
        done: number of the last motion that is over.
    """

    ticks: list[Tick]
    done: int


@dataclass(frozen=True, eq=False)
class Ended:
    """The last message: the robot was put down, or never moved.

    Attributes:
        error: error that ended the run, or None.
        report: what the run was like; None if the connection was never opened.
    """

    error: BaseException | None
    report: GuardReport | None
