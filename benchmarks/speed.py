"""Speed of calibrations, studies, commands and the control loop, and size of an installation: `make bench-speed`.

Writes benchmarks/results/speed.md. Everything runs alone; the two cores must be idle. `make demo` and `make test` in a fresh
clone take half an hour and are only measured with `--only fresh`.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from rows import Page, Row, Table, main  # isort: skip - it limits the threads of NumPy
import installation
import mujoco
import numpy as np
import viewing
from mujoco import rollout
from tables import figures, markdown

from equipoise import (
    BayesianMethod,
    Method,
    PaperMethod,
    RobotModel,
    RunFolder,
    calibrate,
    estimate,
    load_robot,
    nominal_stance,
    simulate,
)
from equipoise.bayesian import excitation
from equipoise.bayesian.plan import make_plan
from equipoise.bayesian.planning.candidates import Candidates
from equipoise.lab.study.processes import Processes
from equipoise.lab.study.rows import column, failed
from equipoise.lab.study.runner import run_study
from equipoise.lab.study.study import Study, draw
from equipoise.recording.recording import Recording
from equipoise.robot.inertial import composite_parameters
from equipoise.simulation.simulation import Simulation
from equipoise.threads import ONE_THREAD

CORES = os.cpu_count() or 1
SEED, ROUNDS = 7, 3
STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS
OVER_ROLLOUT = {"paper": 1.3, "bayesian": 1.8}  # largest ratios
OF_ROLLOUT = {0.25e-3: 0.87, 0.5e-3: 0.8, 1e-3: 0.7}  # least ratios by time step [s]
TRIALS, GROWTH, MOST_GROWTH = 60, (100, 200, 500, 1000), 20.0  # [min] for the last number of trials
STEP_TRIALS = {"unitree_a1": 30, "solo12": 20, "anymal_c": 20}
AS_TYPED = {key: value for key, value in os.environ.items() if key not in ONE_THREAD}
# A small process measures, because a child initially has the size of its parent. Linux counts memory in kilobytes.
MEASURED = """
import resource, subprocess, sys, time
start = time.perf_counter()
done = subprocess.run(sys.argv[1:], check=False, stdout=subprocess.DEVNULL)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(time.perf_counter() - start, used.ru_utime + used.ru_stime, used.ru_maxrss / 1000)
sys.exit(done.returncode)
"""
REFUSED = {  # arguments and exit code
    "calibrate unitree_a2": 3,
    "audit nowhere/robot.urdf": 3,
    "estimate runs/nowhere": 5,
    "export --two urdf": 2,
    "calibrate --bugdet 60s": 2,
    "record --duration soon": 2,
}
REFUSAL, HELP = 0.4, 0.09  # [s] of wall time
LOG_TIME, LOG_MEMORY = 6.0, 400  # [s] of CPU time, [MB]
THINKING = {"estimate": 0.6, "plan for a new robot": 0.5, "plan from given candidates": 0.3}  # [s] of CPU time


def timed(function: Callable[[], object]) -> float:
    """Return the CPU time of a call [s]."""
    start = time.process_time()
    function()
    return time.process_time() - start


def recorded(
    simulation: Simulation, robot: RobotModel, method: Method
) -> tuple[float, mujoco.MjModel, np.ndarray, np.ndarray]:
    """Calibrate; return the CPU time [s], the engine's model, its initial state, and its controls at every step."""
    platform = simulation.platform
    model, run, controls = platform._model, platform._run, list[np.ndarray]()
    initial = np.zeros(mujoco.mj_stateSize(model, STATE))
    mujoco.mj_getState(model, platform._data, initial, STATE)
    platform._run = lambda control, raw: (controls.append(control.copy()), run(control, raw))
    taken = timed(lambda: calibrate(platform, robot, method))
    return taken, model, initial, np.concatenate(controls)


def rollout_alone(model: mujoco.MjModel, initial: np.ndarray, controls: np.ndarray) -> float:
    """Return the CPU time of `mujoco.rollout`, the least of two [s]."""
    engine, data = rollout.Rollout(nthread=0), mujoco.MjData(model)
    return min(timed(lambda: engine.rollout(model, data, initial[None], controls[None])) for _ in range(2))


