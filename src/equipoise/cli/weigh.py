"""`equipoise weigh`."""

from __future__ import annotations

import json as json_module
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any

from equipoise.cli.calibrate import begun, placed, run_into
from equipoise.cli.flags import Described, File, Output, Required, Robot, RobotFlags, exit_code, interruption_told, load
from equipoise.cli.operator_prompt import with_known_imu
from equipoise.cli.session import Session, confirm
from equipoise.cli.settings import SettingFlag, Verb, flags_class, given_flags, settings_of
from equipoise.errors import RecordingError, SettingsError
from equipoise.user_file import write_file

if TYPE_CHECKING:
    from equipoise.calibration.weighing import Weighing
    from equipoise.estimator.known.known_run import KnownRun

_FLAGS = {
    "known": "known",
    "mass": "scale",
    "mass_sd": "scale_sd",
    "confirm_mass": "confirm_mass",
    "budget": "budget",
    "cable": "cable",
    "surface": "surface",
}
WEIGHING = "weighing.json"


@dataclass(frozen=True)
class WeighOutput(Output):
    """What is written and shown.

    Attributes:
        out: Run folder; default runs/ROBOT-TIME.
        require: End with 11 where the answer is less than that, as identified,checks: what was added is identified, or nothing
            was; all checks passed; or mass, com_x and others of what was added.
    """

    out: File = None
    require: Required = None


def weigh(
    robot: Robot,
    *,
    method: Any = None,
    description: Described = RobotFlags(),  # noqa: B008
    place: Any = None,
    output: WeighOutput = WeighOutput(),
) -> int:
    """Find what is on a robot now beside its last calibration: mass, place and how sure, in half a minute and one line.

    It stands, moves over planted feet, lifts two feet some six times. Sensors, legs and friction are those of the run that
    --known names; what changed since, as an encoder's zero, is said. Answers may be 'too small to matter', 'cannot tell'.

    Example: equipoise weigh go2 --known runs/last
             equipoise weigh go2 --known runs/last --scale 16.31 --json
    """
    from equipoise.calibration.routine import check
    from equipoise.calibration.weighing import weigh as weighed
    from equipoise.precise.method import Precise
    from equipoise.result.requirements import read_requirements

    given, where, required = given_flags(method), place.place(), read_requirements(output.require)
    if "known" not in given:
        raise SettingsError("name the run folder of this robot's last calibration: --known RUN")
    asked = Precise(**given)
    model = with_known_imu(load(robot, description), where.simulated)
    if not output.silent:
        print(model.imu.sentence, file=sys.stderr)
    assert asked.known is not None
    check(model, asked)
    confirm(where, model, asked, getattr(place, "yes", True))
    now = datetime.now(timezone.utc)
    out = output.out or Path("runs") / f"{model.name}-{now:%Y%m%d-%H%M%S-%f}"
    with Session(where, model) as session:
        folder = begun(session, out, asked, {"time": now.isoformat(timespec="seconds")})
        with interruption_told(folder):
            result = run_into(session, folder, asked, output.silent)
    found = _with_truth(weighed(model, asked.known, result), asked.known)
    write_file(out / WEIGHING, json_module.dumps(found.to_dict(), indent=2) + "\n")
    if output.json:
        print(json_module.dumps(found.to_dict(), indent=2))
    else:
        _print(found)
    return exit_code(required, found.verdicts)


def weigh_for(arguments: Sequence[str]) -> Verb:
    """`weigh` with the flags of the platform that is asked for; raises SettingsError."""
    from equipoise.precise.method import Precise

    settings = [_renamed(setting) for setting in settings_of(Precise, tuple(_FLAGS))]
    return placed(weigh, arguments, flags_class("WeighFlags", "What is known, and how to weigh.", settings))


def _renamed(setting: SettingFlag) -> SettingFlag:
    renamed = replace(setting, name=_FLAGS[setting.name])
    return renamed if setting.kind is bool else renamed.or_none()


def _with_truth(found: Weighing, known: KnownRun) -> Weighing:
    """Beside the truth, where both runs are simulated."""
    from equipoise.calibration.run_folder import RunFolder

    try:
        before = RunFolder.open(known.run).truth()
    except RecordingError:  # moved since: it was read whole
        return found
    if before is None or found.result.truth is None:
        return found
    return replace(found, delta=found.delta.with_truth(before, found.result.truth))


def _print(found: Weighing) -> None:
    for check in found.result.checks:
        if not check.passed:
            print(f"check failed: {check.name}: {check.message}")
    for warning in found.delta.warnings:
        print(f"changed: {warning}")
    print(found.sentence)
