"""Verbs that need no robot: plan, estimate, diagnose, audit."""

from __future__ import annotations

import json as json_module
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast

from tyro.conf import Positional, arg
from tyro.constructors import StructConstructorSpec, StructFieldSpec

from equipoise.calibration.run_header import HEADER, RESULT, read_header
from equipoise.cli import flags
from equipoise.cli.arguments import chosen
from equipoise.cli.calibrate import show_rehearsal
from equipoise.cli.methods import DEFAULT_METHOD, DEFAULT_SHOWN, METHOD_FLAGS, owners, refuse_flag_of
from equipoise.cli.operator_prompt import with_imu_pose
from equipoise.cli.parsing import ChosenFlags
from equipoise.cli.report import try_to_save
from equipoise.cli.setting_flags import flags_of, optional, spec_of, values_of
from equipoise.errors import ModelError, RecordingError, SettingsError
from equipoise.json_form import fields_to_json
from equipoise.method.method import Method
from equipoise.method.table import METHODS, method_named, settings_of
from equipoise.robot.catalog import load_robot
from equipoise.robot.description import RobotDescription
from equipoise.user_file import typed

if TYPE_CHECKING:
    from equipoise.calibration.run_folder import RunFolder
    from equipoise.logs.offline import LogEstimate
    from equipoise.result.calibration import Calibration
    from equipoise.robot.audit import Audit

STATIC = "static"
_METHODS_OF_LOGS = (
    "For a log: 'bayesian' needs motions and an IMU; 'static' one sample of standing, with joint torques."
)


def plan(
    robot: flags.Robot = "unitree_a1",
    *,
    method: Method,
    description: flags.Described,
    output: flags.Output,
) -> None:
    """Show the motions of 'calibrate' and predict its accuracy. Moves nothing and needs
    no simulator.

    Example: equipoise plan go2 --duration 60s
    """
    from equipoise.method.combined import CombinedMethod
    from equipoise.robot.stance import nominal_stance
    from equipoise.terminal.results import print_plan

    model = load_robot(robot, description)
    result = method.forecast(model, nominal_stance(model))
    if result is None:
        show_rehearsal(model, method, flags.DEFAULT_PLATFORM, output.json)
    elif output.json:
        table = {"schema": "equipoise.plan/1", "robot": model.name, **result.to_dict(), "imu": model.imu.to_dict()}
        print(json_module.dumps(table, indent=2))
    else:
        print_plan(model.name, result)
        print(model.imu.line)
        if isinstance(method, CombinedMethod):
            after = method.motors.rehearse(model, nominal_stance(model))
            print(f"Then the robot {after.doing}: {after.duration:.0f} s more.")


@dataclass(frozen=True)
class EstimateOutput(flags.Output):
    """Written and printed output.

    Attributes:
        out: JSON file to save the result in, with a page of the same name. The run's own result is not replaced.
        report: Do not write the page.
        verbose: Show every segment of a log, and the duration of each stage of the estimate.
        explain: Show the sources of the uncertainty, and how to reduce it.
    """

    out: flags.File = None
    report: flags.Flag = True
    verbose: flags.Verbose = False
    explain: flags.Flag = False

    def save(self, result: Calibration, page: Path | None) -> list[Path]:
        """Save a result to --out, or only its page if there is no --out; return the files."""
        if self.out is not None:
            result.save(self.out)
            page = self.out.with_suffix(".html")
        saved = [] if self.out is None else [self.out]
        return saved + (try_to_save(result, page) if self.report and page is not None else [])

    def show(self, result: Calibration, files: Sequence[Path], kept: Path | None) -> None:
        """Print a result and, with --explain, its uncertainty budget; `kept`: file or folder to export it from."""
        from equipoise.terminal.results import print_budget, print_calibration

        print_calibration(result, files, self.verbose, kept)
        if self.explain:
            print_budget(result)


