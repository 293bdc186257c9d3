"""Speed and scaling of Monte Carlo studies, and effect of the time step: `make bench-monte-carlo`.

Writes benchmarks/results/monte_carlo.md from benchmarks/results/monte_carlo.json. Existing parts are only repeated if they
are named:

    python benchmarks/monte_carlo.py                       # missing parts: throughput growth dask steps estimation
    python benchmarks/monte_carlo.py throughput steps      # repeat these
"""

from __future__ import annotations

import json
import os
import platform as machine
import resource
import socket
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_name] = "1"

import mujoco
import numpy as np
from mujoco import rollout
from provenance import commit, write_page

import equipoise
from equipoise import BayesianMethod, PaperMethod, calibrate, estimate, load_robot, simulate
from equipoise.lab.study.executors import dask_cluster
from equipoise.lab.study.processes import Processes
from equipoise.lab.study.rows import column, failed
from equipoise.lab.study.runner import run_study
from equipoise.lab.study.study import Study, draw
from equipoise.method.table import method_named

RESULTS = Path(__file__).parent / "results"
CORES = os.cpu_count() or 1
STEPS = (0.25e-3, 0.5e-3, 1e-3)  # [s]
THROUGHPUT_TRIALS = 60
GROWTH = (100, 200, 500, 1000, 2000)
DASK_TRIALS = 80
STEP_ROBOTS = {"unitree_a1": 60, "go2": 30, "anymal_c": 30, "solo12": 30, "b1": 30}
STEP_PRECISE = 12
STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS


def commands_of(trial: int, timestep: float) -> tuple[mujoco.MjModel, np.ndarray, np.ndarray]:
    """Return the engine's model, initial state and all controls of one trial's calibration."""
    drawn = draw(Study(), trial)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with simulate(drawn.robot, drawn.sizes, drawn.payload, drawn.seed, timestep=timestep) as simulation:
            platform = simulation.platform
            model, data = platform._model, platform._data
            initial = np.zeros(mujoco.mj_stateSize(model, STATE))
            mujoco.mj_getState(model, data, initial, STATE)
            controls: list[np.ndarray] = []
            roll = platform._roll
            platform._roll = lambda control, turn=0.0: controls.append(control) or roll(control, turn)
            calibrate(platform, drawn.robot, PaperMethod())
    return model, initial, np.concatenate(controls)


def roll_alone(trial: int, timestep: float, begin: float, repeats: int) -> tuple[int, float]:
    """Return steps and seconds of `mujoco.rollout` alone with one trial's commands, from a common start time."""
    model, initial, controls = commands_of(trial, timestep)
    engine = rollout.Rollout(nthread=0)
    data = mujoco.MjData(model)
    time.sleep(max(0.0, begin - time.time()))
    start = time.perf_counter()
    for _ in range(repeats):
        engine.rollout(model, data, initial[None], controls[None])
    return repeats * len(controls), time.perf_counter() - start


def throughput() -> list[dict[str, float]]:
    """Measure engine steps per second of a study and of `mujoco.rollout` alone, in the same processes."""
    rows = []
    for timestep in STEPS:
        with Processes(CORES) as pool, tempfile.TemporaryDirectory() as folder:
            run_study(Study(timestep=timestep, seed=99), 15 * CORES, Path(folder) / "warm", pool, CORES)
            rounds = []
            for index in range(2):  # before and after, because machines drift
                rounds.append(alone(pool, timestep))
                if index == 0:
                    start = time.perf_counter()
                    study = run_study(Study(timestep=timestep), THROUGHPUT_TRIALS, Path(folder) / "study", pool, CORES)
                    wall = time.perf_counter() - start
        steps = float(np.sum(column(study, "simulated_time"))) / timestep
        rows.append({"timestep": timestep, "study": steps / wall, "alone": float(np.mean(rounds)),
                     "trials_per_second": THROUGHPUT_TRIALS / wall})  # fmt: skip
        print(rows[-1], flush=True)
    return rows


def alone(pool: Processes, timestep: float) -> float:
    """Measure steps per second of `mujoco.rollout` in all processes together."""
    begin = time.time() + 8.0  # time to compute the commands
    futures = [pool.submit(roll_alone, trial, timestep, begin, round(4e-3 / timestep)) for trial in range(CORES)]
    return sum(steps / seconds for steps, seconds in (future.result() for future in futures))


def growth() -> dict[str, object]:
    """Measure the seconds until each number of trials of a study, including start-up."""
    reached: dict[int, float] = {}
    start = time.perf_counter()

    def note(progress: object) -> None:
        if progress.done in GROWTH:
            reached[progress.done] = time.perf_counter() - start
            print(progress.done, reached[progress.done], flush=True)

    with tempfile.TemporaryDirectory() as folder:
        rows = run_study(Study(), max(GROWTH), Path(folder) / "study", None, CORES, note)
    assert rows.num_rows == max(GROWTH)
    counts, seconds = np.array(list(reached)), np.array(list(reached.values()))
    slope, offset = np.polyfit(counts, seconds, 1)
    worst = float(np.max(np.abs(offset + slope * counts - seconds) / seconds))
    return {"seconds": reached, "per_trial": float(slope), "offset": float(offset), "worst_residual": worst,
            "failed": failed(rows)}  # fmt: skip


