"""`equipoise lab balance`."""

from __future__ import annotations

import re
import sys
from collections.abc import Generator
from contextlib import contextmanager
from datetime import datetime, timezone
from pathlib import Path
from typing import Annotated, Any, Literal

from tyro.conf import arg

from equipoise import _version
from equipoise.cli import flags
from equipoise.cli.setting_flags import seconds
from equipoise.errors import FallError, MotionError, OutputError, SettingsError
from equipoise.lab.balance import model_error
from equipoise.lab.balance.balance_report import BalanceReport, BalanceTrial
from equipoise.lab.balance.balance_routine import balance as run
from equipoise.lab.balance.balance_routine import check_request
from equipoise.lab.balance.evaluation import evaluate, true_traces
from equipoise.lab.balance.model_error import DesignModel, error_along
from equipoise.lab.terminal import print_balance
from equipoise.platform.platform import MotionInterrupted
from equipoise.recording.run_log import save_recording
from equipoise.result.calibration import Calibration
from equipoise.robot.catalog import load_robot
from equipoise.robot.model import DIAGONALS, RobotModel
from equipoise.robot.stance import Stance, nominal_stance
from equipoise.simulation.effects import read_effects, read_names
from equipoise.simulation.ground_truth_view import GroundTruthRecorder
from equipoise.simulation.payload import Payload
from equipoise.simulation.simulation import Simulation, simulate

_WATCHED_PERIODS = 5  # control periods from one sample of the true state to the next
_UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}

Length = Annotated[str | None, arg(metavar="LENGTH", help_behavior_hint="")]


def balance(
    robot: flags.Robot = "unitree_a1",
    *,
    com: flags.File = None,
    com_error: Length = None,
    diagonal: Literal["FL_RR", "FR_RL", "both"] = "both",
    duration: Annotated[str, arg(metavar="TIME")] = "10s",
    sim_preset: flags.PresetName = "realistic",
    enable_effect: flags.WithEffects = (),
    disable_effect: flags.WithoutEffects = (),
    contact_model: flags.ContactModelName = "default",
    payload: flags.PayloadGiven = None,
    seed: int = 0,
    out: flags.File = None,
    report: flags.Flag = True,
    check: flags.Flag = False,
    description: flags.Described,
    output: flags.Output,
) -> int:
    """Balance a simulated robot on two diagonal feet, as a test of its centre of
    mass.

    The controller uses joint encoders and IMU only. It is designed on a fixed
    model: the model file, a calibration (--com), or the simulated truth with a
    displaced centre of mass (--com-error). With a small error the robot leans; it
    falls with errors of several millimetres. The exit code after a fall is 0, or
    4 with --check.

    Examples: equipoise lab balance --payload 2,0.08,0.03,0.1 --com runs/a1
              equipoise lab balance go2 --com-error=-5mm --diagonal FL_RR

    Args:
        com: Result of 'calibrate' (calibration.json). The controller uses its mass, centre of mass and inertia, and corrects
            the estimated joint offsets and IMU mounting.
        com_error: Design the controller on the simulated truth with the centre of mass displaced along the horizontal normal
            of each support line, forward if positive (5mm, or --com-error=-5mm).
        diagonal: Feet to stand on.
        duration: Time to balance on each diagonal, for example 10s.
        seed: Seed of everything drawn.
        out: Folder; default runs/ROBOT-balance-TIME.
        report: Write no page balance.html.
        check: Exit with 4 if the robot did not balance for the whole time.
    """
    if com is not None and com_error is not None:
        raise SettingsError("--com and --com-error both set the controller's model; pass one of them")
    time = seconds(duration, "duration") or 0.0
    error = None if com_error is None else metres(com_error)
    model = load_robot(robot, description)
    check_request(model, time)  # before the simulation is made
    stance = nominal_stance(model)
    calibration = None if com is None else Calibration.load(com / "calibration.json" if com.is_dir() else com)
    loaded = Payload.parse(payload) if payload is not None else None
    now = datetime.now(timezone.utc)
    out = out or Path("runs") / f"{model.name}-balance-{now:%Y%m%d-%H%M%S-%f}"
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise OutputError(f"the output folder {str(out)!r} is not empty; name a new one with --out")
    world: dict[str, Any] = {
        "effects": read_effects(enable_effect), "disabled_effects": read_names(disable_effect), "contact_model": contact_model,
    }  # fmt: skip
    trials: list[BalanceTrial] = []
    sensors_corrected = False
    engine = ""
    for name in DIAGONALS if diagonal == "both" else (diagonal,):
        with simulate(model, sim_preset, loaded, seed, **world) as simulation, _interruption_kept(out, name):
            if not output.silent:
                print(f"balancing on {name} ...", file=sys.stderr, flush=True)
            design = _design_model(model, stance, simulation, name, calibration, error)
            trials.append(_trial(simulation, model, stance, design, name, time))
            sensors_corrected, engine = design.sensors.any, simulation.engine_version
    provenance = {
        "time": now.isoformat(timespec="seconds"), "equipoise": _version.__version__, "platform": "mujoco", "mujoco": engine,
        "sim_preset": sim_preset, **world, "payload": payload, "seed": seed, "com": None if com is None else str(com),
        "com_error": error,
    }  # fmt: skip
    done = BalanceReport(model.name, sensors_corrected, time, tuple(trials), provenance)
    files = done.save(out)
    if report:
        from equipoise.lab.pages.balance_page import balance_page
        from equipoise.report.page import save_page

        files.append(save_page(balance_page(done), out / "balance.html"))
    if output.json:
        print(done.to_json(), end="")
    else:
        print_balance(done, files)
    if check and not done.balanced:
        fallen = ", ".join(trial.run.diagonal for trial in trials if not trial.verdict.balanced)
        print(f"the robot did not balance for {time:g} s on {fallen}", file=sys.stderr)
        return FallError.exit_code
    return 0


