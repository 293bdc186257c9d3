"""A real robot by its platform's name: its link, and the watchdog that lets it down if this process dies."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from equipoise.platforms.catalog import open_link
from equipoise.platforms.hardware import HardwarePlatform
from equipoise.platforms.watchdog import Watchdog
from equipoise.robot.model import RobotModel


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
    return HardwarePlatform(open_link(name, robot, given), watchdog=lambda: Watchdog(name, robot, given))
