"""The verbs that move nothing: plan, estimate, audit."""

from __future__ import annotations

import json as json_module
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import Positional, arg

from equipoise.cli.calibrate import DEFAULT_PLATFORM, rehearsed
from equipoise.cli.flags import (
    FOR_LOGS,
    Described,
    Duration,
    File,
    Flag,
    Output,
    Required,
    Robot,
    RobotFlags,
    Topic,
    Verbose,
    exit_code,
    load,
)
from equipoise.cli.methods import (
    DEFAULT_METHOD,
    method_asked_for,
    method_flags,
    read_method,
    refuse_flags_of_other_methods,
)
from equipoise.cli.operator_prompt import with_known_imu
from equipoise.cli.settings import Verb, chosen, flags_class, given_flags, seconds, settings_of, shaped
from equipoise.errors import LogError, ModelError, RecordingError, SettingsError
from equipoise.logs.topics import Topics

if TYPE_CHECKING:
    from equipoise.logs.offline import LogEstimate
    from equipoise.result.calibration import Calibration
    from equipoise.robot.audit import Audit


def plan(
    robot: Robot = "unitree_a1",
    *,
    method: Any = None,
    description: Described = RobotFlags(),  # noqa: B008
    output: Output = Output(),  # noqa: B008
) -> None:
    """Show what 'calibrate' would do, and how accurate it would be. Moves nothing, needs no simulator.

    Example: equipoise plan go2 --budget 60s
    """
    from equipoise.method.together import Together
    from equipoise.robot.stance import nominal_stance
    from equipoise.terminal.calibration import print_plan

    asked, model = read_method(method), load(robot, description)
    result = asked.forecast(model, nominal_stance(model))
    if result is None:
        rehearsed(model, asked, DEFAULT_PLATFORM, output.json)
    elif output.json:
        table = {"schema": "equipoise.plan/1", "robot": model.name, **result.to_dict(), "imu": model.imu.to_dict()}
        print(json_module.dumps(table, indent=2))
    else:
        print_plan(model.name, result)
        print(f"{model.imu.sentence}.")
        if isinstance(asked, Together):
            after = asked.motors.rehearse(model, nominal_stance(model))
            print(f"Then the robot {after.doing}: {after.duration:.0f} s more.")


def plan_for(arguments: Sequence[str]) -> Verb:
    """`plan` with the flags of the method that is asked for; raises SettingsError."""
    name = method_asked_for(arguments)
    verb = shaped(plan, method=method_flags(name, arguments))
    refuse_flags_of_other_methods(verb, arguments, f"--method {name}")
    return verb


@dataclass(frozen=True)
class LogFlags:
    """A log that is not ours.

    Attributes:
        robot: Whose log it is: a name or a model file, as in 'calibrate'. A run of ours knows.
        joint_topic: Joint states of a bag that has several.
        imu_topic: IMU samples of a bag that has several.
        command_topic: Joint commands of a bag that has several.
        joint_map: TOML file with lines as FL_hip_joint = "front_left_hip": the log's name, or column, of a joint.
        columns: TOML file with lines as gyro.x = "wx", for a table with other names; without it they are proposed.
        start: Use the log from here on, after its first sample.
        until: Use the log until here.
    """

    robot: Annotated[str | None, arg(metavar="ROBOT", help_behavior_hint="")] = None
    joint_topic: Topic = None
    imu_topic: Topic = None
    command_topic: Topic = None
    joint_map: File = None
    columns: File = None
    start: Annotated[Duration, arg(name="from")] = None
    until: Duration = None


@dataclass(frozen=True)
class EstimateOutput(Output):
    """What is written and shown.

    Attributes:
        out: JSON file to save the result in, and the page of the same name beside it. A run's own result is not replaced.
        report: Leave out the page.
        verbose: Show every piece of a log, and how long each stage of the estimate took.
        explain: Show where the uncertainty comes from, and what would make it less.
        require: End with 11 where the result is less than that, as identified,checks: all that the method estimates is
            identified; all checks passed; or com_x, com_y and other quantities are identified.
    """

    out: File = None
    report: Flag = True
    verbose: Verbose = False
    explain: Flag = False
    require: Required = None


