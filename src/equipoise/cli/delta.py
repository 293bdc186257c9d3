"""`equipoise delta`."""

from __future__ import annotations

import json as json_module
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from equipoise.calibration.run_header import read_header
from equipoise.cli.flags import File, Kilograms, Output
from equipoise.errors import SettingsError
from equipoise.user_file import write_file

if TYPE_CHECKING:
    from equipoise.calibration.run_folder import RunFolder
    from equipoise.estimator.known.two_runs import ScaleReadings
    from equipoise.precise.method import Precise
    from equipoise.robot.model import RobotModel


def delta(
    before: Annotated[Positional[Path], arg(metavar="BEFORE", help="Run folder of a calibration.")],
    after: Annotated[Positional[Path], arg(metavar="AFTER", help="Run folder of a calibration of the same robot.")],
    *,
    mass_before: Kilograms = None,
    mass_after: Kilograms = None,
    scale_gain: float = 0.005,
    scale_noise: float = 0.001,
    out: File = None,
    output: Output,
) -> None:
    """Find what was added to a robot between two calibrations, or taken off: its mass,
    centre of mass and inertia.

    Both runs are estimated together: joint zeros, the IMU's mounting and a scale's
    factor are the same in both, and cancel. The robot may have been switched off in
    between, not taken apart.

    Example: equipoise delta runs/a runs/b --mass-before 15.1 --mass-after 16.3

    Args:
        mass_before: Of the whole robot, from a scale [kg]; default as in the run.
        mass_after: The same, from the same scale [kg].
        scale_gain: By how much the scale is off in both, as a fraction (one standard deviation).
        scale_noise: By how much a single reading is off beside that, as a fraction of the mass.
        out: JSON file to save the result in.
    """
    headers = read_header(before), read_header(after)
    from equipoise.calibration.delta import find_delta
    from equipoise.calibration.run_folder import RunFolder
    from equipoise.method.together import of_the_base
    from equipoise.terminal.several_runs import print_delta

    folders = RunFolder(before, headers[0]), RunFolder(after, headers[1])
    robot, methods = _shared_robot(*folders), (_precise(folders[0]), _precise(folders[1]))
    scale = _scale(methods, (mass_before, mass_after), scale_gain, scale_noise)
    first, second = (of_the_base(folder.recordings()) for folder in folders)
    found = find_delta(robot, first, second, scale, methods[0].beliefs)
    truths = [folder.truth() for folder in folders]
    if truths[0] is not None and truths[1] is not None:
        found = found.with_truth(truths[0], truths[1])
    found = replace(found, provenance={"before": str(before), "after": str(after), "masses": scale.masses})
    if out is not None:
        write_file(out, json_module.dumps(found.to_dict(), indent=2) + "\n")
    output.write(found.to_dict(), lambda: print_delta(found))
    if out is not None and not output.json:
        print(f"saved: {out}")


def _shared_robot(before: RunFolder, after: RunFolder) -> RobotModel:
    """The robot of two runs that can be compared; raises SettingsError if they cannot."""
    if before.path.resolve() == after.path.resolve():
        raise SettingsError(f"{str(after.path)!r} is named twice; what was added shows between two runs")
    models = [folder.robot() for folder in (before, after)]
    if models[0].source.xml != models[1].source.xml or models[0].description != models[1].description:
        raise SettingsError(
            f"the runs are of different models, {models[0].name!r} and {models[1].name!r}: what was added shows only between "
            "runs with the same model file and description"
        )
    return models[0]


def _precise(folder: RunFolder) -> Precise:
    from equipoise.method.together import Together
    from equipoise.precise.method import Precise

    method = folder.method()
    method = method.base if isinstance(method, Together) else method
    if not isinstance(method, Precise):
        raise SettingsError(
            f"the run {str(folder.path)!r} is of the method {method.name!r}; what was added is told by runs of "
            f"{Precise.name!r}"
        )
    return method


def _scale(
    methods: tuple[Precise, Precise], given: tuple[float | None, float | None], gain: float, noise: float
) -> ScaleReadings:
    from equipoise.estimator.known.two_runs import ScaleReadings

    before, after = (mass if mass is not None else method.mass for method, mass in zip(methods, given, strict=True))
    return ScaleReadings((before, after), gain, noise)
