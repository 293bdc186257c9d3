"""`equipoise calibrate`."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime, timezone
from inspect import signature
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import arg

from equipoise.cli.flags import (
    Described,
    Duration,
    File,
    Hertz,
    Kilograms,
    Metres,
    Robot,
    Seconds,
    Verbose,
    interruption_told,
    load,
    seconds,
)
from equipoise.errors import SettingsError
from equipoise.robot.description import RobotDescription

_FLAGS_OF_METHOD = {
    "precise": ("budget", "mass", "mass_sd", "sway"),
    "paper": (
        "feet", "tolerance", "lower", "upper", "t_thres", "lift_height", "speed", "sway_amplitude", "sway_frequency",
        "sway_duration",
    ),
}  # fmt: skip


def calibrate(
    robot: Robot = "unitree_a1",
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
        pictures: PNG pictures are drawn unless this is given.
        json: Print the result as one JSON object and nothing else on stdout.
        quiet: No progress.
        verbose: Show how long each stage of the estimate took.
        debug: Show a traceback if something goes wrong.
    """
    _refuse_flags_of_other_methods(method, locals())
    from equipoise.calibration import CalibrationSettings, check
    from equipoise.calibration import calibrate as run
    from equipoise.experiments.precise_routine import PreciseSettings
    from equipoise.experiments.sway import SwaySettings
    from equipoise.experiments.trial_runner import ComSearchSettings
    from equipoise.outputs.terminal import TrialProgress, print_calibration
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
    model = load(robot, description_file, description)
    check(model, settings)
    now = datetime.now(timezone.utc)
    out = out or Path("runs") / f"{model.name}-{now:%Y%m%d-%H%M%S-%f}"
    facts = {"time": now.isoformat(timespec="seconds"), "platform": "mujoco", "noise": noise, "payload": payload}
    with simulate(model, noise, loaded, seed, start) as simulation:
        provenance = {**facts, "seed": seed, "mujoco": simulation.engine}
        folder = RunFolder.create(out, model, settings, provenance)
        folder.save_truth(simulation.truth)
        with interruption_told(folder), TrialProgress(quiet or json) as progress:
            result = run(simulation.platform, model, settings, folder.keep, progress.update)
    result = result.with_provenance(**provenance).with_truth(simulation.truth)
    folder.save(result)
    files = [folder.path / "calibration.json"]
    if pictures:
        from equipoise.outputs.pictures import save_pictures

        files += save_pictures(result, folder.path)
    if json:
        print(result.to_json(), end="")
    else:
        print_calibration(result, files, verbose)


def _refuse_flags_of_other_methods(method: str, given: Mapping[str, object]) -> None:
    """A flag that a method does not know would be ignored without a word."""
    defaults = signature(calibrate).parameters
    for owner, names in _FLAGS_OF_METHOD.items():
        for name in names:
            if owner != method and given[name] != defaults[name].default:
                flag = "no-sway" if name == "sway" else name.replace("_", "-")
                raise SettingsError(f"--{flag} belongs to --method {owner}; this is --method {method}")
