"""CPU time of a `paper` calibration of the A1, compared with the physics only, and of commands: `make bench-speed`.

Writes benchmarks/results/speed.md. One process, one core; the runs alternate, and medians are compared. Commands are run as a
user types them, without limits on threads.
"""

from __future__ import annotations

import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from types import FrameType

from provenance import write_page

from equipoise.threads import ONE_THREAD

AS_TYPED = {key: value for key, value in os.environ.items() if key not in ONE_THREAD}
os.environ.update(ONE_THREAD)

import mujoco
import numpy as np
from mujoco import rollout

import equipoise
from equipoise import BayesianMethod, PaperMethod, RunFolder, calibrate, estimate, load_robot, nominal_stance, simulate
from equipoise.bayesian import excitation
from equipoise.bayesian.plan import make_plan
from equipoise.bayesian.planning.candidates import Candidates
from equipoise.method.method import Method
from equipoise.recording.recording import Recording
from equipoise.robot.inertial import composite_parameters

RESULTS = Path(__file__).parent / "results"
# A small process measures memory, because a child initially has the size of its parent. Linux counts in kilobytes.
MEASURED = """
import resource, subprocess, sys
done = subprocess.run(sys.argv[1:], check=False, stdout=subprocess.DEVNULL)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(used.ru_utime + used.ru_stime, used.ru_maxrss)
sys.exit(done.returncode)
"""
REFUSED = {  # arguments and exit code
    "a mistyped robot": ("calibrate unitree_a2", 3),
    "a model file that does not exist": ("audit nowhere/robot.urdf", 3),
    "a run that does not exist": ("estimate runs/nowhere", 5),
    "a mistyped flag of `export`": ("export --two urdf", 2),
    "a mistyped flag of `calibrate`": ("calibrate --bugdet 60s", 2),
    "a time that is not one": ("record --duration soon", 2),
}
REPEATS = 7
STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS
PARTS = {  # of a calibration, by files on the call stack: the first match counts
    "physics": ("/mujoco/rollout.py",),
    "planning lifts": ("/bayesian/planning/", "/bayesian/plan.py", "/bayesian/predict.py"),
    "looking for collisions": ("/equipoise/clearance/",),
    "estimating, half-way and at the end": (
        "/bayesian/posterior", "/bayesian/gauss_newton.py", "/estimator/equations/", "/estimator/measurements/",
        "/bayesian/checks.py", "/estimator/diagnostics/", "/bayesian/reading.py", "/bayesian/screening.py",
    ),
    "sensing, gains, samples": ("/equipoise/simulation/",),
    "paths of motions: inverse kinematics, torques": ("/equipoise/experiments/", "/bayesian/trials.py"),
}  # fmt: skip
OVER_ROLLOUT = {"paper": 1.15, "bayesian": 1.7}


def timed(function: Callable[[], object]) -> float:
    start = time.process_time()
    function()
    return time.process_time() - start


def one_round() -> tuple[float, float, float, int, list[Recording]]:
    """Return CPU seconds of a calibration, of `mj_step` alone and with the same commands; steps; recordings."""
    robot = load_robot("unitree_a1")
    simulation = simulate(robot, "ideal")
    platform = simulation.platform
    model, start = platform._model, mujoco.MjData(platform._model)
    start.qpos[:], start.qvel[:] = platform._data.qpos, platform._data.qvel
    controls: list[np.ndarray] = []
    roll = platform._roll
    platform._roll = lambda control, turn=0.0: controls.append(control) or roll(control, turn)
    recordings: list[Recording] = []
    routine = timed(lambda: calibrate(platform, robot, PaperMethod(), keep=recordings.append))
    played = np.concatenate(controls)
    steps = len(played)

    standing = mujoco.MjData(model)
    standing.qpos[:], standing.ctrl[:] = start.qpos, played[0]

    def replay() -> None:
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = start.qpos, start.qvel
        for row in played[:: platform._substeps]:
            data.ctrl[:] = row
            mujoco.mj_step(model, data, nstep=platform._substeps)

    alone = timed(lambda: mujoco.mj_step(model, standing, nstep=steps))
    return routine, alone, timed(replay), steps, recordings


def storage(recordings: list[Recording]) -> tuple[float, float]:
    """Return wall seconds and megabytes of writing a run's recordings."""
    robot = load_robot("unitree_a1")
    with tempfile.TemporaryDirectory() as folder:
        with RunFolder.create(Path(folder) / "run", robot, PaperMethod(), {}) as run:
            start = time.perf_counter()
            for recording in recordings:
                run.keep(recording)
            elapsed = time.perf_counter() - start
        size = sum(file.stat().st_size for file in Path(folder).rglob("*") if file.is_file())
    return elapsed, size / 1e6


