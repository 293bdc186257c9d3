"""`equipoise compare`."""

from __future__ import annotations

import json as json_module
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from equipoise.calibration.run_header import read_header
from equipoise.cli.flags import File, Output
from equipoise.errors import SettingsError
from equipoise.user_file import write_file

if TYPE_CHECKING:
    from equipoise.bayesian.method import BayesianMethod
    from equipoise.calibration.run_folder import RunFolder
    from equipoise.robot.model import RobotModel


def compare(
    before: Annotated[Positional[Path], arg(metavar="BEFORE", help="Run folder of a calibration.")],
    after: Annotated[Positional[Path], arg(metavar="AFTER", help="Run folder of a calibration of the same robot.")],
    *,
    mass: Annotated[tuple[float, float] | None, arg(metavar="KG KG", help_behavior_hint="")] = None,
    scale_gain_std: float = 0.005,
    scale_noise_std: float = 0.001,
    out: File = None,
    output: Output,
) -> None:
    """Compute the payload that was added or removed between two calibrations: its mass,
    centre of mass and inertia.

    Both runs are estimated together, so that joint offsets, the IMU's mounting and
    the scale's gain error cancel. Between the runs the robot may be switched off but
    not disassembled.

    Example: equipoise compare runs/a runs/b --mass 15.1 16.3

    Args:
        mass: Masses of the whole robot before and after, from one scale [kg]; default: those of the runs.
        scale_gain_std: Standard deviation of the error that both scale readings share, as a fraction of the mass.
        scale_noise_std: Standard deviation of the error of each single reading, as a fraction of the mass.
        out: JSON file to save the result in.
    """
    headers = read_header(before), read_header(after)
    from equipoise.calibration.payload_change import find_payload_change
    from equipoise.calibration.run_folder import RunFolder
    from equipoise.estimator.prior_runs.two_runs import ScaleReadings
    from equipoise.method.combined import base_recordings
    from equipoise.terminal.several_runs import print_payload_change

    folders = RunFolder(before, headers[0]), RunFolder(after, headers[1])
    robot, methods = _shared_robot(*folders), (_bayesian(folders[0]), _bayesian(folders[1]))
    masses = mass or (methods[0].mass, methods[1].mass)
    scale = ScaleReadings(masses, scale_gain_std, scale_noise_std)
    first, second = (base_recordings(folder.recordings()) for folder in folders)
    change = find_payload_change(robot, first, second, scale, methods[0].combined_priors)
    truths = [folder.truth() for folder in folders]
    if truths[0] is not None and truths[1] is not None:
        change = change.with_truth(truths[0], truths[1])
    provenance = {
        "before": str(before), "after": str(after), "masses": scale.masses,
        "scale_gain_std": scale_gain_std, "scale_noise_std": scale_noise_std,
    }  # fmt: skip
    change = replace(change, provenance=provenance)
    if out is not None:
        write_file(out, json_module.dumps(change.to_dict(), indent=2) + "\n")
    output.write(change.to_dict(), lambda: print_payload_change(change))
    if out is not None and not output.json:
        print(f"saved: {out}")


def _shared_robot(before: RunFolder, after: RunFolder) -> RobotModel:
    """Return the robot of two runs; raises SettingsError if they cannot be compared."""
    if before.path.resolve() == after.path.resolve():
        raise SettingsError(f"{str(after.path)!r} is named twice; give two different runs")
    models = [folder.robot() for folder in (before, after)]
    if models[0].source.xml != models[1].source.xml or models[0].description != models[1].description:
        raise SettingsError(
            f"the runs have different models, {models[0].name!r} and {models[1].name!r}; compare runs of the same "
            "model file and robot configuration"
        )
    return models[0]


def _bayesian(folder: RunFolder) -> BayesianMethod:
    from equipoise.bayesian.method import BayesianMethod
    from equipoise.method.combined import CombinedMethod

    method = folder.method()
    method = method.base if isinstance(method, CombinedMethod) else method
    if not isinstance(method, BayesianMethod):
        raise SettingsError(
            f"the run {str(folder.path)!r} is of the method {method.name!r}; compare runs of the method "
            f"{BayesianMethod.name!r}"
        )
    return method