@contextmanager
def _interruption_kept(out: Path, diagonal: str) -> Generator[None]:
    """Save the recording of an interrupted trial, and print its folder."""
    try:
        yield
    except (MotionInterrupted, MotionError) as stop:
        recordings = (stop.recording,) if isinstance(stop, MotionInterrupted) else stop.recordings
        for recording in recordings[-1:]:
            if recording is not None:
                out.mkdir(parents=True, exist_ok=True)
                save_recording(recording.broken_off(), out / f"balance-{diagonal}-broken-off.mcap")
                print(f"the recording until the interruption is in {out}", file=sys.stderr)
        raise


def metres(text: str) -> float:
    """Return a length [m] from 5mm, -0.5cm, 0.005m or 0.005; raises SettingsError for anything else."""
    match = re.fullmatch(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?)\s*(mm|cm|m)?\s*", text)
    value = float(match[1]) * _UNITS[match[2] or "m"] if match else float("inf")
    if not abs(value) <= 0.1:
        raise SettingsError(f"{text!r} is not a length of at most 100 mm; pass for example 5mm, -5mm or 0.005m")
    return value


def _design_model(
    robot: RobotModel, stance: Stance, simulation: Simulation, diagonal: str, calibration: Any, error: float | None
) -> DesignModel:
    if calibration is not None:
        return model_error.calibrated(robot, stance, calibration)
    if error is not None:
        return model_error.displaced(robot, stance, simulation.truth, diagonal, error)
    return model_error.model_file(robot)


def _trial(
    simulation: Simulation,
    robot: RobotModel,
    stance: Stance,
    design: DesignModel,
    diagonal: str,
    duration: float,
) -> BalanceTrial:
    recorder = GroundTruthRecorder(simulation.ground_truth, _WATCHED_PERIODS)
    done = run(simulation.platform, robot, design.model, diagonal, duration, design.sensors, recorder.watch)
    off = error_along(stance, diagonal, design.model, simulation.truth)
    traces = true_traces(done, recorder.ground_truths)
    return BalanceTrial(done, evaluate(done, traces), traces, off, design.source)
