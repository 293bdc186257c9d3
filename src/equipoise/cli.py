"""The command line: one function per verb, and what they print. No arithmetic."""

from __future__ import annotations

import dataclasses
import json as json_module
import os
import re
import sys
import traceback
import warnings
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from datetime import datetime, timezone
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from tyro.conf import OmitArgPrefixes, Positional, arg

from equipoise import _version
from equipoise.cli_balance import balance
from equipoise.errors import EquipoiseError, OutputError, SettingsError
from equipoise.robot.description import RobotDescription

INTERRUPTED = 130

Robot = Annotated[Positional[str], arg(metavar="ROBOT", help="Name (see 'equipoise robots'), or a URDF or MJCF file.")]
Described = Annotated[RobotDescription, arg(name="", help="What the model file leaves out or gets wrong.")]
# An option whose default is found at run time: its help says how.
Metres = Annotated[float | None, arg(metavar="METRES", help_behavior_hint="")]
Seconds = Annotated[float | None, arg(metavar="SECONDS", help_behavior_hint="")]
Hertz = Annotated[float | None, arg(metavar="HERTZ", help_behavior_hint="")]
Kilograms = Annotated[float | None, arg(metavar="KG", help_behavior_hint="")]
Duration = Annotated[str | None, arg(metavar="TIME", help_behavior_hint="")]
Verbose = Annotated[bool, arg(aliases=["-v"])]
File = Annotated[Path | None, arg(metavar="PATH", help_behavior_hint="")]


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
    from equipoise.calibration import CalibrationSettings, check
    from equipoise.calibration import calibrate as run
    from equipoise.experiments.precise_routine import PreciseSettings
    from equipoise.experiments.sway import SwaySettings
    from equipoise.experiments.trial_runner import ComSearchSettings
    from equipoise.outputs.terminal import TrialProgress, print_calibration
    from equipoise.platforms.payload import Payload
    from equipoise.platforms.simulation import simulate
    from equipoise.run_folder import RunFolder

    _refuse_flags_of_other_methods(
        method,
        precise={"budget": budget, "mass": mass, "mass-sd": mass_sd, "no-sway": None if sway else True},
        paper={
            "feet": None if feet == "measured" else feet,
            "tolerance": None if tolerance == 0.005 else tolerance,
            "lower": lower, "upper": upper, "t-thres": t_thres, "lift-height": lift_height,
            "speed": None if speed == 1.0 else speed,
            "sway-amplitude": None if sway_amplitude == 0.05 else sway_amplitude,
            "sway-frequency": sway_frequency, "sway-duration": sway_duration,
        },
    )  # fmt: skip
    settings = CalibrationSettings(
        method,
        feet,
        ComSearchSettings(lower, upper, tolerance, lift_height, t_thres, speed),
        SwaySettings(sway_amplitude, sway_frequency, sway_duration),
        PreciseSettings(seconds(budget), mass, mass_sd, sway),
    )
    loaded = Payload.parse(payload) if payload is not None else None
    model = _load(robot, description_file, description)
    check(model, settings)
    now = datetime.now(timezone.utc)
    out = out or Path("runs") / f"{model.name}-{now:%Y%m%d-%H%M%S-%f}"
    facts = {"time": now.isoformat(timespec="seconds"), "platform": "mujoco", "noise": noise, "payload": payload}
    with simulate(model, noise, loaded, seed, start) as simulation:
        provenance = {**facts, "seed": seed, "mujoco": simulation.engine}
        folder = RunFolder.create(out, model, settings, provenance)
        folder.save_truth(simulation.truth)
        with _interruption_told(folder), TrialProgress(quiet or json) as progress:
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


def plan(
    robot: Robot = "unitree_a1",
    *,
    budget: Duration = None,
    sway: bool = True,
    description_file: File = None,
    description: Described = RobotDescription(),  # noqa: B008
    json: bool = False,
    debug: bool = False,
) -> None:
    """Show what 'calibrate --method precise' would do, and how accurate it would be. Moves nothing, needs no simulator.

    Example: equipoise plan go2 --budget 60s

    Args:
        budget: Robot time, as 60s, 120s or 2min; default 120 s on an A1, more on larger robots.
        sway: As in 'calibrate'.
        description_file: TOML file with a robot description; flags win over it.
        json: Print one JSON object and nothing else on stdout.
        debug: Show a traceback if something goes wrong.
    """
    from equipoise.experiments.precise_routine import PreciseSettings, plan_ahead
    from equipoise.outputs.terminal import print_plan
    from equipoise.robot.stance import nominal_stance

    model = _load(robot, description_file, description)
    result = plan_ahead(model, nominal_stance(model), PreciseSettings(seconds(budget), sway=sway))
    if json:
        print(json_module.dumps({"schema": "equipoise.plan/1", "robot": model.name, **result.to_dict()}, indent=2))
    else:
        print_plan(model.name, result)


def estimate(
    run: Annotated[Positional[Path], arg(metavar="RUN", help="Run folder of a calibration.")],
    *,
    feet: Annotated[Literal["measured", "commanded"] | None, arg(help_behavior_hint="")] = None,
    mass: Kilograms = None,
    mass_sd: Kilograms = None,
    json: bool = False,
    verbose: Verbose = False,
    debug: bool = False,
) -> None:
    """Estimate again from a run's recordings, without a robot or a simulator.

    Example: equipoise estimate runs/go2 --mass 16.2 --mass-sd 0.05

    Args:
        feet: As in 'calibrate'; default as in the run.
        mass: As in 'calibrate'; default as in the run.
        mass_sd: As in 'calibrate'; default as in the run.
        json: Print the result as one JSON object and nothing else on stdout.
        verbose: Show how long each stage of the estimate took.
        debug: Show a traceback if something goes wrong.
    """
    from equipoise.outputs.terminal import print_calibration
    from equipoise.run_folder import RunFolder

    folder = RunFolder.open(run)
    settings = folder.settings()
    precise = settings.precise
    if mass is not None or mass_sd is not None:
        precise = dataclasses.replace(precise, mass=mass or precise.mass, mass_sd=mass_sd)
    result = folder.estimate(dataclasses.replace(settings, feet=feet or settings.feet, precise=precise))
    if json:
        print(result.to_json(), end="")
    else:
        print_calibration(result, [], verbose)


