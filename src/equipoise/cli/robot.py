"""The verbs about robots that are there: doctor, record."""

from __future__ import annotations

import dataclasses
import json as json_module
import sys
from collections.abc import Generator
from contextlib import closing, contextmanager
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any

from equipoise.cli import flags
from equipoise.cli.operator_prompt import with_known_imu
from equipoise.cli.setting_flags import seconds
from equipoise.drivers.platforms import (
    Driver,
    find_platform,
    for_platform,
    given_settings,
    open_connection,
    settings_of,
)
from equipoise.errors import OutputError, SettingsError
from equipoise.robot.catalog import load_robot
from equipoise.user_file import made_folder, typed

if TYPE_CHECKING:
    from equipoise.recording.run_log import RunLog
    from equipoise.robot.model import RobotModel

_SIMULATED_TIME = 10.0  # [s]: nobody waits for a robot that is not there, and disks fill


_ASKED = """
The robot must hang with its legs free of the floor. Its own controller lets go of the motors: the legs drop. They are damped,
and commands stop for 0.1, 1 and 10 s. Swing a leg by hand all the time, 20 s in all. Ctrl-C ends it.
Type {name} to begin: """


def doctor(
    robot: flags.Robot = "unitree_a1",
    *,
    platform: flags.PlatformName = "mujoco",
    set: flags.SettingsGiven = (),
    settings: flags.SettingsFile = None,
    duration: flags.Duration = None,
    hanging: bool = False,
    description: flags.Described,
    output: flags.Output,
) -> int:
    """Connect to a robot, look for five seconds, move nothing, and say what is right
    and what is not.

    Rates, jitter, the joint map, gravity against the stance, joint torques, battery
    and temperatures where there are any; on a Go2 or B2 which controller holds the
    motors, and what 'calibrate' will do about it. Ends with 0 if nothing speaks
    against a calibration, else with 1.

    Example: equipoise doctor go2 --platform unitree-go2 --set interface=eth0

    Args:
        duration: How long to look; default 5 s.
        hanging: The robot hangs with its legs free: measure what its motor boards do when commands stop. Its own controller
            lets go of the motors, and they are damped; you are asked for the robot's name first.
    """
    lasting = _lasting(duration) or 5.0
    find_platform(platform)
    from equipoise.drivers.checkup import examine, joint_table, takeover_findings
    from equipoise.terminal.robot_reports import print_checkup

    if hanging:
        return _examine_hanging(platform, load_robot(robot, description), given_settings(set, settings), output)
    model = with_known_imu(load_robot(robot, description), flags.is_simulated(platform))
    with flags.connected(platform, model, set, settings) as connection:
        findings = examine(connection, model, lasting) + takeover_findings(connection)
        joints = joint_table(model, connection.read().joint_position)
    rows = [dataclasses.asdict(finding) for finding in findings]
    table = {"schema": "equipoise.doctor/1", "robot": model.name, "platform": platform, "findings": rows}
    table |= {"imu": model.imu.to_dict(), "joints": joints}
    output.write(table, lambda: print_checkup(model, platform, joints, findings))
    return int(any(finding.fine is False for finding in findings))


def _examine_hanging(platform: str, robot: RobotModel, given: dict[str, Any], output: flags.Output) -> int:
    """Measure a hanging robot; print a row for each phase.

    Raises:
        SettingsError: the platform has no driver, or the operator did not type the robot's name.
        CommunicationError: the robot falls silent.
    """
    from equipoise.drivers.motor_boards import HangingPhase, measure_hanging
    from equipoise.terminal.robot_reports import print_hanging

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
    rows = [dataclasses.asdict(phase) for phase in phases]
    table = {"schema": "equipoise.hanging/1", "robot": robot.name, "platform": platform, "phases": rows}
    output.write(table, lambda: print_hanging(robot, platform, phases))
    return 0


def record(
    robot: flags.Robot = "unitree_a1",
    *,
    platform: flags.PlatformName = "mujoco",
    set: flags.SettingsGiven = (),
    settings: flags.SettingsFile = None,
    duration: flags.Duration = None,
    out: flags.File = None,
    description: flags.Described,
    output: flags.Output,
) -> None:
    """Log a robot's joint sensors and IMU without moving it, until --duration is over
    or Ctrl-C.

    The file is MCAP with JointState and Imu, which Foxglove and PlotJuggler open,
    and 'equipoise estimate FILE --robot ROBOT'.

    Example: equipoise record go2 --platform unitree-go2 --set interface=eth0 --duration 60s

    Args:
        duration: How long; default until Ctrl-C, in simulation, whose time runs faster, 10 s.
        out: The file, in a folder that is there; default logs/ROBOT-TIME.mcap.
    """
    lasting = _lasting(duration) or (_SIMULATED_TIME if flags.is_simulated(platform) else None)
    find_platform(platform)
    from equipoise.drivers.checkup import watch
    from equipoise.platform.interruptions import Interruptions
    from equipoise.terminal.robot_reports import RecordingProgress

    model = load_robot(robot, description)
    now = datetime.now(timezone.utc)
    out = out or made_folder(Path("logs")) / f"{model.name}-{now:%Y%m%d-%H%M%S}.mcap"
    interruptions, samples = Interruptions(), 0
    with (
        flags.connected(platform, model, set, settings) as connection,
        _log_at(out) as log,
        interruptions.noted(),
        RecordingProgress(output.silent, out, lasting) as progress,
    ):
        for piece in watch(connection, model, lasting):
            log.add(piece)
            samples += len(piece.joints.time)
            progress.update(piece)
            if interruptions.asked:
                break
    if output.json:
        table = {"schema": "equipoise.record/1", "robot": model.name, "platform": platform, "file": str(out)}
        print(json_module.dumps({**table, "joint_samples": samples}))
    else:
        print(out)
        print(f"what it can tell: equipoise estimate {typed(out)} --robot {typed(robot)}", file=sys.stderr)


def _lasting(duration: str | None) -> float | None:
    value = seconds(duration, "duration")
    if value == 0:
        raise SettingsError(f"--duration is {duration}; give it as 10s, or leave it out")
    return value


@contextmanager
def _log_at(path: Path) -> Generator[RunLog]:
    """A new log, gone if nothing comes; raises OutputError if there is a file already, or it cannot be written."""
    if path.exists():
        raise OutputError(f"{str(path)!r} exists; name a new file with --out")
    from equipoise.recording.run_log import RunLog

    with RunLog(path) as log:
        try:
            yield log
        finally:
            if log.empty:  # the robot was silent
                path.unlink(missing_ok=True)
