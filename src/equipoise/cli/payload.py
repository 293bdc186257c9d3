"""`equipoise payload`."""

from __future__ import annotations

import json as json_module
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import arg
from tyro.constructors import StructConstructorSpec

from equipoise.cli import print_message
from equipoise.cli.flags import Described, File, LogFormat, Output, Required, Robot, exit_code
from equipoise.cli.methods import DEFAULT_METHOD, method_from
from equipoise.cli.operator_prompt import with_imu_pose
from equipoise.cli.parsing import ChosenFlags
from equipoise.cli.setting_flags import flags_of, optional, spec_of
from equipoise.cli.target import TARGET_FLAGS, RunTarget
from equipoise.errors import RecordingError, SettingsError
from equipoise.method.method import Method
from equipoise.method.table import settings_of
from equipoise.robot.catalog import load_robot
from equipoise.user_file import write_file

if TYPE_CHECKING:
    from equipoise.bayesian.method import BayesianMethod
    from equipoise.calibration.payload_measurement import PayloadMeasurement
    from equipoise.estimator.prior_runs.prior_run import PriorRun
    from equipoise.robot.description import RobotDescription

_FLAGS = ("prior_run", "mass", "mass_std", "confirm_mass", "duration", "cable", "surface")
_REQUIRED = (
    "Exit with 11 unless all conditions are met, for example identified,checks. identified: the payload, or its absence, is "
    "identified; checks: all checks passed; mass, com_x, ...: that quantity of the payload is identified."
)
PAYLOAD = "payload.json"


def payload(
    robot: Robot,
    *,
    log: File = None,
    bare_log: File = None,
    out: File = None,
    fail_unless: Annotated[Required, arg(help=_REQUIRED)] = None,
    method: Method,
    description: Described,
    target: Annotated[RunTarget, arg(name="platform")],
    source: Annotated[LogFormat, arg(name="log format")],
    output: Output,
) -> int:
    """Measure the payload on the robot against an earlier run, in half a minute, or from
    a log: mass and CoM with intervals.

    The robot stands up, moves with all feet on the floor and lifts two feet about six
    times. Sensors, legs and friction come from --prior-run; parameters that changed
    since, such as a joint offset, are reported. The answer may also be 'too small to
    matter' or 'cannot tell'.

    Example: equipoise payload go2 --prior-run runs/last --mass 16.31 --json
             equipoise payload go2 --log bags/trot --prior-run runs/last --mass 17.3
             equipoise payload go2 --log bags/trot --prior-run runs/last --bare-log bags/bare

    Args:
        log: Log of a robot that trots for 20 s or more, instead of motions; without --prior-run against the model file.
        bare_log: Log of a walk without payload, read like --log: with --prior-run it replaces the scale.
        out: Run folder; default runs/ROBOT-TIME. With --log: file for the answer as JSON; default none.
    """
    from equipoise.bayesian.method import BayesianMethod
    from equipoise.calibration.payload_measurement import measure_payload
    from equipoise.calibration.routine import check
    from equipoise.cli.session import confirm, new_run, run_path
    from equipoise.result.requirements import read_requirements

    assert isinstance(method, BayesianMethod)
    required = read_requirements(fail_unless)
    if log is not None:
        if method.duration is not None or target != type(target)(target.platform):
            raise SettingsError(
                "--log: nothing moves; leave out --duration, --platform and the flags of the simulated robot"
            )
        if bare_log is not None and (method.prior_run is None or method.mass is not None):
            raise SettingsError("--bare-log replaces a scale after a prior run: pass --prior-run RUN, and no --mass")
        if bare_log is not None and source.tables:
            raise SettingsError(
                "--bare-log: further tables would belong to both logs; join each log's tables in one file"
            )
        return _from_log(log, bare_log, robot, description, source, method, out, required, output)
    if source != LogFormat() or bare_log is not None:
        raise SettingsError(
            "tables, topics, --joint-map, --columns, --rate, --from, --until and --bare-log are for --log; pass --log too"
        )
    if method.prior_run is None:
        raise SettingsError(
            "no prior run is given; pass this robot's last run folder: --prior-run RUN; or the log of a walk: --log LOG"
        )
    model = with_imu_pose(load_robot(robot, description), target.simulated)
    if not output.silent:
        print_message(model.imu.line)
    check(model, method)
    confirm(target, model, method)
    out = run_path(model, out)
    with new_run(target, model, out, method) as run:
        result = run(output.silent)
    measurement = _with_truth(measure_payload(model, method.prior_run, result), method.prior_run)
    write_file(out / PAYLOAD, json_module.dumps(measurement.to_dict(), indent=2) + "\n")
    output.write(measurement.to_dict(), lambda: _print(measurement, out / PAYLOAD))
    return exit_code(required, measurement.verdicts)


def _from_log(
    log: Path,
    bare_log: Path | None,
    robot: str,
    description: RobotDescription,
    source: LogFormat,
    method: BayesianMethod,
    out: Path | None,
    required: Sequence[str],
    output: Output,
) -> int:
    """Print the payload in a log, and save it to `out`; return the exit code."""
    from equipoise.logs.payload import measure_payload_in_log, naming_bare_log

    model = with_imu_pose(load_robot(robot, description))
    content, bare = source.read(log, model, not output.silent), None
    if bare_log is not None:
        with naming_bare_log():
            bare = source.read(bare_log, model, not output.silent)
    with output.reporting_failed_log():
        measurement, report = measure_payload_in_log(model, content, method, bare)
    table = {**measurement.to_dict(), "log": report.to_dict()}
    if out is not None:
        write_file(out, json_module.dumps(table, indent=2) + "\n")
    output.write(table, lambda: _print(measurement, out))
    return exit_code(required, measurement.verdicts)


def _payload_flags(arguments: Sequence[str]) -> StructConstructorSpec:
    """Return the flags of the Bayesian method that this verb has."""
    del arguments
    flags = [optional(flag) for flag in flags_of(settings_of(DEFAULT_METHOD)) if flag.name in _FLAGS]

    def method(values: Mapping[str, Any]) -> Method:
        return method_from(DEFAULT_METHOD, values)

    return spec_of("Prior run, scale and duration.", flags, method)


CHOSEN: dict[type, ChosenFlags] = {Method: (_payload_flags, None), RunTarget: TARGET_FLAGS}


def _with_truth(measurement: PayloadMeasurement, prior_run: PriorRun) -> PayloadMeasurement:
    """Return the measurement with the ground truth if both runs are simulated."""
    from equipoise.calibration.run_folder import RunFolder

    try:
        before = RunFolder.open(prior_run.run).truth()
    except RecordingError:  # the folder was moved after the prior run was read
        return measurement
    truth = measurement.result.truth
    if before is None or truth is None:
        return measurement
    return replace(measurement, change=measurement.change.with_truth(before, truth))


def _print(measurement: PayloadMeasurement, saved: Path | None) -> None:
    from equipoise.terminal.several_runs import print_payload_truth

    for failed in (check for check in measurement.result.checks if not check.passed):
        print(f"check failed: {failed.name}: {failed.message}")
    for warning in measurement.change.warnings:
        print(f"changed: {warning}")
    print(measurement.message)
    print_payload_truth(measurement.change)
    if saved is not None:
        print(f"saved: {saved}")