def over_rollout(name: str, preset: str) -> Row:
    """Return CPU times of calibrations, without the first one, which plans, and of `mujoco.rollout` with their commands."""
    robot, whole, alone = load_robot("unitree_a1"), list[float](), list[float]()
    method = PaperMethod() if name == "paper" else BayesianMethod()
    for _ in range(1 + ROUNDS):
        with simulate(robot, preset, seed=SEED, timestep=method.timestep) as simulation:
            taken, *bare = recorded(simulation, robot, method)
        whole.append(taken)
        alone.append(rollout_alone(*bare))
    return {"whole": whole[1:], "alone": alone[1:]}


def show_over_rollout(rows: list[Row]) -> Iterator[str]:
    yield "## Calibrations and bare physics"
    yield ""
    yield (
        "CPU time on one core of a calibration of the A1 (motion, sensing, estimation; without start-up and storage), and of "
        f"`mujoco.rollout` with the same commands; medians of {ROUNDS}. In `stress`, load-dependent friction is set before "
        "every engine step."
    )
    yield ""
    head = ("method", "preset", "calibration [s]", "`mujoco.rollout` [s]", "ratio", "target")
    lines: list[list[str]] = []
    for row in rows:
        name, preset = row["case"]
        ratio = statistics.median(a / b for a, b in zip(row["whole"], row["alone"], strict=True))
        times = [figures(statistics.median(row[one])) for one in ("whole", "alone")]
        lines.append(
            [f"`{name}`", f"`{preset}`", *times, figures(ratio, most=OVER_ROLLOUT[name]), f"{OVER_ROLLOUT[name]:g}"]
        )
    yield from markdown(head, lines)


def thinking() -> Row:
    """Return CPU times of an estimate of 120 s of `stress` and of plans, the least of several."""
    robot, method, recordings = load_robot("unitree_a1"), BayesianMethod(), list[Recording]()
    stance = nominal_stance(robot)
    with simulate(robot, "stress", seed=SEED) as simulation:
        calibrate(simulation.platform, robot, method, keep=recordings.append)
    com = composite_parameters(robot, stance.joint_position).com
    candidates = Candidates.of(robot, stance, com, method.combined_priors)
    steps = {
        "estimate": lambda: estimate(robot, recordings, method),
        "plan for a new robot": lambda: make_plan(Candidates.of(robot, stance, com, method.combined_priors), 100.0),
        "plan from given candidates": lambda: make_plan(candidates, 100.0),
    }
    return {name: min(timed(step) for _ in range(3)) for name, step in steps.items()}


def show_thinking(rows: list[Row]) -> Iterator[str]:
    yield "`bayesian` on one core, without interpreter and imports; estimate: of 120 s, all parameters, checks and reading."
    yield ""
    lines = [[name, figures(row[name], most=most), f"{most:g}"] for row in rows for name, most in THINKING.items()]
    yield from markdown(("step", "CPU time [s]", "target"), lines)


def commands_of_trial(trial: int, timestep: float, begin: float, repeats: int) -> tuple[int, float]:
    """Return steps and time of `mujoco.rollout` alone with one trial's commands, from a common start time [s]."""
    drawn = draw(Study(), trial)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with simulate(drawn.robot, drawn.sizes, drawn.payload, drawn.seed, timestep=timestep) as simulation:
            _, model, initial, controls = recorded(simulation, drawn.robot, PaperMethod())
    engine, data = rollout.Rollout(nthread=0), mujoco.MjData(model)
    time.sleep(max(0.0, begin - time.time()))
    start = time.perf_counter()
    for _ in range(repeats):
        engine.rollout(model, data, initial[None], controls[None])
    return repeats * len(controls), time.perf_counter() - start


def rollouts(pool: Processes, timestep: float) -> float:
    """Return steps per second of `mujoco.rollout` in all processes together."""
    begin = time.time() + 8.0  # time to compute the commands
    repeats = round(4e-3 / timestep)
    futures = [pool.submit(commands_of_trial, trial, timestep, begin, repeats) for trial in range(CORES)]
    return sum(steps / seconds for steps, seconds in (future.result() for future in futures))


def throughput(timestep: float) -> Row:
    """Return engine steps per second of a study, and of `mujoco.rollout` in the same processes before and after it."""
    with Processes(CORES) as pool, tempfile.TemporaryDirectory() as folder:
        run_study(Study(timestep=timestep, seed=99), 15 * CORES, Path(folder, "warm"), pool, CORES)
        before = rollouts(pool, timestep)
        start = time.perf_counter()
        study = run_study(Study(timestep=timestep), TRIALS, Path(folder, "study"), pool, CORES)
        wall = time.perf_counter() - start
        alone = (before + rollouts(pool, timestep)) / 2
    steps = float(np.sum(column(study, "simulated_time"))) / timestep
    return {"study": steps / wall, "alone": alone, "rate": TRIALS / wall}


