"""The verbs that move nothing: plan, estimate, audit."""

from __future__ import annotations

import dataclasses
import json as json_module
import warnings
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from equipoise.cli.flags import Described, Duration, File, Kilograms, Robot, Topic, Verbose, load, seconds
from equipoise.errors import LogError, RecordingError, SettingsError
from equipoise.logs.topics import Topics
from equipoise.robot.description import RobotDescription


def plan(
    robot: Robot = "unitree_a1",
    *,
    budget: Duration = None,
    sway: bool = True,
    description_file: File = None,
    description: Described = RobotDescription(),  # noqa: B008
    json: bool = False,
    quiet: bool = False,
    debug: bool = False,
) -> None:
    """Show what 'calibrate --method precise' would do, and how accurate it would be. Moves nothing, needs no simulator.

    Example: equipoise plan go2 --budget 60s

    Args:
        budget: Robot time, as 60s, 120s or 2min; default 120 s on an A1, more on larger robots.
        sway: As in 'calibrate'.
        description_file: TOML file with a robot description; flags win over it.
        json: Print one JSON object and nothing else on stdout.
        quiet: No warnings about the model file.
        debug: Show a traceback if something goes wrong.
    """
    from equipoise.precise.routine import PreciseSettings, plan_ahead
    from equipoise.robot.stance import nominal_stance
    from equipoise.terminal.calibration import print_plan

    model = load(robot, description_file, description)
    result = plan_ahead(model, nominal_stance(model), PreciseSettings(seconds(budget), sway=sway))
    if json:
        print(json_module.dumps({"schema": "equipoise.plan/1", "robot": model.name, **result.to_dict()}, indent=2))
    else:
        print_plan(model.name, result)


def estimate(
    log: Annotated[Positional[Path], arg(metavar="LOG", help="Run folder of a calibration, or a log of another kind.")],
    *,
    robot: Annotated[str | None, arg(metavar="ROBOT", help_behavior_hint="")] = None,
    feet: Annotated[Literal["measured", "commanded"] | None, arg(help_behavior_hint="")] = None,
    mass: Kilograms = None,
    mass_sd: Kilograms = None,
    joint_topic: Topic = None,
    imu_topic: Topic = None,
    command_topic: Topic = None,
    joint_map: File = None,
    start: Annotated[Duration, arg(name="from")] = None,
    until: Duration = None,
    description_file: File = None,
    description: Described = RobotDescription(),  # noqa: B008
    out: File = None,
    report: bool = True,
    json: bool = False,
    quiet: bool = False,
    verbose: Verbose = False,
    debug: bool = False,
) -> None:
    """Estimate again from a run's recordings, or from a log that is not ours. Needs no robot and no simulator.

    Logs are rosbag2 bags (a folder, an .mcap or a .db3 file) with JointState and Imu or unitree_go/LowState, and .csv and
    .parquet tables; docs/logs.md says what is in them. What can be used is found: lifts of two diagonal feet, moves and
    sways over planted feet.

    Example: equipoise estimate bags/wiggle --robot go2 --mass 16.2 --from 10s

    Args:
        robot: Whose log it is: a name or a model file, as in 'calibrate'. A run of ours knows.
        feet: As in 'calibrate'; default as in the run.
        mass: As in 'calibrate'; default as in the run.
        mass_sd: As in 'calibrate'; default as in the run.
        joint_topic: Joint states of a bag that has several.
        imu_topic: IMU samples of a bag that has several.
        command_topic: Joint commands of a bag that has several.
        joint_map: TOML file with lines as FL_hip_joint = "front_left_hip": the log's name, or column, of a joint.
        start: Use the log from here on, after its first sample.
        until: Use the log until here.
        description_file: Of the log's robot: TOML file with a robot description; flags win over it.
        out: JSON file to save the result in, and the page of the same name beside it. A run's own result is not replaced.
        report: The page is written unless this is given.
        json: Print the result as one JSON object and nothing else on stdout.
        quiet: No warnings about the model file.
        verbose: Show every piece of a log, and how long each stage of the estimate took.
        debug: Show a traceback if something goes wrong.
    """
    given = _LogFlags(
        Topics(joint_topic, imu_topic, command_topic), joint_map, (seconds(start), seconds(until)), description_file,
        description, out,
    )  # fmt: skip
    if robot is None:
        dataclasses.replace(given, out=None).refuse()
        _estimate_run(log, feet, mass, mass_sd, out, report, json, verbose)
    elif feet is not None:
        raise SettingsError("--feet belongs to runs of --method paper; a log is estimated by the method 'precise'")
    else:
        _estimate_log(log, robot, given, mass, mass_sd, report, json, verbose)


