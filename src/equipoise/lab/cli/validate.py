"""`equipoise lab validate`."""

from __future__ import annotations

import json as json_module
from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from equipoise.calibration.run_folder import RunFolder
from equipoise.calibration.run_header import HEADER
from equipoise.cli.flags import Described, File, LogFlags, Output, Run, open_run
from equipoise.cli.inspect import estimate_from_log
from equipoise.lab.replay.validation import validate as replay_lifts
from equipoise.lab.terminal import print_validation
from equipoise.result.calibration import Calibration
from equipoise.robot.catalog import load_robot
from equipoise.robot.description import RobotDescription
from equipoise.robot.model import RobotModel
from equipoise.user_file import write_file

VALIDATION = "validation.json"


def validate(
    run: Run,
    *,
    against: Annotated[tuple[str, ...], arg(metavar="MODEL", help_behavior_hint="")] = (),
    out: File = None,
    source: Annotated[LogFlags, arg(name="log")],
    description: Described,
    output: Output,
) -> None:
    """Replay a run's lifts in simulation with the estimated body and with the model
    file's, and compare how they tip.

    Joints follow their measured positions; the base is free once two feet are off
    the floor. The printed ratio is the tilt error of the model file's body over that
    of the estimated body. A page shows each lift.

    Example: equipoise lab validate runs/go2
             equipoise lab validate runs/second --against runs/first go2_payload.urdf

    Args:
        against: Other bodies to replay: robots by name, model files, or run folders of the same robot.
        out: JSON file for the result, with the page next to it; default validation.json in the run's folder.
    """
    from equipoise.lab.pages.validation_page import validation_page
    from equipoise.report.page import save_page

    if source.robot is None:
        result = open_run(run, source, description).estimate()
    else:
        result = estimate_from_log(run, source, description, {}, output).result
    validation = replay_lifts(result, {name: _body(name, description) for name in against})
    text = json_module.dumps(validation.to_dict(), indent=2) + "\n"
    file = out or (run / VALIDATION if (run / HEADER).is_file() else None)
    files: list[Path] = []
    if file is not None:
        write_file(file, text)
        files = [file, save_page(validation_page(validation), file.with_suffix(".html"))]
    if output.json:
        print(text, end="")
    else:
        print_validation(validation, files)


def _body(name: str, description: RobotDescription) -> RobotModel | Calibration:
    return RunFolder.open(name).result() if (Path(name) / HEADER).is_file() else load_robot(name, description)