def estimate(
    log: Annotated[Positional[Path], arg(metavar="LOG", help="Run folder, or a log of another program.")],
    *,
    fail_unless: flags.Required = None,
    given: Annotated[Mapping[str, Any], arg(name="method")],
    source: Annotated[flags.LogFlags, arg(name="log")],
    description: flags.Described,
    output: EstimateOutput,
) -> int:
    """Estimate again from the recordings of a run, or from a log of another program.
    Needs no robot and no simulator.

    Logs are ROS 2 bags (a folder, .mcap or .db3 file), ROS 1 bags, and tables (.csv,
    or .dat, .txt, .jsonl, .parquet, .npz, .npy, .mat, also with .gz); docs/logs.md
    describes their contents. Several tables of one run are merged by time. Usable
    segments are detected: lifts of two diagonal feet, stance motions, excitation,
    walking and crawling.

    Example: equipoise estimate bags/wiggle --robot go2 --method bayesian --mass 16.2
             equipoise estimate joints.csv imu.csv --robot go2 --from 10s
    """
    from equipoise.result.requirements import read_requirements, verdicts

    required = read_requirements(fail_unless)
    if source.robot is not None:
        result = _estimate_log(log, source, description, given, output)
    else:
        result = _estimate_run(flags.open_run(log, source, description), given, output)
    return flags.exit_code(required, verdicts(result.composite, result.checks))


def _given_flags(arguments: Sequence[str]) -> StructConstructorSpec:
    """Return `--method` and the flags of the method that may change in a new estimate; raises SettingsError."""
    name, is_log = _method_of(arguments), bool(chosen(arguments, "--robot", ""))
    if (wanted := chosen(arguments, "--method", name)) != name and not is_log:
        raise SettingsError(f"--method {wanted} is for logs of other programs; the method of this run is {name}")
    kind = settings_of(name)
    flags = [optional(flag) for flag in flags_of(kind) if flag.name in kind.estimate_only]
    choice = Annotated[Literal["bayesian", "static"], arg(help=_METHODS_OF_LOGS, help_behavior_hint=DEFAULT_SHOWN)]
    flags.append(StructFieldSpec("method", cast("Any", choice), name if is_log else DEFAULT_METHOD))
    return spec_of(
        f"Settings of {name}; default as in the run, if it is a run.",
        flags,
        lambda values: {**values_of(kind, values), **({"method": values["method"]} if is_log else {})},
    )


def _refuse_other(flag: str, arguments: Sequence[str]) -> None:
    refuse_flag_of(owners(flag, estimate_only=True), flag, f"--method {_method_of(arguments)}")


CHOSEN: dict[Any, ChosenFlags] = {
    Method: METHOD_FLAGS,
    Mapping[str, Any]: (_given_flags, _refuse_other),
}
"""Parameters of `plan`, `estimate` and `diagnose` whose flags depend on `--method`, `--parameters` and the run."""


def _method_of(arguments: Sequence[str]) -> str:
    """Return the method of the named run, or the default; opening the run reports its errors."""
    if not chosen(arguments, "--robot", ""):
        for path in map(Path, arguments):
            if (path / HEADER).is_file():
                with suppress(RecordingError):
                    name = str(read_header(path)["settings"].get("method"))
                    return name if name in METHODS else DEFAULT_METHOD
    return STATIC if chosen(arguments, "--method", DEFAULT_METHOD) == STATIC else DEFAULT_METHOD


def _estimate_run(folder: RunFolder, given: Mapping[str, Any], output: EstimateOutput) -> Calibration:
    method = folder.method()
    changed = method.having(given)
    result = folder.estimate(changed)
    own = changed == method and not folder.cut  # only this result replaces the run's page and posterior
    files = output.save(result, folder.path if own else None)
    if own and folder.complete:
        folder.save_posterior(result)
    if output.json:
        print(result.to_json(), end="")
        return result
    output.show(result, files, output.out or (folder.path if own and folder.complete else None))
    if not folder.complete:
        print(
            f"interrupted run, {len(result.trials)} trials; finish it: equipoise calibrate --resume {typed(folder.path)}"
        )
    if not own and output.out is None:
        file, kept = folder.path / "again.json", folder.path / RESULT
        print(f"not saved, and different from {kept}: to save, view and export it, add --out {file}")
    return result


def estimate_from_log(
    path: Path, source: flags.LogFlags, description: RobotDescription, given: Mapping[str, Any], output: flags.Output,
    verbose: bool = False,
) -> LogEstimate:  # fmt: skip
    """Estimate from a log of another program; if that fails, print the contents of the log before raising.

    Args:
        given: settings of the method.
        verbose: true to print every segment of the log then.
    """
    from equipoise.logs.offline import estimate_log, estimate_standing_log

    settings = {name: value for name, value in given.items() if name != "method"}
    method = method_named(given.get("method", DEFAULT_METHOD))(**settings)
    model = with_imu_pose(load_robot(source.robot or "", description))  # the result contains it
    standing = method.name == STATIC
    log = source.read(path, model, not output.silent, standing)
    with output.reporting_failed_log(verbose):
        estimated = (estimate_standing_log if standing else estimate_log)(model, log, cast("Any", method))
    return replace(
        estimated, result=estimated.result.with_provenance(log=", ".join(map(str, (path, *source.tables))), **log.about)
    )


