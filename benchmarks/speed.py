"""What a `paper` calibration of the A1 costs beside the physics alone: `make bench-speed`.

Writes benchmarks/results/speed.md. One process, one core; the runs alternate, medians are compared.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import mujoco
import numpy as np

import equipoise
from equipoise import Paper, RunFolder, calibrate, load_robot, simulate
from equipoise.recording.recording import Recording

RESULTS = Path(__file__).parent / "results"
REPEATS = 7


def timed(function: Callable[[], object]) -> float:
    start = time.process_time()
    function()
    return time.process_time() - start


def one_round() -> tuple[float, float, float, int, list[Recording]]:
    """CPU seconds of a calibration, of `mj_step` alone and with the same commands; steps; recordings."""
    robot = load_robot("unitree_a1")
    simulation = simulate(robot, "ideal")
    platform = simulation.platform
    model, start = platform._model, mujoco.MjData(platform._model)
    start.qpos[:], start.qvel[:] = platform._data.qpos, platform._data.qvel
    controls: list[np.ndarray] = []
    roll = platform._roll
    platform._roll = lambda control: controls.append(control) or roll(control)
    recordings: list[Recording] = []
    routine = timed(lambda: calibrate(platform, robot, Paper(), keep=recordings.append))
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
    """Wall seconds and megabytes of writing a run's recordings."""
    robot = load_robot("unitree_a1")
    with tempfile.TemporaryDirectory() as folder:
        with RunFolder.create(Path(folder) / "run", robot, Paper(), {}) as run:
            start = time.perf_counter()
            for recording in recordings:
                run.keep(recording)
            elapsed = time.perf_counter() - start
        size = sum(file.stat().st_size for file in Path(folder).rglob("*") if file.is_file())
    return elapsed, size / 1e6


def wall(*arguments: str) -> float:
    """Median wall seconds of a Python process."""
    times: list[float] = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)
        times.append(time.perf_counter() - start)
    return statistics.median(times)


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
        f"`make bench-speed`; equipoise {equipoise.__version__}, MuJoCo {mujoco.__version__}, {REPEATS} rounds on one core, "
        "CPU seconds, medians. Motion, sensing and estimating; without start-up, storage and pictures.",
        "",
        "| what | CPU s | over `mj_step` |",
        "|---|---|---|",
        f"| the whole calibration ({steps} engine steps) | {routine:.3f} | {statistics.median(ratios):.2f} "
        f"({ratios[0]:.2f} to {ratios[-1]:.2f}) |",
        f"| `mj_step` alone, as many steps, the robot standing | {alone:.3f} | 1 |",
        f"| `mj_step` with the calibration's own commands | {replay:.3f} | {replay / alone:.2f} |",
        "",
        f"Target: at most 1.5 times `mj_step` alone: **{'met' if statistics.median(ratios) <= 1.5 else 'missed'}**; against "
        f"the same motion replayed: {routine / replay:.2f}.",
        "",
        f"Storage beside it: {store:.3f} s wall for {megabytes:.1f} MB.",
        "",
        "| start-up | median wall s | target |",
        "|---|---|---|",
        f"| `import equipoise` | {wall('-c', 'import equipoise'):.2f} | 0.6 |",
        f"| `import equipoise` and every name that needs no simulator | {wall('-c', eager):.2f} | 0.6 |",
        f"| `equipoise --help` | {wall('-m', 'equipoise', '--help'):.2f} | 1.0 |",
    ]
    text = "\n".join(lines) + "\n"
    (RESULTS / "speed.md").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