def show_throughput(rows: list[Row]) -> Iterator[str]:
    yield "## Monte Carlo studies"
    yield ""
    yield (
        f"A1, `paper`, `realistic`, random payloads, {CORES} processes. Engine steps per second of a study of {TRIALS} trials "
        "(drawing, building, planning, sensing, estimation and storage included), and of `mujoco.rollout` alone with the "
        "same models, horizons, commands and number of processes, before and after it."
    )
    yield ""
    head = ("time step [ms]", "study", "`mujoco.rollout`", "ratio", "target", "calibrations per second")
    lines: list[list[str]] = []
    for row in rows:
        least, ratio = OF_ROLLOUT[row["case"][0]], row["study"] / row["alone"]
        shown = f"{ratio:.2f}" if ratio >= least else f"**{ratio:.2f}**"
        rates = [f"{row[one]:,.0f}" for one in ("study", "alone")]
        lines.append([f"{1e3 * row['case'][0]:g}", *rates, shown, f"{least:g}", f"{row['rate']:.2f}"])
    yield from markdown(head, lines)


def growth(trials: int) -> Row:
    """Return the time until each number of trials of a study was stored, with the start of the workers [s]."""
    reached: dict[int, float] = {}
    start = time.perf_counter()

    def note(progress: object) -> None:
        if progress.done in GROWTH:
            reached[progress.done] = time.perf_counter() - start

    with tempfile.TemporaryDirectory() as folder:
        rows = run_study(Study(), trials, Path(folder, "study"), None, CORES, note)
    return {"reached": [reached[count] for count in GROWTH], "without_result": failed(rows)}


def show_growth(rows: list[Row]) -> Iterator[str]:
    for row in rows:
        reached = np.array(row["reached"])
        slope, start = np.polyfit(GROWTH, reached, 1)
        worst = np.max(np.abs(start + slope * np.array(GROWTH) - reached) / reached)
        times = ", ".join(f"{count:,}: {seconds / 60:.1f} min" for count, seconds in zip(GROWTH, reached, strict=True))
        yield (
            f"Time until trials of one study were stored: {times} (target of the last: {MOST_GROWTH:g} min). Linear fit: "
            f"{slope:.3f} s per trial, {start:+.1f} s at the start; largest residual {worst:.1%}. {row['without_result']} "
            "calibrations ended with an error."
        )


def step_change(name: str, trials: int) -> Row:
    """Return the change of results and their errors when the time step is twice the default."""
    found: list[tuple[np.ndarray, np.ndarray]] = []
    with Processes(CORES) as pool, tempfile.TemporaryDirectory() as folder:
        for timestep in (0.5e-3, 1e-3):
            study = Study(name, (PaperMethod(),), timestep=timestep)
            rows = run_study(study, trials, Path(folder, f"{timestep}"), pool, CORES)
            com = np.array(
                [column(rows, f"estimated_{axis}") - column(rows, f"true_{axis}") for axis in ("com_x", "com_y")]
            )
            truth = np.array([column(rows, f"true_{axis}") for axis in ("Ixx", "Iyy", "Izz")])
            moments = np.array([column(rows, f"moment_{axis}") for axis in ("roll", "pitch", "yaw")])
            found.append((com, moments / truth - 1))
    (com, moments), (coarse_com, coarse_moments) = found

    def share(coarse: np.ndarray, fine: np.ndarray) -> float:
        return float(np.sqrt(np.nanmean((coarse - fine) ** 2) / np.nanmean(fine**2)))

    return {"com": share(coarse_com, com), "moments": share(coarse_moments, moments)}


def show_step_change(rows: list[Row]) -> Iterator[str]:
    yield "`paper` at 1 ms instead of 0.5 ms: rms change of the results over the rms of their errors. Target: 0.1."
    yield ""
    lines = [[*row["case"], figures(row["com"], most=0.1), figures(row["moments"], most=0.1)] for row in rows]
    yield from markdown(("robot", "trials", "planar CoM", "moments"), lines)