def robots(*, json: bool = False, debug: bool = False) -> None:
    """List the robots known by name, with mass, legs and where each model comes from.

    Example: equipoise robots --json

    Args:
        json: Print one JSON object and nothing else on stdout.
        debug: Show a traceback if something goes wrong.
    """
    from equipoise.outputs.terminal import print_robots
    from equipoise.robot.catalog import describe_catalog

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        rows = describe_catalog()
    if json:
        print(json_module.dumps({"schema": "equipoise.robots/1", "robots": [dataclasses.asdict(row) for row in rows]}))
    else:
        print_robots(rows)


def audit(
    robot: Robot,
    *,
    description_file: File = None,
    description: Described = RobotDescription(),  # noqa: B008
    json: bool = False,
    debug: bool = False,
) -> None:
    """Check the inertial parameters in a robot's model file. Needs no simulator.

    Example: equipoise audit my_robot.urdf

    Args:
        description_file: TOML file with a robot description; flags win over it.
        json: Print one JSON object and nothing else on stdout.
        debug: Show a traceback if something goes wrong.
    """
    from equipoise.outputs.terminal import print_audit
    from equipoise.robot.audit import audit as run

    with warnings.catch_warnings():  # the audit says what was repaired
        warnings.simplefilter("ignore")
        model = _load(robot, description_file, description)
    result = run(model)
    if json:
        print(json_module.dumps({"schema": "equipoise.audit/1", **result.to_dict()}, indent=2))
    else:
        print_audit(result)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    if arguments == ["--version"]:
        print(f"equipoise {_version.__version__}")
        return 0
    app = tyro.extras.SubcommandApp()
    for verb in (calibrate, plan, estimate, balance, robots, audit):
        app.command(verb)
    with _warnings_on_stderr():
        try:
            code = app.cli(
                args=arguments,
                prog="equipoise",
                description="What your quadruped weighs, where its centre of mass is and how hard it is to turn.",
                config=(OmitArgPrefixes, tyro.conf.FlagCreatePairsOff),
            )
        except SystemExit as stop:  # tyro has printed its help, or what is wrong with the flags
            code = int(stop.code or 0)
            return _failed("UsageError", "the flags cannot be used; see stderr", code, arguments) if code else 0
        except EquipoiseError as error:
            if "--debug" in arguments:
                traceback.print_exc()
            print(f"error: {error}", file=sys.stderr)
            return _failed(type(error).__name__, str(error), error.exit_code, arguments)
        except KeyboardInterrupt:
            print("interrupted", file=sys.stderr)
            return _failed("Interrupted", "interrupted", INTERRUPTED, arguments)
        except BrokenPipeError:  # the reader, `head` say, has seen enough
            sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 - flushed when Python exits
            return 0
        except OSError as error:
            print(f"error: cannot write: {error}", file=sys.stderr)
            return OutputError.exit_code
    return int(code or 0)  # verbs that judge return an exit code


def _refuse_flags_of_other_methods(method: str, **flags: dict[str, object]) -> None:
    """A flag that a method does not know would be ignored without a word."""
    for owner, given in flags.items():
        for name, value in given.items():
            if owner != method and value is not None:
                raise SettingsError(f"--{name} belongs to --method {owner}; this is --method {method}")


def seconds(text: str | None) -> float | None:
    """[s] from 60, 60s, 1.5min or 2m; raises SettingsError for anything else."""
    if text is None:
        return None
    match = re.fullmatch(r"\s*([0-9]*\.?[0-9]+)\s*(s|sec|m|min)?\s*", text)
    if match is None:
        raise SettingsError(f"{text!r} is no time; give it as 60s or 2min")
    return float(match[1]) * (60.0 if (match[2] or "s").startswith("m") else 1.0)


def _load(robot: str, description_file: Path | None, description: RobotDescription) -> Any:
    from equipoise.robot.catalog import load_robot

    if description_file is not None:
        description = RobotDescription.from_toml(description_file).overridden_by(description)
    return load_robot(robot, description)


@contextmanager
def _interruption_told(folder: Any) -> Generator[None]:
    """Say where the recordings are if the routine does not come to its end."""
    try:
        yield
    except (KeyboardInterrupt, EquipoiseError):
        if folder.count:
            print(f"what was measured so far is kept in {folder.path}", file=sys.stderr)
        raise


@contextmanager
def _warnings_on_stderr() -> Generator[None]:
    def show(message: Warning | str, category: type[Warning], *_: Any) -> None:
        print(f"warning: {message}", file=sys.stderr)

    with warnings.catch_warnings():
        warnings.simplefilter("default")
        warnings.showwarning = show  # pyright: ignore[reportAttributeAccessIssue]
        yield


def _failed(kind: str, message: str, code: int, arguments: Sequence[str]) -> int:
    """With --json an error is an object too. Returns the exit code."""
    if "--json" in arguments:
        table = {"type": kind, "message": message, "exit_code": code}
        print(json_module.dumps({"schema": "equipoise.error/1", "error": table}))
    return code


if __name__ == "__main__":
    sys.exit(main())