def dask() -> dict[str, float]:
    """Measure trials per second of one and two Dask workers over TCP, each a process with one thread."""
    rates: dict[str, float] = {}
    for workers in (1, 2):
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        address = f"tcp://127.0.0.1:{port}"
        scheduler = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", str(port),
                     "--no-dashboard"]  # fmt: skip
        worker = [sys.executable, "-m", "distributed.cli.dask_worker", address, "--nthreads", "1", "--no-dashboard"]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        processes = [subprocess.Popen(scheduler, **quiet), *(subprocess.Popen(worker, **quiet) for _ in range(workers))]
        try:
            wait_for_workers(address, workers)
            with dask_cluster(address) as (pool, threads), tempfile.TemporaryDirectory() as folder:
                run_study(Study(seed=99), 4 * workers, Path(folder) / "warm", pool, threads)
                start = time.perf_counter()
                run_study(Study(), DASK_TRIALS, Path(folder) / "study", pool, threads)
                rates[str(workers)] = DASK_TRIALS / (time.perf_counter() - start)
        finally:
            for process in reversed(processes):
                process.terminate()
            for process in processes:
                process.wait()
        print(workers, "Dask workers:", rates[str(workers)], "trials a second", flush=True)
    return rates


def wait_for_workers(address: str, count: int) -> None:
    from distributed import Client  # noqa: PLC0415 - an extra

    for _ in range(60):
        try:
            with Client(address, timeout=5) as client:
                client.wait_for_workers(count, timeout=60)
                return
        except OSError:
            time.sleep(1)
    raise SystemExit(f"the Dask scheduler at {address} did not start")


def steps() -> list[dict[str, object]]:
    """Run the same trials at different engine steps; return the changes of results and their errors."""
    rows = []
    cases = [(name, "paper", count) for name, count in STEP_ROBOTS.items()] + [("unitree_a1", "bayesian", STEP_PRECISE)]
    names = ("com_x", "com_y")
    with Processes(CORES) as pool, tempfile.TemporaryDirectory() as folder:
        for name, method, count in cases:
            found = {}
            for timestep in STEPS:
                study = Study(name, (method_named(method)(),), timestep=timestep)
                trials = run_study(study, count, Path(folder) / f"{name}-{method}-{timestep}", pool, CORES)
                errors = [column(trials, f"estimated_{axis}") - column(trials, f"true_{axis}") for axis in names]
                moments = [column(trials, f"moment_{axis}") for axis in ("roll", "pitch", "yaw")]
                found[timestep] = (np.array(errors), np.array(moments), failed(trials))
            truth = np.array([column(trials, f"true_{axis}") for axis in ("Ixx", "Iyy", "Izz")])
            for coarse in STEPS[1:]:
                reference = found[STEPS[1] if coarse == STEPS[2] else STEPS[0]]
                rows.append({
                    "robot": name, "method": method, "trials": count,
                    "from": STEPS[1] if coarse == STEPS[2] else STEPS[0], "to": coarse, "failed": found[coarse][2],
                    "com_moved_mm": 1000 * rms(found[coarse][0] - reference[0]), "com_error_mm": 1000 * rms(reference[0]),
                    "moment_moved": rms((found[coarse][1] - reference[1]) / truth),
                    "moment_error": rms(reference[1] / truth - 1),
                })  # fmt: skip
                print(rows[-1], flush=True)
    return rows


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(values**2)))


def estimation() -> dict[str, float]:
    """Measure seconds and memory of the estimation of one `bayesian` run in a separate process."""
    with Processes(1) as pool:
        recordings = pool.submit(bayesian_recordings).result()
    with Processes(1) as pool:
        return pool.submit(estimate_alone, recordings).result()


def bayesian_recordings() -> list[equipoise.Recording]:
    robot = load_robot("unitree_a1")
    recordings: list[equipoise.Recording] = []
    with warnings.catch_warnings(), simulate(robot, "realistic", "1,0.05,0.02,0.08", 3) as simulation:
        warnings.simplefilter("ignore")
        calibrate(simulation.platform, robot, BayesianMethod(), recordings.append)
    return recordings


def estimate_alone(recordings: list[equipoise.Recording]) -> dict[str, float]:
    robot = load_robot("unitree_a1")
    times = []
    for _ in range(3):
        start = time.process_time()
        estimate(robot, recordings, BayesianMethod())
        times.append(time.process_time() - start)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {"seconds": float(np.median(times)), "peak_mb": peak,
            "recorded_s": sum(recording.duration for recording in recordings)}  # fmt: skip


PARTS: dict[str, Callable[[], object]] = {
    "throughput": throughput, "growth": growth, "dask": dask, "steps": steps, "estimation": estimation,
}  # fmt: skip


def verdict(met: bool) -> str:
    return "met" if met else "**missed**"


