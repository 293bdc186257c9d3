"""A real robot by its platform's name: its link, and the watchdog that lets it down if this process dies."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

from equipoise.platforms.catalog import open_link
from equipoise.platforms.hardware import HardwarePlatform
from equipoise.platforms.watchdog import Watchdog
from equipoise.robot.model import RobotModel


@runtime_checkable
class Learner(Protocol):
    """A link that finds out by itself what could be set: who connects anew, as the watchdog, is told and need not.

    Attributes:
        learnt: settings by name.
    """

    @property
    def learnt(self) -> Mapping[str, Any]: ...


def open_platform(name: str, robot: RobotModel, given: Mapping[str, Any]) -> HardwarePlatform:
    """Connect to a robot. Nothing moves before the first command.

    Nothing is sent before it either, but over UDP, where a robot only answers: packets without torque.

    Args:
        name: of a driver.
        robot: what is known about the robot.
        given: settings by name; text is read as what the setting is.

    Raises:
        SettingsError: no such platform or setting, or a value that it cannot have.
        MissingDependencyError: the driver's package is not installed.
        CommunicationError: the network cannot be used.
    """
    link = open_link(name, robot, given)

    def watchdog() -> Watchdog:
        return Watchdog(name, robot, {**given, **(link.learnt if isinstance(link, Learner) else {})})

    return HardwarePlatform(link, watchdog=watchdog)
