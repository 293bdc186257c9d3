"""`equipoise payload`."""

from __future__ import annotations

import json as json_module
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import arg
from tyro.constructors import StructConstructorSpec

from equipoise.cli.flags import Described, File, Output, Required, Robot, exit_code
from equipoise.cli.methods import DEFAULT_METHOD, method_from
from equipoise.cli.operator_prompt import with_known_imu
from equipoise.cli.parsing import ChosenFlags
from equipoise.cli.setting_flags import flags_of, optional, spec_of
from equipoise.cli.target import TARGET_FLAGS, RunTarget
from equipoise.errors import RecordingError, SettingsError
from equipoise.method.method import Method
from equipoise.method.table import settings_of
from equipoise.robot.catalog import load_robot
from equipoise.user_file import write_file

if TYPE_CHECKING:
    from equipoise.calibration.payload_measurement import PayloadMeasurement
    from equipoise.estimator.prior_runs.prior_run import PriorRun

_FLAGS = ("prior_run", "mass", "mass_std", "confirm_mass", "duration", "cable", "surface")
_REQUIRED = (
    "End with 11 where the answer is less than that, as identified,checks: what was added is identified, or nothing was; all "
    "checks passed; or mass, com_x and others of what was added."
)
PAYLOAD = "payload.json"


def payload(
    robot: Robot,
    *,
    out: File = None,
    fail_unless: Annotated[Required, arg(help=_REQUIRED)] = None,
    method: Method,
    description: Described,
    place: Annotated[RunTarget, arg(name="platform")],
    output: Output,
) -> int:
    """Find what is on a robot now beside its last calibration: mass, place and how
    sure, in half a minute and one line.

    It stands, moves over planted feet, lifts two feet some six times. Sensors, legs
    and friction are those of the run that --prior-run names; what changed since, as an
    encoder's zero, is said. Answers may be 'too small to matter', 'cannot tell'.

    Example: equipoise payload go2 --prior-run runs/last
             equipoise payload go2 --prior-run runs/last --mass 16.31 --json

    Args:
        out: Run folder; default runs/ROBOT-TIME.
    """
    from equipoise.bayesian.method import BayesianMethod
    from equipoise.calibration.payload_measurement import measure_payload
    from equipoise.calibration.routine import check
    from equipoise.cli.session import confirm, new_run, run_path
    from equipoise.result.requirements import read_requirements

    assert isinstance(method, BayesianMethod)
    required = read_requirements(fail_unless)
    if method.prior_run is None:
        raise SettingsError("name the run folder of this robot's last calibration: --prior-run RUN")
    model = with_known_imu(load_robot(robot, description), place.simulated)
    if not output.silent:
        print(model.imu.message, file=sys.stderr)
    check(model, method)
    confirm(place, model, method)
    out = run_path(model, out)
    with new_run(place, model, out, method) as run:
        result = run(output.silent)
    found = _with_truth(measure_payload(model, method.prior_run, result), method.prior_run)
    write_file(out / PAYLOAD, json_module.dumps(found.to_dict(), indent=2) + "\n")
    output.write(found.to_dict(), lambda: _print(found))
    return exit_code(required, found.verdicts)


def _payload_flags(arguments: Sequence[str]) -> StructConstructorSpec:
    """Return the flags of the settings of the Bayesian method that this verb has."""
    del arguments
    own = flags_of(settings_of(DEFAULT_METHOD))
    flags = [optional(flag) for flag in own if flag.name in _FLAGS]

    def method(values: Mapping[str, Any]) -> Method:
        return method_from(DEFAULT_METHOD, values)

    return spec_of("The prior run, the scale and the duration.", flags, method)


CHOSEN: dict[type, ChosenFlags] = {Method: (_payload_flags, None), RunTarget: TARGET_FLAGS}


def _with_truth(found: PayloadMeasurement, known: PriorRun) -> PayloadMeasurement:
    """Return the measurement with the ground truth, where both runs are simulated."""
    from equipoise.calibration.run_folder import RunFolder

    try:
        before = RunFolder.open(known.run).truth()
    except RecordingError:  # moved since: it was read whole
        return found
    if before is None or found.result.truth is None:
        return found
    return replace(found, change=found.change.with_truth(before, found.result.truth))


def _print(found: PayloadMeasurement) -> None:
    for failed in (check for check in found.result.checks if not check.passed):
        print(f"check failed: {failed.name}: {failed.message}")
    for warning in found.change.warnings:
        print(f"changed: {warning}")
    print(found.message)