def made_at(found: dict[str, object]) -> str:
    """Return commits of the parts, and load of the machine at their start."""
    parts = (f"{name} at {made['commit']}, load {made['load']}" for name, made in found.get("made", {}).items())
    return f"Made: {'; '.join(parts) or 'at unknown commits'}."


def report(found: dict[str, object]) -> str:
    lines = [
        "# Monte Carlo studies: speed, scaling, time step",
        "",
        f"`make bench-monte-carlo`; equipoise {equipoise.__version__}, MuJoCo {mujoco.__version__}, Python "
        f"{machine.python_version()}, {CORES} cores. Unitree A1, method `paper`, preset `realistic`, random payloads, unless "
        "said otherwise. " + made_at(found),
    ]
    if "throughput" in found:
        lines += [
            "", "## Physics throughput", "",
            f"Engine steps per second of a whole study on {CORES} processes (including drawing, building, planning, sensing, "
            "estimating and storing), and of `mujoco.rollout` alone with the same models, horizons, commands and number of "
            "processes, before and after the study. The study starts on processes after fifteen trials each. "
            "Target: 0.87.",
            "", "| engine step | study | `mujoco.rollout` alone | ratio | | calibrations per second |",
            "|---|---|---|---|---|---|",
        ]  # fmt: skip
        for row in found["throughput"]:
            ratio = row["study"] / row["alone"]
            lines.append(
                f"| {1000 * row['timestep']:g} ms | {row['study']:,.0f} | {row['alone']:,.0f} | {ratio:.2f} | "
                f"{verdict(ratio >= 0.87)} | {row['trials_per_second']:.2f} |"
            )
    if "growth" in found:
        part = found["growth"]
        seconds = {int(count): value for count, value in part["seconds"].items()}
        lines += [
            "", "## Scaling", "", "Time until the trials of a study were stored, including the start of the workers.", "",
            "| trials | time |", "|---|---|",
            *(f"| {count:,} | {value / 60:.1f} min |" for count, value in seconds.items()), "",
            f"Linear fit: {part['per_trial']:.3f} s per trial and {part['offset']:+.1f} s at the start; largest residual "
            f"{part['worst_residual']:.1%}. {part['failed']} of {max(seconds):,} calibrations failed.", "",
            f"Target: 1,000 in under 20 minutes on two cores: {verdict(seconds[1000] < 1200)}.",
        ]  # fmt: skip
    if "dask" in found:
        rates = found["dask"]
        gain = rates["2"] / rates["1"]
        lines += [
            "", "## Dask workers over TCP, on this machine", "", "| workers | calibrations per second |", "|---|---|",
            *(f"| {count} | {rate:.2f} |" for count, rate in rates.items()), "",
            f"Speed-up with two workers: {gain:.2f}; target 1.6: {verdict(gain >= 1.6)}.",
        ]  # fmt: skip
    if "steps" in found:
        lines += [
            "", "## Engine steps", "",
            "The same trials at another engine step: RMS change of the results, and RMS of their errors. A coarser step is "
            "acceptable up to a ratio of 0.1. Studies use 1 ms for `paper` and `static`, and 0.5 ms for "
            "`bayesian`.",
            "", "| robot | method | trials | steps | planar CoM change | its error | ratio | I change | its error | ratio "
            "| failed |",
            "|---|---|---|---|---|---|---|---|---|---|---|",
        ]  # fmt: skip
        for row in found["steps"]:
            lines.append(
                f"| {row['robot']} | {row['method']} | {row['trials']} | {1000 * row['from']:g} to {1000 * row['to']:g} ms | "
                f"{row['com_moved_mm']:.3f} mm | {row['com_error_mm']:.2f} mm | "
                f"{row['com_moved_mm'] / row['com_error_mm']:.2f} | "
                f"{row['moment_moved']:.2%} | {row['moment_error']:.0%} | {row['moment_moved'] / row['moment_error']:.2f} | "
                f"{row['failed']} |"
            )
    if "estimation" in found:
        part = found["estimation"]
        lines += [
            "", "## Estimation of one `bayesian` run", "",
            f"{part['recorded_s']:.0f} s of recordings, with intervals and checks, on one core: {part['seconds']:.2f} s "
            f"(target 3: {verdict(part['seconds'] < 3)}); peak memory of the process {part['peak_mb']:.0f} MB (target 500: "
            f"{verdict(part['peak_mb'] < 500)}).",
        ]  # fmt: skip
    return "\n".join(lines) + "\n"


def main() -> None:
    store = RESULTS / "monte_carlo.json"
    found = json.loads(store.read_text(encoding="utf-8")) if store.exists() else {}
    named = sys.argv[1:]
    if unknown := [name for name in named if name not in PARTS]:
        raise SystemExit(f"{unknown[0]!r} is not a part; use {', '.join(PARTS)}")
    for name in named or [name for name in PARTS if name not in found]:
        print(name, flush=True)
        load = os.getloadavg()[0]
        found[name] = PARTS[name]()
        found.setdefault("made", {})[name] = {"commit": commit(), "load": load}
        store.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    write_page("monte_carlo.md", report(found), found["made"].values())
    print(report(found))


if __name__ == "__main__":
    main()