def wall(*arguments: str) -> float:
    """Return the median wall seconds of a Python process."""
    times: list[float] = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def command(*words: object, cache: Path, code: int = 0) -> tuple[float, float]:
    """Return CPU seconds and peak memory [MB] of a command with an exit code."""
    typed = [sys.executable, "-m", "equipoise", *map(str, words)]
    environment = {**AS_TYPED, "EQUIPOISE_CACHE": str(cache)}
    done = subprocess.run(
        [sys.executable, "-c", MEASURED, *typed], check=False, env=environment, capture_output=True, text=True
    )
    if done.returncode != code:
        raise SystemExit(f"{' '.join(typed)}: {done.stderr}")
    seconds, kilobytes = map(float, done.stdout.split())
    return seconds, kilobytes / 1000


def excitation_for_long(folder: Path) -> None:
    """Return a calibration with an excitation of a quarter of an hour, as a run of 1,000 s."""
    robot, periods = load_robot("unitree_a1"), excitation._ALL_AXES_PERIODS
    excitation._ALL_AXES_PERIODS = 1422
    method = BayesianMethod(duration=60 + excitation.excitation_time(nominal_stance(robot)))
    try:
        with simulate(robot, "realistic", seed=7) as simulation, RunFolder.create(folder, robot, method, {}) as run:
            calibrate(simulation.platform, robot, method, keep=run.keep)
    finally:
        excitation._ALL_AXES_PERIODS = periods


def commands() -> list[str]:
    """Return rows of commands, with interpreter, imports and reading."""
    quiet = ("--quiet", "--no-report")
    with tempfile.TemporaryDirectory() as folder:
        cache, run, swaying = (Path(folder) / name for name in ("cache", "run", "swaying"))
        command("calibrate", "unitree_a1", "--out", run, "--seed", 7, *quiet, cache=cache)
        excitation_for_long(swaying)
        log = swaying / "recording_0.mcap"
        asked = {
            "`equipoise plan`, the first time": (("plan", "unitree_a1"), cache / "empty", ""),
            "`equipoise plan`, again": (("plan", "unitree_a1"), cache, ""),
            "`equipoise estimate RUN`, of 120 s": (("estimate", run, *quiet), cache, ""),
            "`equipoise estimate LOG`, of 1,000 s at 500 Hz": (
                ("estimate", log, "--robot", "unitree_a1", *quiet),
                cache,
                "10 s, 400 MB",
            ),
        }
        rows = [(what, *command(*words, cache=where), target) for what, (words, where, target) in asked.items()]
    return [f"| {what} | {seconds:.1f} | {megabytes:.0f} | {target} |" for what, seconds, megabytes, target in rows]


def refusals() -> list[str]:
    """Return rows of commands with errors, the median of several runs."""
    rows: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        for what, (words, code) in REFUSED.items():
            times = [command(*words.split(), cache=Path(folder), code=code)[0] for _ in range(REPEATS)]
            seconds = statistics.median(times)
            rows.append(f"| {what}: `equipoise {words}` | {seconds:.2f} | 0.4 | {verdict(seconds <= 0.4)} |")
    return rows


def calibration_and_rollout(method: Method, noise: str, timestep: float | None) -> tuple[float, float]:
    """Return CPU seconds of a calibration, and of `mujoco.rollout` with its commands."""
    robot = load_robot("unitree_a1")
    with simulate(robot, noise, seed=7, timestep=timestep) as simulation:
        platform = simulation.platform
        model, run = platform._model, platform._run
        initial = np.zeros(mujoco.mj_stateSize(model, STATE))
        mujoco.mj_getState(model, platform._data, initial, STATE)
        controls: list[np.ndarray] = []
        platform._run = lambda control, raw: (controls.append(control), run(control, raw))
        whole = timed(lambda: calibrate(platform, robot, method))
        commands, engine, data = np.concatenate(controls), rollout.Rollout(nthread=0), mujoco.MjData(model)
        alone = min(timed(lambda: engine.rollout(model, data, initial[None], commands[None])) for _ in range(3))
    return whole, alone


def over_rollout(method: Method, noise: str, timestep: float | None = None) -> str:
    """Return the row of a calibration and `mujoco.rollout` of its commands, the second of two, because the first plans."""
    calibration_and_rollout(method, noise, timestep)
    whole, alone = calibration_and_rollout(method, noise, timestep)
    target = OVER_ROLLOUT[method.name]
    return (
        f"| `{method.name}`, `{noise}` | {whole:.2f} | {alone:.2f} | {whole / alone:.2f} | {target} | "
        f"{verdict(whole / alone <= target)} |"
    )


def where_it_goes() -> list[str]:
    """Return rows of the parts of a `bayesian` calibration, sampled every millisecond of CPU time."""
    robot, seen = load_robot("unitree_a1"), Counter[str]()

    def look(_: int, frame: FrameType | None) -> None:
        files: list[str] = []
        while frame is not None:
            files.append(frame.f_code.co_filename)
            frame = frame.f_back
        at_work = (part for part, of in PARTS.items() if any(one in file for one in of for file in files))
        seen[next(at_work, "the rest")] += 1

    def once() -> None:
        with simulate(robot, "realistic", seed=7) as simulation:
            calibrate(simulation.platform, robot, BayesianMethod())

    once()
    before = signal.signal(signal.SIGPROF, look)
    signal.setitimer(signal.ITIMER_PROF, 1e-3, 1e-3)
    try:
        once()
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)
    return [f"| {part} | {count / seen.total():.0%} |" for part, count in seen.most_common()]


