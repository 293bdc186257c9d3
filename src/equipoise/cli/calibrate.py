"""`equipoise calibrate`."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from datetime import datetime, timezone
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import arg

from equipoise.cli.flags import (
    Described,
    Duration,
    File,
    Hertz,
    Kilograms,
    Metres,
    RobotOrNone,
    Seconds,
    Verbose,
    interruption_told,
    load,
    seconds,
)
from equipoise.errors import ResumeError, SettingsError
from equipoise.robot.description import RobotDescription

if TYPE_CHECKING:
    from equipoise.calibration import CalibrationSettings
    from equipoise.platforms.platform import Platform
    from equipoise.platforms.simulation import Simulation
    from equipoise.result import Calibration
    from equipoise.robot.model import RobotModel
    from equipoise.run_folder import RunFolder

_DEFAULT_ROBOT = "unitree_a1"
_FLAGS_OF_RESUME = ("resume", "pictures", "json", "quiet", "verbose", "debug")

_FLAGS_OF_METHOD = {
    "precise": ("budget", "mass", "mass_sd", "sway"),
    "paper": (
        "feet", "tolerance", "lower", "upper", "t_thres", "lift_height", "speed", "sway_amplitude", "sway_frequency",
        "sway_duration",
    ),
}  # fmt: skip


def calibrate(
    robot: RobotOrNone = None,
    *,
    method: Literal["precise", "paper", "static"] = "precise",
    budget: Duration = None,
    mass: Kilograms = None,
    mass_sd: Kilograms = None,
    sway: bool = True,
    feet: Literal["measured", "commanded"] = "measured",
    noise: Literal["ideal", "realistic"] = "ideal",
    payload: Annotated[str | None, arg(metavar="M,X,Y,Z", help_behavior_hint="")] = None,
    start: Literal["standing", "lying"] = "standing",
    seed: int = 0,
    tolerance: float = 0.005,
    lower: Metres = None,
    upper: Metres = None,
    t_thres: Seconds = None,
    lift_height: Metres = None,
    speed: float = 1.0,
    sway_amplitude: float = 0.05,
    sway_frequency: Hertz = None,
    sway_duration: Seconds = None,
    description_file: File = None,
    description: Described = RobotDescription(),  # noqa: B008
    out: File = None,
    resume: Annotated[Path | None, arg(metavar="RUN", help_behavior_hint="")] = None,
    pictures: bool = True,
    json: bool = False,
    quiet: bool = False,
    verbose: Verbose = False,
    debug: bool = False,
) -> None:
    """Find a quadruped's mass, centre of mass and inertia, in simulation.

    precise: the robot lifts two diagonal feet in many postures, at rest and turning its body, and feels how it tips; its
    sensors are calibrated on the way. paper: a bisection finds the planar centre of mass (Algorithms 1 and 2), sways give
    moments of inertia (equations 2 to 5). static: what the joint torques of the standing robot say.
    The run folder keeps every recording.

    Example: equipoise calibrate go2 --noise realistic --payload 1.5,0.1,0,0.08 --seed 3 --out runs/go2
             equipoise calibrate --resume runs/go2

    Args:
        method: What to do.
        budget: precise: robot time, as 60s, 120s or 2min; default 120 s on an A1, more on larger robots.
        mass: precise: of the whole robot, from a scale [kg]; without it the mass comes from joint torques.
        mass_sd: precise: how sure the scale is [kg]; default 0.5 %.
        sway: precise: sway about all axes at the end unless this is given.
        feet: paper: support lines through the feet as the encoders measure them, or as they were commanded.
        noise: Sensor and actuator errors of the simulated robot.
        payload: MASS,X,Y,Z or MASS,X,Y,Z,IXX,IYY,IZZ: kg, m in the base frame, kg m2 about its own CoM.
        start: How the simulated robot begins (and ends).
        seed: Of everything drawn.
        tolerance: paper: the search ends when the bounds of the offset are this close [m].
        lower: paper: lower search bound of the offset [m]; default by the robot's size.
        upper: paper: upper search bound of the offset [m]; default by the robot's size.
        t_thres: paper: how long two feet stay up [s]; default by the robot's size.
        lift_height: paper: of the first lift [m]; default 5 % of the hip height.
        speed: paper: factor on the speed between trials.
        sway_amplitude: paper: of the sway [rad].
        sway_frequency: paper: of the sway [Hz]; default by the robot's size.
        sway_duration: paper: of the steady sway [s]; default six periods.
        description_file: TOML file with a robot description; flags win over it.
        out: Run folder; default runs/ROBOT-TIME.
        resume: Go on with the run in this folder behind its last complete trial, as it began: no other settings may be given.
        pictures: PNG pictures are drawn unless this is given.
        json: Print the result as one JSON object and nothing else on stdout.
        quiet: No progress.
        verbose: Show how long each stage of the estimate took.
        debug: Show a traceback if something goes wrong.
    """
    given = locals()
    if resume is not None:
        _refuse_flags_beside_resume(given)
        _show(*_resumed(resume, quiet or json), pictures, json, verbose)
        return
    _refuse_flags_of_other_methods(method, given)
    from equipoise.calibration import CalibrationSettings, check
    from equipoise.experiments.precise_routine import PreciseSettings
    from equipoise.experiments.sway import SwaySettings
    from equipoise.experiments.trial_runner import ComSearchSettings
    from equipoise.platforms.logged import Logged
    from equipoise.platforms.payload import Payload
    from equipoise.platforms.simulation import simulate
    from equipoise.run_folder import RunFolder

    settings = CalibrationSettings(
        method,
        feet,
        ComSearchSettings(lower, upper, tolerance, lift_height, t_thres, speed),
        SwaySettings(sway_amplitude, sway_frequency, sway_duration),
        PreciseSettings(seconds(budget), mass, mass_sd, sway),
    )
    loaded = Payload.parse(payload) if payload is not None else None
    model = load(robot or _DEFAULT_ROBOT, description_file, description)
    check(model, settings)
    now = datetime.now(timezone.utc)
    out = out or Path("runs") / f"{model.name}-{now:%Y%m%d-%H%M%S-%f}"
    facts = {
        "time": now.isoformat(timespec="seconds"), "platform": "mujoco", "noise": noise, "payload": payload, "start": start,
        "seed": seed,
    }  # fmt: skip
    with simulate(model, noise, loaded, seed, start) as simulation:
        with RunFolder.create(out, model, settings, {**facts, "mujoco": simulation.engine}) as folder:
            folder.save_truth(simulation.truth)
            result = _run(Logged(simulation.platform, folder.log), model, settings, folder, quiet or json)
        result = result.with_truth(simulation.truth)
    folder.save(result)
    _show(result, folder, pictures, json, verbose)


def _run(
    platform: Platform, model: RobotModel, settings: CalibrationSettings, folder: RunFolder, quiet: bool
) -> Calibration:
    from equipoise.calibration import calibrate as run
    from equipoise.outputs.terminal import TrialProgress

    with interruption_told(folder), TrialProgress(quiet) as progress:
        result = run(platform, model, settings, folder.keep, progress.update)
    return result.with_provenance(**folder.provenance)


def _resumed(path: Path, quiet: bool) -> tuple[Calibration, RunFolder]:
    """The result of a run that is gone on with, and its folder."""
    from equipoise.platforms.logged import Logged
    from equipoise.platforms.resumed import RepeatedSimulation
    from equipoise.run_folder import RunFolder

    folder = RunFolder.open(path)
    if folder.complete:
        print(f"the run in {path} is complete; this is what its recordings say", file=sys.stderr)
        return folder.estimate(), folder
    model, settings = folder.robot(), folder.settings()
    with _simulated_again(folder, model) as simulation:
        folder, content = RunFolder.resume(path, repeats=True)
        with folder:
            folder.save_truth(simulation.truth)
            platform = RepeatedSimulation(Logged(simulation.platform, folder.log), simulation.platform, content)
            result = _run(platform, model, settings, folder, quiet)
        result = result.with_truth(simulation.truth)
    folder.save(result)
    return result, folder


def _simulated_again(folder: RunFolder, model: RobotModel) -> Simulation:
    """The robot that a run was made on."""
    from equipoise.platforms.simulation import simulate

    facts = folder.provenance
    missing = [name for name in ("platform", "noise", "payload", "seed", "start") if name not in facts]
    if missing or facts["platform"] != "mujoco":
        why = f"does not say its {missing[0]}" if missing else f"was made on {facts['platform']!r}"
        raise ResumeError(
            f"the run {str(folder.path)!r} {why}; only runs of 'equipoise calibrate' in simulation can be resumed"
        )
    return simulate(model, facts["noise"], facts["payload"], facts["seed"], facts["start"])


def _show(result: Calibration, folder: RunFolder, pictures: bool, json: bool, verbose: bool) -> None:
    from equipoise.outputs.terminal import print_calibration

    files = [folder.path / "calibration.json"]
    if pictures:
        from equipoise.outputs.pictures import save_pictures

        files += save_pictures(result, folder.path)
    if json:
        print(result.to_json(), end="")
    else:
        print_calibration(result, files, verbose)


def _refuse_flags_beside_resume(given: Mapping[str, object]) -> None:
    """A run goes on as it began: a flag that would change it would be ignored without a word."""
    for name, parameter in signature(calibrate).parameters.items():
        if name not in _FLAGS_OF_RESUME and given[name] != parameter.default:
            what = "a robot" if name == "robot" else f"--{_flag(name)}"
            raise SettingsError(f"--resume goes on as the run began; {what} cannot be given with it")


def _refuse_flags_of_other_methods(method: str, given: Mapping[str, object]) -> None:
    """A flag that a method does not know would be ignored without a word."""
    defaults = signature(calibrate).parameters
    for owner, names in _FLAGS_OF_METHOD.items():
        for name in names:
            if owner != method and given[name] != defaults[name].default:
                raise SettingsError(f"--{_flag(name)} belongs to --method {owner}; this is --method {method}")


def _flag(name: str) -> str:
    return "no-sway" if name == "sway" else name.replace("_", "-")
