"""How much is lost when a log comes without our events: `make bench-logs`. Writes benchmarks/results/logs.md.

Simulated calibrations with ordinary sensors and a payload are estimated from our own recordings, and again from one long log
without events, in which `equipoise estimate LOG` has to find what can be used; at the sensors' own rate, and thinned out.
"""

from __future__ import annotations

import os
import warnings
from dataclasses import replace
from pathlib import Path

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import numpy as np

from equipoise import Calibration, Recording, calibrate, load_robot, simulate
from equipoise.errors import ModelWarning
from equipoise.logs.log import RawImu, RawJoints, RawLog, assemble
from equipoise.logs.offline import estimate_log
from equipoise.result.statistics import NORMAL_95
from equipoise.robot.inertial import RobotInertia, components

RESULTS = Path(__file__).parent / "results"
ROBOTS = {"unitree_a1": "1.5,0.05,-0.02,0.06", "go2": "1.5,0.05,0.02,0.06", "solo12": "0.3,0.03,0.01,0.04"}
SEEDS = range(31, 36)
WAYS = {"our events": None, "log, 500 Hz": (1, 1), "log, joints 100 Hz, IMU 250 Hz": (5, 2)}


def thinned(stream: object, step: int) -> list[np.ndarray]:
    """The arrays of a stream, every so manieth sample."""
    return [getattr(stream, name)[::step] for name in type(stream).__dataclass_fields__]


def raw_log(recordings: list[Recording], steps: tuple[int, int]) -> RawLog:
    """All recordings as one log."""
    log = replace(Recording.concatenate(recordings), events=())
    time, *joints = thinned(log.joints, steps[0])
    return RawLog(RawJoints(time, log.joint_names, *joints), RawImu(*thinned(log.imu, steps[1])))


def errors(result: Calibration, truth: RobotInertia) -> tuple[np.ndarray, np.ndarray]:
    """(10,) errors, and (10,) those over half their 95 % intervals."""
    off = result.composite.values - components(truth.composite)
    return off, off / (NORMAL_95 * result.composite.deviations)


def run(name: str, payload: str, seed: int) -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Errors, over intervals, and the truth, of each way."""
    robot, recordings = load_robot(name), list[Recording]()
    with simulate(robot, "realistic", payload, seed) as simulation:
        own = calibrate(simulation.platform, robot, keep=recordings.append)
    found = {}
    for way, steps in WAYS.items():
        result = own if steps is None else estimate_log(robot, assemble(robot, raw_log(recordings, steps))).result
        found[way] = (*errors(result, simulation.truth), components(simulation.truth.composite))
    print(name, seed, flush=True)
    return found


def row(name: str, way: str, runs: list[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> str:
    off, over, truth = (np.array(part) for part in zip(*runs, strict=True))
    rms = np.sqrt(np.mean(off**2, axis=0))
    relative = 100 * np.sqrt(np.mean((off / truth) ** 2, axis=0))
    com = " ".join(f"{1000 * value:.2f}" for value in rms[1:4])
    inertia = " ".join(f"{value:.1f}" for value in relative[4:7])
    return f"| {name} | {way} | {relative[0]:.1f} | {com} | {inertia} | {np.mean(np.abs(over) < 1):.0%} |"


def main() -> None:
    """All robots, all seeds."""
    warnings.simplefilter("ignore", ModelWarning)
    lines = [
        "# Estimates from logs without our events",
        "",
        f"`make bench-logs`; {len(SEEDS)} simulated calibrations each, `--noise realistic`, with a payload. Root mean square "
        "errors of the whole robot.",
        "",
        "| robot | estimated from | mass [%] | CoM x y z [mm] | Ixx Iyy Izz [%] | within 95 % intervals |",
        "|---|---|---|---|---|---|",
    ]
    for name, payload in ROBOTS.items():
        runs = [run(name, payload, seed) for seed in SEEDS]
        lines += [row(name, way, [one[way] for one in runs]) for way in WAYS]
    (RESULTS / "logs.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
