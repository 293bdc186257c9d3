"""Accuracy of estimates from logs without equipoise's events: `make bench-logs`. Writes benchmarks/results/logs.md.

Simulated calibrations with typical sensors and a payload are estimated from their recordings, and from one long log without
events, in which `equipoise estimate LOG` detects the usable motions. Logs have the full rate or a reduced one, no joint
velocities, or a fused orientation instead of the gyroscope.
"""

from __future__ import annotations

import os
import warnings
from dataclasses import replace
from pathlib import Path

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import numpy as np
from provenance import write_page
from scipy.spatial.transform import Rotation

from equipoise import Calibration, Recording, calibrate, load_robot, simulate
from equipoise.errors import ModelWarning
from equipoise.logs.offline import estimate_log
from equipoise.logs.raw_log import RawImu, RawJoints, RawLog, assemble
from equipoise.result.statistics import NORMAL_95
from equipoise.robot.inertial import RobotInertia, components

RESULTS = Path(__file__).parent / "results"
ROBOTS = {"unitree_a1": "1.5,0.05,-0.02,0.06", "go2": "1.5,0.05,0.02,0.06", "solo12": "0.3,0.03,0.01,0.04"}
SEEDS = range(10_000, 10_005)  # below are for development
# Decimation of joints and IMU, and the missing quantity.
WAYS: dict[str, tuple[int, int, str] | None] = {
    "our events": None,
    "log, 500 Hz": (1, 1, ""),
    "log, joints 100 Hz, IMU 250 Hz": (5, 2, ""),
    "log, 100 Hz": (5, 5, ""),
    "log, 50 Hz": (10, 10, ""),
    "log, 500 Hz, no velocities": (1, 1, "velocity"),
    "log, 500 Hz, orientation for gyroscope": (1, 1, "gyroscope"),
}
_PULL = 0.5  # [1/s], common gain of the filter's correction by the accelerometer


def thinned(stream: object, step: int) -> list[np.ndarray]:
    """Return the decimated arrays of a stream."""
    return [getattr(stream, name)[::step] for name in type(stream).__dataclass_fields__]


def raw_log(recordings: list[Recording], joint_step: int, imu_step: int, without: str) -> RawLog:
    """Return all recordings as one log."""
    log = replace(Recording.concatenate(recordings), events=())
    time, position, velocity, torque = thinned(log.joints, joint_step)
    imu_time, gyroscope, accelerometer = thinned(log.imu, imu_step)
    imu = RawImu(imu_time, gyroscope, accelerometer)
    if without == "gyroscope":
        imu = RawImu(imu_time, None, accelerometer, fused(imu_time, gyroscope, accelerometer))
    return RawLog(RawJoints(time, log.joint_names, position, None if without == "velocity" else velocity, torque), imu)


def fused(time: np.ndarray, gyroscope: np.ndarray, accelerometer: np.ndarray) -> np.ndarray:
    """Return the (n, 4) orientation of a complementary filter, w first."""
    felt = accelerometer / np.linalg.norm(accelerometer, axis=1)[:, None]
    now = Rotation.align_vectors([[0.0, 0.0, 1.0]], felt[:1])[0].as_matrix()
    found = np.empty((len(time), 3, 3))
    for k, step in enumerate(np.diff(time, prepend=time[0])):
        x, y, z = (gyroscope[k] + _PULL * np.cross(felt[k], now[2])) * step
        now = now @ np.array([[1, -z, y], [z, 1, -x], [-y, x, 1]])
        if k % 10 == 0:
            now = Rotation.from_matrix(now).as_matrix()
        found[k] = now
    return np.roll(Rotation.from_matrix(found).as_quat(), 1, axis=1)


def errors(result: Calibration, truth: RobotInertia) -> tuple[np.ndarray, np.ndarray]:
    """Return (10,) errors, and (10,) half widths of 95 % intervals."""
    return result.composite.values - components(truth.composite), NORMAL_95 * result.composite.stds


def run(name: str, payload: str, seed: int) -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Return errors, half widths and truth of each source."""
    robot, recordings = load_robot(name), list[Recording]()
    with simulate(robot, "realistic", payload, seed) as simulation:
        own = calibrate(simulation.platform, robot, keep=recordings.append)
    found = {}
    for way, steps in WAYS.items():
        result = own if steps is None else estimate_log(robot, assemble(robot, raw_log(recordings, *steps))).result
        found[way] = (*errors(result, simulation.truth), components(simulation.truth.composite))
    print(name, seed, flush=True)
    return found


def row(name: str, way: str, runs: list[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> str:
    off, half, truth = (np.array(part) for part in zip(*runs, strict=True))
    rms = np.sqrt(np.mean(off**2, axis=0))
    relative = 100 * np.sqrt(np.mean((off / truth) ** 2, axis=0))
    com, wide = (" ".join(f"{1000 * value:.2f}" for value in of[1:4]) for of in (rms, half.mean(axis=0)))
    inertia = " ".join(f"{value:.1f}" for value in relative[4:7])
    return f"| {name} | {way} | {relative[0]:.1f} | {com} | {wide} | {inertia} | {np.mean(np.abs(off) < half):.0%} |"


def main() -> None:
    """Run all cases and write the page."""
    warnings.simplefilter("ignore", ModelWarning)
    lines = [
        "# Estimates from logs without events",
        "",
        f"`make bench-logs`; {len(SEEDS)} simulated calibrations each, `--sim-preset realistic`, with a "
        "payload. Root mean square errors of the whole robot, and mean 95 % intervals of its CoM.",
        "",
        "| robot | estimated from | mass [%] | CoM x y z [mm] | CoM intervals +- [mm] | Ixx Iyy Izz [%] | coverage |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, payload in ROBOTS.items():
        runs = [run(name, payload, seed) for seed in SEEDS]
        lines += [row(name, way, [one[way] for one in runs]) for way in WAYS]
    write_page("logs.md", "\n".join(lines) + "\n")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
