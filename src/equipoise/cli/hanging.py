"""`doctor --hanging`: the robot hangs, its motors are damped, and commands stop for a while."""

from __future__ import annotations

import dataclasses
import json
import sys
from contextlib import closing
from typing import TYPE_CHECKING, Any

from equipoise.errors import SettingsError

if TYPE_CHECKING:
    from equipoise.robot.model import RobotModel

_ASKED = """
The robot must hang with its legs free of the floor. Its own controller lets go of the motors: the legs drop. They are damped,
and commands stop for 0.1, 1 and 10 s. Swing a leg by hand all the time, 20 s in all. Ctrl-C ends it.
Type {name} to begin: """


def examine_hanging(platform: str, robot: RobotModel, given: dict[str, Any], as_json: bool) -> int:
    """Measure a hanging robot; print a row for each phase.

    Raises:
        SettingsError: the platform has no driver, or the operator did not type the robot's name.
        CommunicationError: the robot falls silent.
    """
    from equipoise.drivers.motor_boards import HangingPhase, measure_hanging
    from equipoise.drivers.platforms import Driver, find_platform, for_platform, open_connection, settings_of
    from equipoise.terminal.platform import print_hanging

    if not isinstance(find_platform(platform), Driver):
        raise SettingsError(f"platform {platform!r} has no driver: --hanging measures the motor boards of a real robot")
    print(_ASKED.format(name=robot.name), end="", file=sys.stderr, flush=True)
    if sys.stdin.readline().strip() != robot.name:
        raise SettingsError(f"not confirmed, nothing was commanded: type {robot.name}")
    if any(name == "hanging" for name, *_ in settings_of(platform)):
        given = {**given, "hanging": True}
    robot, phases = for_platform(platform, robot), list[HangingPhase]()
    with closing(open_connection(platform, robot, given)) as link:
        try:
            for phase in measure_hanging(link, robot):
                print(phase.name, file=sys.stderr)
                phases.append(phase)
        finally:
            link.release()
    if as_json:
        rows = [dataclasses.asdict(phase) for phase in phases]
        print(
            json.dumps(
                {"schema": "equipoise.hanging/1", "robot": robot.name, "platform": platform, "phases": rows}, indent=2
            )
        )
    else:
        print_hanging(robot, platform, phases)
    return 0
