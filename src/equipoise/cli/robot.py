"""Verbs that read the sensors of a robot: doctor, record."""

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
from equipoise.cli.operator_prompt import with_imu_pose
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

_SIMULATED_TIME = 10.0  # [s] of a simulated recording without --duration

_HANGING_PROMPT = """
The robot must hang with its legs free of the floor. Its own controller releases the motors: the legs drop. They are damped,
and commands stop for 0.1, 1 and 10 s. Swing a leg by hand during the whole test, 20 s. Ctrl-C ends it.
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
    """Check a robot's sensors and joint map for five seconds, without moving it.

    Checks rates, jitter, the joint map, gravity against the stance and, if available,
    joint torques, battery and temperatures. On a Go2 or B2 it also shows the
    controller that holds the motors, and how 'calibrate' takes over. Exits with 0 if
    all checks pass, else with 1.

    Example: equipoise doctor go2 --platform unitree-go2 --set interface=eth0

    Args:
        duration: Duration of the check; default 5 s.
        hanging: Measure how the motors of a hanging robot respond when commands stop; you confirm with the robot's name first.
    """
    time = _positive_time(duration) or 5.0
    find_platform(platform)
    from equipoise.drivers.checkup import examine, joint_table, takeover_findings
    from equipoise.terminal.robot_reports import print_checkup

    if hanging:
        return _examine_hanging(platform, load_robot(robot, description), given_settings(set, settings), output)
    model = with_imu_pose(load_robot(robot, description), flags.is_simulated(platform))
    with flags.connected(platform, model, set, settings) as connection:
        findings = examine(connection, model, time) + takeover_findings(connection)
        joints = joint_table(model, connection.read().joint_position)
    rows = [dataclasses.asdict(finding) for finding in findings]
    table = {"schema": "equipoise.doctor/1", "robot": model.name, "platform": platform, "findings": rows}
    table |= {"imu": model.imu.to_dict(), "joints": joints}
    output.write(table, lambda: print_checkup(model, platform, joints, findings))
    return int(any(finding.fine is False for finding in findings))


def _examine_hanging(platform: str, robot: RobotModel, given: dict[str, Any], output: flags.Output) -> int:
    """Measure the motor boards of a hanging robot and print a row for each phase.

    Raises:
        SettingsError: the platform has no driver, or the operator did not type the robot's name.
        CommunicationError: the robot stops sending.
    """
    from equipoise.drivers.motor_boards import HangingPhase, measure_hanging
    from equipoise.terminal.robot_reports import print_hanging

    if not isinstance(find_platform(platform), Driver):
        raise SettingsError(f"platform {platform!r} has no driver; --hanging needs a real robot")
    print(_HANGING_PROMPT.format(name=robot.name), end="", file=sys.stderr, flush=True)
    if sys.stdin.readline().strip() != robot.name:
        raise SettingsError(f"not confirmed, no command was sent; type {robot.name} to confirm")
    if any(name == "hanging" for name, *_ in settings_of(platform)):
        given = {**given, "hanging": True}
    robot, phases = for_platform(platform, robot), list[HangingPhase]()
    with closing(open_connection(platform, robot, given)) as connection:
        try:
            for phase in measure_hanging(connection, robot):
                print(phase.name, file=sys.stderr)
                phases.append(phase)
        finally:
            connection.release()
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
    """Log a robot's joint sensors and IMU without moving it, for --duration or until
    Ctrl-C.

    The file is MCAP with JointState and Imu messages, for Foxglove, PlotJuggler and
    'equipoise estimate FILE --robot ROBOT'.

    Example: equipoise record go2 --platform unitree-go2 --set interface=eth0 --duration 60s

    Args:
        duration: Duration of the log; default until Ctrl-C, or 10 s in simulation.
        out: File to write, in an existing folder; default logs/ROBOT-TIME.mcap.
    """
    time = _positive_time(duration) or (_SIMULATED_TIME if flags.is_simulated(platform) else None)
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
        RecordingProgress(output.silent, out, time) as progress,
    ):
        for piece in watch(connection, model, time):
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
        print(f"estimate from it: equipoise estimate {typed(out)} --robot {typed(robot)}", file=sys.stderr)


def _positive_time(duration: str | None) -> float | None:
    value = seconds(duration, "duration")
    if value == 0:
        raise SettingsError(f"--duration is {duration}; give a positive time such as 10s, or leave it out")
    return value


@contextmanager
def _log_at(path: Path) -> Generator[RunLog]:
    """Yield a new log, deleted if it stays empty; raises OutputError if the file exists or cannot be written."""
    if path.exists():
        raise OutputError(f"{str(path)!r} exists; name a new file with --out")
    from equipoise.recording.run_log import RunLog

    with RunLog(path) as log:
        try:
            yield log
        finally:
            if log.empty:  # the robot sent nothing
                path.unlink(missing_ok=True)
