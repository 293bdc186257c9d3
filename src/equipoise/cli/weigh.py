"""`equipoise weigh`."""

from __future__ import annotations

import json as json_module
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any

from tyro.conf import arg
from tyro.constructors import StructConstructorSpec

from equipoise.calibration.routine import check as check_settings
from equipoise.calibration.run_folder import RunFolder
from equipoise.calibration.weighing import Weighing
from equipoise.calibration.weighing import weigh as weighed
from equipoise.cli.flags import Described, File, Output, Required, Robot, exit_code
from equipoise.cli.operator_prompt import with_known_imu
from equipoise.cli.parsing import ChosenFlags
from equipoise.cli.session import PLACE_FLAGS, Place, confirm, new_run, run_path
from equipoise.cli.setting_flags import flags_of, optional, settings_from, spec_of
from equipoise.errors import RecordingError, SettingsError
from equipoise.estimator.known.known_run import KnownRun
from equipoise.precise.method import Precise
from equipoise.result.requirements import read_requirements
from equipoise.robot.catalog import load_robot
from equipoise.user_file import write_file

_FLAGS = {
    "known": "known",
    "mass": "scale",
    "mass_sd": "scale_sd",
    "confirm_mass": "confirm_mass",
    "budget": "budget",
    "cable": "cable",
    "surface": "surface",
}
_REQUIRED = (
    "End with 11 where the answer is less than that, as identified,checks: what was added is identified, or nothing was; all "
    "checks passed; or mass, com_x and others of what was added."
)
WEIGHING = "weighing.json"


def weigh(
    robot: Robot,
    *,
    out: File = None,
    require: Annotated[Required, arg(help=_REQUIRED)] = None,
    method: Precise,
    description: Described,
    place: Annotated[Place, arg(name="platform")],
    output: Output,
) -> int:
    """Find what is on a robot now beside its last calibration: mass, place and how
    sure, in half a minute and one line.

    It stands, moves over planted feet, lifts two feet some six times. Sensors, legs
    and friction are those of the run that --known names; what changed since, as an
    encoder's zero, is said. Answers may be 'too small to matter', 'cannot tell'.

    Example: equipoise weigh go2 --known runs/last
             equipoise weigh go2 --known runs/last --scale 16.31 --json

    Args:
        out: Run folder; default runs/ROBOT-TIME.
    """
    required = read_requirements(require)
    if method.known is None:
        raise SettingsError("name the run folder of this robot's last calibration: --known RUN")
    model = with_known_imu(load_robot(robot, description), place.simulated)
    if not output.silent:
        print(model.imu.sentence, file=sys.stderr)
    check_settings(model, method)
    confirm(place, model, method)
    out = run_path(model, out)
    with new_run(place, model, out, method) as run:
        result = run(output.silent)
    found = _with_truth(weighed(model, method.known, result), method.known)
    write_file(out / WEIGHING, json_module.dumps(found.to_dict(), indent=2) + "\n")
    output.write(found.to_dict(), lambda: _print(found))
    return exit_code(required, found.verdicts)


def _weigh_flags(arguments: Sequence[str]) -> StructConstructorSpec:
    """Return the settings of the precise method that matter here, under the names that they have here."""
    del arguments
    flags = [optional(replace(flag, name=_FLAGS[flag.name])) for flag in flags_of(Precise) if flag.name in _FLAGS]

    def method(values: Mapping[str, Any]) -> Precise:
        return settings_from(Precise, {name: values[flag] for name, flag in _FLAGS.items()})

    return spec_of("What is known, and how to weigh.", flags, method)


CHOSEN: dict[type, ChosenFlags] = {Precise: (_weigh_flags, None), Place: PLACE_FLAGS}


def _with_truth(found: Weighing, known: KnownRun) -> Weighing:
    """Beside the truth, where both runs are simulated."""
    try:
        before = RunFolder.open(known.run).truth()
    except RecordingError:  # moved since: it was read whole
        return found
    if before is None or found.result.truth is None:
        return found
    return replace(found, delta=found.delta.with_truth(before, found.result.truth))


def _print(found: Weighing) -> None:
    for failed in (check for check in found.result.checks if not check.passed):
        print(f"check failed: {failed.name}: {failed.message}")
    for warning in found.delta.warnings:
        print(f"changed: {warning}")
    print(found.sentence)