def estimate(
    log: Annotated[Positional[Path], arg(metavar="LOG", help="Run folder of a calibration, or a log of another kind.")],
    *,
    method: Any = None,
    source: Annotated[LogFlags, arg(name="log")] = LogFlags(),
    description: Described = RobotFlags(),  # noqa: B008
    output: EstimateOutput = EstimateOutput(),
) -> int:
    """Estimate again from a run's recordings, or from a log that is not ours. Needs no robot and no simulator.

    Logs are bags of ROS 2 (a folder, an .mcap or a .db3 file) and of ROS 1 with JointState and Imu or unitree_go/LowState,
    and tables (.csv, .parquet, .npz, .npy, .mat); docs/logs.md says what is in them. What can be used is found: lifts of two
    diagonal feet, moves and sways over planted feet, walks and crawls.

    Example: equipoise estimate bags/wiggle --robot go2 --mass 16.2 --from 10s
    """
    from equipoise.result.requirements import read_requirements, verdicts

    given, required = given_flags(method), read_requirements(output.require)
    if source.robot is not None:
        result = _estimate_log(log, source.robot, source, description, given, output)
    elif source != LogFlags() or description != RobotFlags():
        raise SettingsError(FOR_LOGS)
    else:
        result = _estimate_run(log, given, output)
    return exit_code(required, verdicts(result.composite, result.checks))


def estimate_for(arguments: Sequence[str]) -> Verb:
    """`estimate` with the flags of a run's method that an estimate may be made again with; raises SettingsError."""
    from equipoise.method.table import method_named

    name = DEFAULT_METHOD if chosen(arguments, "--robot", "") else _method_of(arguments)
    kind = method_named(name)
    settings = [setting.or_none() for setting in settings_of(kind, kind.judging)]
    flags = flags_class("MethodFlags", f"Settings of {name}; default as in the run.", settings)
    verb = shaped(estimate, method=flags)
    refuse_flags_of_other_methods(verb, arguments, f"--method {name}", judging=True)
    return verb


def _method_of(arguments: Sequence[str]) -> str:
    """The method of the run that is named; what is wrong with a run is told when it is opened."""
    from equipoise.calibration.run_folder import HEADER, RunFolder

    for path in map(Path, arguments):
        if (path / HEADER).is_file():
            with suppress(RecordingError):
                return RunFolder.open(path).method().name
    return DEFAULT_METHOD


def _estimate_run(path: Path, given: Mapping[str, Any], output: EstimateOutput) -> Calibration:
    from equipoise.calibration.run_folder import RESULT, RunFolder
    from equipoise.cli.report import try_to_save
    from equipoise.logs.reader import is_log
    from equipoise.terminal.calibration import print_budget, print_calibration

    try:
        folder = RunFolder.open(path)
    except RecordingError as error:
        hint = "; if it is another kind of log, say whose with --robot" if is_log(path) else ""
        raise RecordingError(f"{error}{hint}") from error
    method = folder.method()
    asked = method.having(given)
    result = folder.estimate(asked)
    own = asked == method and not folder.cut  # the run's page, and what the next run may know, are of the run's result
    files: list[Path] = []
    if output.out is not None:
        result.save(output.out)
        files = [output.out, *(try_to_save(result, output.out.with_suffix(".html")) if output.report else [])]
    elif own:
        files = try_to_save(result, path) if output.report else []
    kept = output.out or (path if own and folder.complete else None)
    if own and folder.complete:
        folder.keep_for_the_next(result)
    if output.json:
        print(result.to_json(), end="")
        return result
    print_calibration(result, files, output.verbose, kept)
    if output.explain:
        print_budget(result)
    if not own and output.out is None:
        file = path / "again.json"
        print(f"not kept, and not what {path / RESULT} holds: to keep, see and export it add --out {file}")
    return result


