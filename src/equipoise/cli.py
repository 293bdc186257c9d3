"""The command line: one function per verb, and what they print. No arithmetic."""

from __future__ import annotations

import dataclasses
import json as json_module
import os
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
from equipoise.errors import EquipoiseError, OutputError
from equipoise.robot.description import RobotDescription

INTERRUPTED = 130

Robot = Annotated[Positional[str], arg(metavar="ROBOT", help="Name (see 'equipoise robots'), or a URDF or MJCF file.")]
Described = Annotated[RobotDescription, arg(name="", help="What the model file leaves out or gets wrong.")]
# An option whose default is found at run time: its help says how.
Metres = Annotated[float | None, arg(metavar="METRES", help_behavior_hint="")]
Seconds = Annotated[float | None, arg(metavar="SECONDS", help_behavior_hint="")]
Hertz = Annotated[float | None, arg(metavar="HERTZ", help_behavior_hint="")]
File = Annotated[Path | None, arg(metavar="PATH", help_behavior_hint="")]


def calibrate(
    robot: Robot = "unitree_a1",
    *,
    method: Literal["paper"] = "paper",
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
    debug: bool = False,
) -> None:
    """Find a quadruped's centre of mass and moments of inertia, in simulation.

    The robot lifts two diagonal feet, feels which way it tips, moves its body and repeats (Algorithms 1 and 2 of the
    paper); then it sways about each axis (equations 2 to 5). The run folder keeps every recording.

    Example: equipoise calibrate go2 --noise realistic --payload 1.5,0.1,0,0.08 --seed 3 --out runs/go2

    Args:
        method: What to do.
        feet: Support lines through the feet as the encoders measure them, or as they were commanded.
        noise: Sensor and actuator errors of the simulated robot.
        payload: MASS,X,Y,Z or MASS,X,Y,Z,IXX,IYY,IZZ: kg, m in the base frame, kg m2 about its own CoM.
        start: How the simulated robot begins (and ends).
        seed: Of everything drawn.
        tolerance: The search ends when the bounds of the offset are this close [m].
        lower: Lower search bound of the offset [m]; default by the robot's size.
        upper: Upper search bound of the offset [m]; default by the robot's size.
        t_thres: How long two feet stay up [s]; default by the robot's size.
        lift_height: Of the first lift [m]; default 5 % of the hip height.
        speed: Factor on the speed between trials.
        sway_amplitude: Of the sway [rad].
        sway_frequency: Of the sway [Hz]; default by the robot's size.
        sway_duration: Of the steady sway [s]; default six periods.
        description_file: TOML file with a robot description; flags win over it.
        out: Run folder; default runs/ROBOT-TIME.
        pictures: search.png and sway.png are drawn unless this is given.
        json: Print the result as one JSON object and nothing else on stdout.
        quiet: No progress.
        debug: Show a traceback if something goes wrong.
    """
    from equipoise.calibration import CalibrationSettings, check
    from equipoise.calibration import calibrate as run
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
        print_calibration(result, files)


def estimate(
    run: Annotated[Positional[Path], arg(metavar="RUN", help="Run folder of a calibration.")],
    *,
    feet: Annotated[Literal["measured", "commanded"] | None, arg(help_behavior_hint="")] = None,
    json: bool = False,
    debug: bool = False,
) -> None:
    """Estimate again from a run's recordings, without a robot or a simulator.

    Example: equipoise estimate runs/go2 --feet commanded

    Args:
        feet: As in 'calibrate'; default as in the run.
        json: Print the result as one JSON object and nothing else on stdout.
        debug: Show a traceback if something goes wrong.
    """
    from equipoise.outputs.terminal import print_calibration
    from equipoise.run_folder import RunFolder

    folder = RunFolder.open(run)
    settings = folder.settings()
    result = folder.estimate(dataclasses.replace(settings, feet=feet or settings.feet))
    if json:
        print(result.to_json(), end="")
    else:
        print_calibration(result, [])


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
    for verb in (calibrate, estimate, robots, audit):
        app.command(verb)
    with _warnings_on_stderr():
        try:
            app.cli(
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
    return 0


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