def _estimate_log(
    path: Path, source: flags.LogFlags, description: RobotDescription, given: Mapping[str, Any], output: EstimateOutput
) -> Calibration:
    from equipoise.terminal.log_summary import print_log_report

    estimated = estimate_from_log(path, source, description, given, output, output.verbose)
    result = estimated.result
    files = output.save(result, None)
    if output.json:
        print(json_module.dumps({**result.to_dict(), "log": estimated.report.to_dict()}, indent=2))
    else:
        print_log_report(estimated.report, output.verbose)
        output.show(result, files, output.out)
        if output.out is None:
            print("not saved: to save, view and export the result, add --out FILE")
    return result


def diagnose(
    log: flags.Run,
    *,
    given: Annotated[Mapping[str, Any], arg(name="method")],
    source: Annotated[flags.LogFlags, arg(name="log")],
    description: flags.Described,
    output: flags.Output,
) -> int:
    """Find why a robot leans: joint offsets, the IMU's level, a payload, or torque gains.
    Reads a calibration, or a log of half a minute of standing and shifting its weight.

    Causes are ranked by significance, with the shift of the centre of mass over the feet
    that each explains, and what to change. Exits with 1 if a cause is significant.

    Example: equipoise diagnose runs/go2
             equipoise diagnose bags/shifting --robot go2 --mass 16.2
    """
    from equipoise.estimator.diagnostics.causes import diagnose as find_causes
    from equipoise.terminal.diagnosis import print_diagnosis

    if source.robot is not None:
        result, run = estimate_from_log(log, source, description, given, output).result, None
    else:
        folder = flags.open_run(log, source, description)
        result, run = folder.estimate(folder.method().having(given)), typed(log)
    found = find_causes(result)
    failed = [check.name for check in result.checks if not check.passed]
    table = {"schema": "equipoise.diagnosis/1", **fields_to_json(found), "failed_checks": failed}
    output.write(table, lambda: print_diagnosis(found, failed, run))
    return int(found.causes[0].verdict == "significant")


Robots = Annotated[
    Positional[tuple[str, ...]],
    arg(metavar="ROBOT...", help="Names (see 'equipoise robots'), or URDF or MJCF files.", help_behavior_hint=""),
]


def audit(
    robots: Robots = (),
    *,
    format: Literal["table", "json", "github"] = "table",
    description: flags.Described,
    output: flags.Output,
) -> int:
    """Check the inertial parameters in model files. Needs no simulator. Exits with 1 if
    there is an error.

    Example: equipoise audit my_robot.urdf
             equipoise audit --format github urdf/*.urdf

    Args:
        format: 'github' prints annotations for the lines of a change in a GitHub workflow; 'json' is --json.
    """
    from equipoise.terminal.results import print_audit

    if not robots:
        raise SettingsError("no robot is given; name a robot, or a URDF or MJCF file: equipoise audit my_robot.urdf")
    if format == "github":
        return max(_annotate(robot, description) for robot in robots)
    audits = [_audit(robot, description) for robot in robots]
    tables = [{"schema": "equipoise.audit/1", **result.to_dict()} for result in audits]
    output = replace(output, json=output.json or format == "json")
    output.write(tables[0] if len(tables) == 1 else tables, lambda: [print_audit(result) for result in audits])
    return max(map(_in_error, audits))


def _audit(robot: str, description: RobotDescription) -> Audit:
    from equipoise.robot.audit import audit as run

    with warnings.catch_warnings():  # the audit reports repairs itself
        warnings.simplefilter("ignore")
        return run(load_robot(robot, description))


def _annotate(robot: str, description: RobotDescription) -> int:
    """Print the annotations of one file; an unreadable file gives an annotation, so that other files are still checked."""
    from equipoise.terminal.annotations import annotation_lines, error_annotation

    try:
        result = _audit(robot, description)
    except ModelError as error:
        print(error_annotation(robot, error))
        return error.exit_code
    print("".join(f"{line}\n" for line in annotation_lines(robot, result)), end="")
    return _in_error(result)


def _in_error(result: Audit) -> int:
    return int(any(finding.severity == "error" for finding in result.findings))
