"""`equipoise weigh`."""

from __future__ import annotations

import json as json_module
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import arg
from tyro.constructors import StructConstructorSpec

from equipoise.cli.flags import Described, File, Output, Required, Robot, exit_code
from equipoise.cli.methods import DEFAULT_METHOD, OF_WEIGH, method_from, refuse_other_name
from equipoise.cli.operator_prompt import with_known_imu
from equipoise.cli.parsing import ChosenFlags
from equipoise.cli.place import PLACE_FLAGS, Place
from equipoise.cli.setting_flags import flags_of, optional, spec_of
from equipoise.errors import RecordingError, SettingsError
from equipoise.method.method import Method
from equipoise.method.table import settings_of
from equipoise.robot.catalog import load_robot
from equipoise.user_file import write_file

if TYPE_CHECKING:
    from equipoise.calibration.weighing import Weighing
    from equipoise.estimator.known.known_run import KnownRun

_NAMES = {name: flag for flag, name in OF_WEIGH.items()}
_FLAGS = {name: _NAMES.get(name, name) for name in (
    "known", "mass", "mass_sd", "confirm_mass", "budget", "cable", "surface")}  # fmt: skip
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
    method: Method,
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
    from equipoise.calibration.routine import check
    from equipoise.calibration.weighing import weigh as weighed
    from equipoise.cli.session import confirm, new_run, run_path
    from equipoise.precise.method import Precise
    from equipoise.result.requirements import read_requirements

    assert isinstance(method, Precise)
    required = read_requirements(require)
    if method.known is None:
        raise SettingsError("name the run folder of this robot's last calibration: --known RUN")
    model = with_known_imu(load_robot(robot, description), place.simulated)
    if not output.silent:
        print(model.imu.sentence, file=sys.stderr)
    check(model, method)
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
    own = flags_of(settings_of(DEFAULT_METHOD))
    flags = [optional(replace(flag, name=_FLAGS[flag.name])) for flag in own if flag.name in _FLAGS]

    def method(values: Mapping[str, Any]) -> Method:
        return method_from(DEFAULT_METHOD, {name: values[flag] for name, flag in _FLAGS.items()})

    return spec_of("What is known, and how to weigh.", flags, method)


def _refuse_other(flag: str, arguments: Sequence[str]) -> None:
    """Raise SettingsError for a flag that has another name here."""
    del arguments
    refuse_other_name(flag, _NAMES)


CHOSEN: dict[type, ChosenFlags] = {Method: (_weigh_flags, _refuse_other), Place: PLACE_FLAGS}


def _with_truth(found: Weighing, known: KnownRun) -> Weighing:
    """Return the measurement with the ground truth, where both runs are simulated."""
    from equipoise.calibration.run_folder import RunFolder

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