def command(*words: object, cache: Path, code: int = 0) -> Row:
    """Return wall and CPU time [s] and peak memory [MB] of a command with an exit code, as a user types it."""
    typed = [sys.executable, "-m", "equipoise", *map(str, words)]
    environment = {**AS_TYPED, "EQUIPOISE_CACHE": str(cache)}
    done = subprocess.run(
        [sys.executable, "-c", MEASURED, *typed], check=False, env=environment, capture_output=True, text=True
    )
    if done.returncode != code:
        raise SystemExit(f"{' '.join(typed)}: {done.stderr}")
    return dict(zip(("wall", "cpu", "memory"), map(float, done.stdout.split()), strict=True))


def quick(words: str) -> Row:
    """Return times of a command that computes nothing, medians."""
    with tempfile.TemporaryDirectory() as folder:
        runs = [command(*words.split(), cache=Path(folder), code=REFUSED.get(words, 0)) for _ in range(2 * ROUNDS)]
    return {name: statistics.median(run[name] for run in runs) for name in runs[0]}


def long_run(folder: Path) -> Path:
    """Simulate a calibration with a long excitation; return its log of 1,000 s at 500 Hz."""
    robot, periods = load_robot("unitree_a1"), excitation._ALL_AXES_PERIODS
    excitation._ALL_AXES_PERIODS = 1422
    method = BayesianMethod(duration=60 + excitation.excitation_time(nominal_stance(robot)))
    try:
        with simulate(robot, "realistic", seed=SEED) as simulation, RunFolder.create(folder, robot, method, {}) as run:
            calibrate(simulation.platform, robot, method, keep=run.keep)
    finally:
        excitation._ALL_AXES_PERIODS = periods
    return folder / "recording_0.mcap"


def computing(words: str) -> Row:
    """Return times and memory of a command that computes; RUN is a run of 120 s, LOG a log of 1,000 s."""
    flags = ("--quiet", "--no-report")
    with tempfile.TemporaryDirectory() as name:
        cache, run, paths = Path(name, "cache"), Path(name, "run"), dict[str, Path]()
        if "LOG" in words:
            paths["LOG"] = long_run(Path(name, "long"))
        if "RUN" in words:
            command("calibrate", "unitree_a1", "--out", run, "--seed", SEED, *flags, cache=cache)
            paths["RUN"] = run
        typed = [paths.get(word, word) for word in words.split()]
        return command(*typed, *(flags if paths else ()), cache=cache)


def show_commands(rows: list[Row]) -> Iterator[str]:
    yield "## Commands"
    yield ""
    yield (
        "With interpreter, imports and reading. RUN: of 120 s. LOG: 1,000 s at 500 Hz. Targets: a refusal "
        f"{REFUSAL:g} s, `--help` {HELP:g} s (wall time); LOG {LOG_TIME:g} s (CPU time) and {LOG_MEMORY} MB."
    )
    yield ""
    lines: list[list[str]] = []
    for row in rows:
        words, log = row["case"][0], "LOG" in row["case"][0]
        most = REFUSAL if words in REFUSED else HELP if words == "--help" else np.inf
        lines.append([
            f"`equipoise {words}`" + (" (refused)" if words in REFUSED else ""),
            figures(row["wall"], most=most), figures(row["cpu"], most=LOG_TIME if log else np.inf),
            figures(row["memory"], ".0f", LOG_MEMORY if log else np.inf),
        ])  # fmt: skip
    yield from markdown(("command", "wall time [s]", "CPU time [s]", "peak memory [MB]"), lines)


def commands(words: str) -> Row:
    """Return the row of a command."""
    return quick(words) if words in REFUSED or words == "--help" else computing(words)


COMMANDS: Sequence[str] = (
    "--help", *REFUSED, "plan unitree_a1", "estimate RUN", "estimate LOG --robot unitree_a1",
)  # fmt: skip
PAGE = Page(
    "speed",
    f"""# Speed and size

`make bench-speed`; {CORES} cores, otherwise idle. Bold: target missed.""",
    (
        Table(
            "rollout",
            over_rollout,
            [("paper", "realistic"), *(("bayesian", preset) for preset in ("ideal", "realistic", "stress"))],
            show_over_rollout,
            alone=True,
        ),
        Table("thinking", thinking, [()], show_thinking, alone=True),
        Table("throughput", throughput, [(step,) for step in OF_ROLLOUT], show_throughput, alone=True),
        Table("growth", growth, [(max(GROWTH),)], show_growth, alone=True),
        Table("step", step_change, list(STEP_TRIALS.items()), show_step_change, alone=True),
        Table("commands", commands, [(words,) for words in COMMANDS], show_commands, alone=True),
        *viewing.TABLES,
        *installation.TABLES,
    ),
)

if __name__ == "__main__":
    main(PAGE)