def estimated_log(
    path: Path, robot: str, source: LogFlags, description: RobotFlags, given: Mapping[str, Any], output: Output,
    verbose: bool = False,
) -> LogEstimate:  # fmt: skip
    """What a log that is not ours says; what was found in it is printed first where nothing can be estimated.

    Args:
        given: settings of the method.
        verbose: whether every piece of the log is printed then.
    """
    from equipoise.logs.offline import estimate_log
    from equipoise.precise.method import Precise
    from equipoise.terminal.columns import read_as_told
    from equipoise.terminal.log import print_log_report

    method = Precise(**given)
    model = with_known_imu(load(robot, description))  # the result states it
    topics = Topics(source.joint_topic, source.imu_topic, source.command_topic)
    span = seconds(source.start, "from"), seconds(source.until, "until")
    log = read_as_told(path, model, topics, source.joint_map, source.columns, span, not output.silent)
    try:
        found = estimate_log(model, log, method)
    except LogError as error:
        if not output.json:
            print_log_report(error.report, verbose)
        raise
    return replace(found, result=found.result.with_provenance(log=str(path), **log.about))


def _estimate_log(
    path: Path, robot: str, source: LogFlags, description: RobotFlags, given: Mapping[str, Any], output: EstimateOutput
) -> Calibration:
    from equipoise.cli.report import try_to_save
    from equipoise.terminal.calibration import print_budget, print_calibration
    from equipoise.terminal.log import print_log_report

    found = estimated_log(path, robot, source, description, given, output, output.verbose)
    result = found.result
    files: list[Path] = []
    if output.out is not None:
        result.save(output.out)
        files = [output.out, *(try_to_save(result, output.out.with_suffix(".html")) if output.report else [])]
    if output.json:
        print(json_module.dumps({**result.to_dict(), "log": found.report.to_dict()}, indent=2))
    else:
        print_log_report(found.report, output.verbose)
        print_calibration(result, files, output.verbose, output.out)
        if output.explain:
            print_budget(result)
    return result


Robots = Annotated[
    Positional[tuple[str, ...]],
    arg(metavar="ROBOT...", help="Names (see 'equipoise robots'), or URDF or MJCF files.", help_behavior_hint=""),
]


def audit(
    robots: Robots = (),
    *,
    format: Literal["table", "github"] = "table",
    description: Described = RobotFlags(),  # noqa: B008
    output: Output = Output(),  # noqa: B008
) -> int:
    """Check the inertial parameters in robots' model files. Needs no simulator. Ends with 1 where something is in error.

    Example: equipoise audit my_robot.urdf
             equipoise audit --format github urdf/*.urdf

    Args:
        format: 'github' writes annotations that a workflow of GitHub shows beside the lines of a change.
    """
    if not robots:
        raise SettingsError("name a robot, or a URDF or MJCF file: equipoise audit my_robot.urdf")
    if format == "github":
        return max(_annotate(robot, description) for robot in robots)
    audits = [_audit(robot, description) for robot in robots]
    tables = [{"schema": "equipoise.audit/1", **result.to_dict()} for result in audits] if output.json else []
    if output.json:
        print(json_module.dumps(tables[0] if len(tables) == 1 else tables, indent=2))
    else:
        from equipoise.terminal.calibration import print_audit

        for result in audits:
            print_audit(result)
    return max(map(_in_error, audits))


def _audit(robot: str, description: RobotFlags) -> Audit:
    from equipoise.robot.audit import audit as run

    with warnings.catch_warnings():  # the audit says what was repaired
        warnings.simplefilter("ignore")
        return run(load(robot, description))


def _annotate(robot: str, description: RobotFlags) -> int:
    """One file's annotations; one that cannot be read does not hide what is found in others."""
    from equipoise.terminal.annotations import annotation_lines, refusal

    try:
        result = _audit(robot, description)
    except ModelError as error:
        print(refusal(robot, error))
        return error.exit_code
    print("".join(f"{line}\n" for line in annotation_lines(robot, result)), end="")
    return _in_error(result)


def _in_error(result: Audit) -> int:
    return int(any(finding.severity == "error" for finding in result.findings))