@dataclasses.dataclass(frozen=True)
class _LogFlags:
    """Flags that only logs that are not ours know."""

    topics: Topics
    joint_map: Path | None
    span: tuple[float | None, float | None]
    description_file: Path | None
    description: RobotDescription
    out: Path | None = None

    def refuse(self) -> None:
        """Raise SettingsError if one was given."""
        none = _LogFlags(Topics(), None, (None, None), None, RobotDescription())
        given = [
            field.name for field in dataclasses.fields(self) if getattr(self, field.name) != getattr(none, field.name)
        ]
        if given:
            raise SettingsError(
                "topics, --joint-map, --from, --until and robot descriptions are for logs that are not ours: give --robot too"
            )


def _estimate_run(
    path: Path, feet: Literal["measured", "commanded"] | None, mass: float | None, mass_sd: float | None, out: Path | None,
    report: bool, json: bool, verbose: bool,
) -> None:  # fmt: skip
    from equipoise.calibration.run_folder import RESULT, RunFolder
    from equipoise.cli.report import try_to_save
    from equipoise.logs.reader import is_log
    from equipoise.terminal.calibration import print_calibration

    try:
        folder = RunFolder.open(path)
    except RecordingError as error:
        hint = "; if it is another kind of log, say whose with --robot" if is_log(path) else ""
        raise RecordingError(f"{error}{hint}") from error
    settings = folder.settings()
    precise = settings.precise
    if mass is not None or mass_sd is not None:
        precise = dataclasses.replace(precise, mass=precise.mass if mass is None else mass, mass_sd=mass_sd)
    asked = dataclasses.replace(settings, feet=feet or settings.feet, precise=precise)
    result = folder.estimate(asked)
    files: list[Path] = []
    if out is not None:
        result.save(out)
        files = [out, *(try_to_save(result, out.with_suffix(".html")) if report else [])]
    elif asked == settings:  # the run's page is of the run's result
        files = try_to_save(result, path) if report else []
    kept = out or (path if asked == settings and folder.complete else None)
    if json:
        print(result.to_json(), end="")
        return
    print_calibration(result, files, verbose, kept)
    if asked != settings and out is None:
        file = path / "again.json"
        print(f"not kept, and not what {path / RESULT} holds: to keep, see and export it add --out {file}")


def _estimate_log(
    path: Path, robot: str, given: _LogFlags, mass: float | None, mass_sd: float | None, report: bool, json: bool,
    verbose: bool,
) -> None:  # fmt: skip
    from equipoise.calibration.routine import CalibrationSettings
    from equipoise.cli.report import try_to_save
    from equipoise.logs.joint_names import read_joint_map
    from equipoise.logs.offline import estimate_log
    from equipoise.logs.reader import read_log
    from equipoise.precise.routine import PreciseSettings
    from equipoise.terminal.calibration import print_calibration
    from equipoise.terminal.log import print_log_report

    model = load(robot, given.description_file, given.description)
    settings = CalibrationSettings(precise=PreciseSettings(mass=mass, mass_sd=mass_sd))
    joint_map = None if given.joint_map is None else read_joint_map(given.joint_map)
    log = read_log(path, model, given.topics, joint_map, given.span)
    try:
        found = estimate_log(model, log, settings)
    except LogError as error:
        if not json:
            print_log_report(error.report, verbose)
        raise
    result = found.result.with_provenance(log=str(path), **log.about)
    files: list[Path] = []
    if given.out is not None:
        result.save(given.out)
        files = [given.out, *(try_to_save(result, given.out.with_suffix(".html")) if report else [])]
    if json:
        print(json_module.dumps({**result.to_dict(), "log": found.report.to_dict()}, indent=2))
    else:
        print_log_report(found.report, verbose)
        print_calibration(result, files, verbose, given.out)


def audit(
    robot: Robot,
    *,
    description_file: File = None,
    description: Described = RobotDescription(),  # noqa: B008
    json: bool = False,
    quiet: bool = False,
    debug: bool = False,
) -> None:
    """Check the inertial parameters in a robot's model file. Needs no simulator.

    Example: equipoise audit my_robot.urdf

    Args:
        description_file: TOML file with a robot description; flags win over it.
        json: Print one JSON object and nothing else on stdout.
        quiet: No warnings about the model file.
        debug: Show a traceback if something goes wrong.
    """
    from equipoise.robot.audit import audit as run
    from equipoise.terminal.calibration import print_audit

    with warnings.catch_warnings():  # the audit says what was repaired
        warnings.simplefilter("ignore")
        model = load(robot, description_file, description)
    result = run(model)
    if json:
        print(json_module.dumps({"schema": "equipoise.audit/1", **result.to_dict()}, indent=2))
    else:
        print_audit(result)