def thinking() -> list[str]:
    """Return rows of estimates and plans of a `bayesian` calibration, minimum of several runs."""
    robot = load_robot("unitree_a1")
    stance, method, recordings = nominal_stance(robot), BayesianMethod(), list[Recording]()
    with simulate(robot, "stress", seed=7) as simulation:
        calibrate(simulation.platform, robot, method, keep=recordings.append)
    com = composite_parameters(robot, stance.joint_position).com
    found = [Candidates.of(robot, stance, com, method.combined_priors)]
    steps: dict[str, tuple[Callable[[], object], float]] = {
        "an estimate of 120 s with all parameters, its checks and the reading of recordings": (
            lambda: estimate(robot, recordings, method), 1.0,
        ),
        "a plan for a new robot": (
            lambda: make_plan(Candidates.of(robot, stance, com, method.combined_priors), 100.0), 0.5,
        ),
        "a plan from given candidates": (lambda: make_plan(found[0], 100.0), 0.3),
    }  # fmt: skip
    rows: list[str] = []
    for what, (step, target) in steps.items():
        seconds = min(timed(step) for _ in range(3))
        rows.append(f"| {what} | {seconds:.2f} | {target} | {verdict(seconds <= target)} |")
    return rows


def verdict(met: bool) -> str:
    return "met" if met else "**missed**"


def main() -> None:
    one_round()
    rounds = [one_round() for _ in range(REPEATS)]
    routine, alone, replay = (statistics.median(values) for values in list(zip(*rounds, strict=True))[:3])
    ratios = sorted(r[0] / r[1] for r in rounds)
    steps = rounds[0][3]
    store, megabytes = storage(rounds[0][4])
    eager = "from equipoise import " + ", ".join(n for n in equipoise.__all__ if n not in ("simulate", "Simulation"))
    lines = [
        "# Speed of a whole `paper` calibration of the A1",
        "",
        f"`make bench-speed`; equipoise {equipoise.__version__}, MuJoCo {mujoco.__version__}, {REPEATS} "
        "rounds on one core, CPU seconds, medians. Motion, sensing and estimation, without start-up, storage and figures.",
        "",
        "| part | CPU s | over `mj_step` |",
        "|---|---|---|",
        f"| the whole calibration ({steps} engine steps) | {routine:.3f} | {statistics.median(ratios):.2f} "
        f"({ratios[0]:.2f} to {ratios[-1]:.2f}) |",
        f"| `mj_step` alone, equal number of steps, robot standing | {alone:.3f} | 1 |",
        f"| `mj_step` with the calibration's own commands | {replay:.3f} | {replay / alone:.2f} |",
        "",
        f"Target: at most 1.5 times `mj_step` alone: {verdict(statistics.median(ratios) <= 1.5)}; against "
        f"the same motion replayed: {routine / replay:.2f}.",
        "",
        f"Additional time for storage: {store:.3f} s wall for {megabytes:.1f} MB.",
        "",
        "| start-up | median wall s | target |",
        "|---|---|---|",
        f"| `import equipoise` | {wall('-c', 'import equipoise'):.2f} | 0.6 |",
        f"| `import equipoise` and all names without simulator | {wall('-c', eager):.2f} | 0.6 |",
        f"| `equipoise --help` | {wall('-m', 'equipoise', '--help'):.2f} | 1.0 |",
        "",
        "| command, with interpreter, imports and reading | CPU s | peak memory [MB] | target |",
        "|---|---|---|---|",
        *commands(),
        "",
        "| command with an error, with interpreter and imports | CPU s | target | |",
        "|---|---|---|---|",
        *refusals(),
        "",
        "Whole calibrations compared with `mujoco.rollout` of the same commands, one core, CPU seconds; both in one process, "
        "one after the other, on a shared machine. With `stress`, load-dependent friction is set before every engine step, "
        "which costs a third of the step.",
        "",
        "| | calibration | `mujoco.rollout` | ratio | target | |",
        "|---|---|---|---|---|---|",
        over_rollout(PaperMethod(), "realistic", 1e-3),
        *(over_rollout(BayesianMethod(), noise) for noise in ("ideal", "realistic", "stress")),
        "",
        "| part of a `bayesian` calibration, `realistic` | CPU time |",
        "|---|---|",
        *where_it_goes(),
        "",
        "| `bayesian`, without interpreter and imports | CPU s | target | |",
        "|---|---|---|---|",
        *thinking(),
    ]
    text = "\n".join(lines) + "\n"
    write_page("speed.md", text)
    print(text)


if __name__ == "__main__":
    main()
