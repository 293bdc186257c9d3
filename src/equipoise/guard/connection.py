"""A real robot by its platform's name: its link, and the guard with the watchdog that lets it down if this process dies."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from equipoise.drivers.catalog import open_class, open_link
from equipoise.drivers.hardware import HardwarePlatform
from equipoise.guard.guard import Guard
from equipoise.guard.limits import Limits
from equipoise.guard.watchdog import Watchdog
from equipoise.platform.piece_log import MotionLog
from equipoise.platform.stepped import SteppedPlatform
from equipoise.robot.model import RobotModel


@runtime_checkable
class Learner(Protocol):
    """A link that finds out by itself what could be set: who connects anew, as the watchdog, is told and need not."""

    def learn(self) -> Mapping[str, Any]:
        """Settings by name; waits for the robot's answer, and raises CommunicationError if none comes."""
        ...


def open_platform(name: str, robot: RobotModel, given: Mapping[str, Any]) -> HardwarePlatform | SteppedPlatform:
    """Connect to a robot, to look at it. Who moves it uses `open_guarded`.

    Nothing is sent, but over UDP, where a robot only answers: packets without torque.

    Args:
        name: name of a driver, or of a platform that is a class, as "my_robot:MyRobot".
        robot: model of the robot.
        given: settings by name; text is read as what the setting is.

    Raises:
        SettingsError: no such platform or setting, or a value that it cannot have.
        MissingDependencyError: the driver's package is not installed.
        PluginError: it comes from somebody else and fails.
        CommunicationError: the network cannot be used.
    """
    return open_class(name, robot, given) or HardwarePlatform(open_link(name, robot, given))


def open_guarded(
    name: str,
    robot: RobotModel,
    given: Mapping[str, Any],
    log: MotionLog | None = None,
    told: Path | None = None,
    limits: Limits | None = None,
) -> Guard:
    """Connect to a robot, to move it: guarded, and a driver's with a watchdog. Nothing moves before the first command.

    Args:
        name, robot, given: as in `open_platform`, which says what is raised.
        log, limits: log and limits of the guard.
        told: path of the file in which the watchdog says what it did, if it did something.
    """
    if (home_built := open_class(name, robot, given)) is not None:
        return Guard(home_built, robot, limits, log)
    link = open_link(name, robot, given)

    def watchdog() -> Watchdog:
        learnt: Mapping[str, Any] = link.learn() if isinstance(link, Learner) else {}
        return Watchdog(name, robot, {**given, **learnt}, told)

    return Guard(HardwarePlatform(link), robot, limits, log, watchdog)
