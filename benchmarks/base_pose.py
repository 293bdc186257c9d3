"""Accuracy of estimates from logs with the base's pose in place of an accelerometer. Writes benchmarks/results/base_pose.md.

Simulated robots with a payload trot for 20 s (equipoise.lab.gaits.trot, MuJoCo, preset `realistic`). Poses of the base with
the noise of motion capture, joints and torques are written at 200 Hz as three files without names, in Pinocchio's order of a
free joint, and read with the columns that equipoise proposes. An interrupted benchmark resumes from base_pose.jsonl.

    python benchmarks/base_pose.py              # missing runs, then the page
    python benchmarks/base_pose.py --seeds 2    # the first seeds only
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import numpy as np
from provenance import commit, write_page
from scipy.spatial.transform import Rotation
from walking import SCALE_ERROR, keep, numbers, payload_of, rms

from equipoise import BayesianMethod, Recording, RobotModel, load_robot, nominal_stance, simulate
from equipoise.errors import EquipoiseError, RecordingError
from equipoise.lab.gaits.trot import trot
from equipoise.logs.offline import estimate_log
from equipoise.logs.reader import read_log
from equipoise.logs.tables.column_names import ColumnProposal, Columns

RESULTS = Path(__file__).parent / "results"
ROWS = RESULTS / "base_pose.jsonl"
FIRST_SEED, SEEDS, DURATION = 20_000, 10, 20.0
RATE, POSITION_NOISE, ANGLE_NOISE = 200.0, 3e-4, 1e-3  # [Hz], [m], [rad]
ROBOTS = ("unitree_a1", "go2")
FILES = ("p_sense.csv", "v_sense.csv", "tau_sense.csv")
SOURCES = {"pose and gyroscope": FILES, "pose": FILES[::2]}


def write(recording: Recording, poses: np.ndarray, seed: int, folder: Path) -> None:
    """Write the files; poses are (n, 8) times, positions and quaternions, w first."""
    random, joints, imu = np.random.default_rng([seed, 79]), recording.joints, recording.imu
    time = np.arange(joints.time[0] + 0.02, joints.time[-1] - 0.02, 1 / RATE)

    def at(times: np.ndarray, values: np.ndarray) -> np.ndarray:
        return np.column_stack([np.interp(time, times, column) for column in values.T])

    position = at(poses[:, 0], poses[:, 1:4]) + random.normal(0, POSITION_NOISE, (len(time), 3))
    noise = Rotation.from_rotvec(random.normal(0, ANGLE_NOISE, (len(time), 3)))
    quaternion = (Rotation.from_quat(np.roll(at(poses[:, 0], poses[:, 4:]), -1, axis=1)) * noise).as_quat()
    turning = at(imu.time, imu.angular_velocity_in_imu)
    tables = (
        [position, quaternion, at(joints.time, joints.position)],
        [np.gradient(position, time, axis=0), turning, at(joints.time, np.asarray(joints.velocity))],
        [at(joints.time, np.asarray(joints.torque))],
    )
    for name, table in zip(FILES, tables, strict=True):
        np.savetxt(folder / name, np.hstack([time[:, None], *table]), delimiter=",", fmt="%.9f")


def walked(robot: RobotModel, seed: int) -> tuple[Recording, np.ndarray, np.ndarray]:
    """Return a trot, the poses of its base, and the true body's components."""
    poses: list[tuple[float, ...]] = []
    with simulate(robot, "realistic", payload_of(robot, seed), seed) as simulation:
        platform = simulation.platform
        step = platform.step

        def seen(*arguments: object, **named: object) -> object:
            state = step(*arguments, **named)
            poses.append((state.time, *platform._data.qpos[:7]))
            return state

        platform.step = seen
        recording = trot(platform, robot, (1 + DURATION) * nominal_stance(robot).scale.time, phase=float(seed))
        return recording, np.array(poses), simulation.truth.composite


def runs(name: str, seed: int) -> Iterator[dict[str, object]]:
    """Yield a row for each source of the angular velocity."""
    warnings.simplefilter("ignore")
    robot = load_robot(name)
    recording, poses, truth = walked(robot, seed)
    weighed = truth.mass * (1 + SCALE_ERROR * float(np.random.default_rng([seed, 77]).standard_normal()))
    with tempfile.TemporaryDirectory() as folder:
        write(recording, poses, seed, Path(folder))
        for source, files in SOURCES.items():
            row: dict[str, object] = {"key": f"{name}/{source}/{seed}", "case": f"{name}/{source}", "commit": commit()}
            paths = [Path(folder, file) for file in files]
            try:
                columns = proposed(robot, paths)
                log = read_log(paths[0], robot, columns=columns, tables=paths[1:])
                method = BayesianMethod(mass=weighed, mass_std=SCALE_ERROR * weighed)
                row |= numbers(estimate_log(robot, log, method).result, truth)
            except EquipoiseError as error:
                row["failed"] = f"{type(error).__name__}: {error}"
            yield row


def proposed(robot: RobotModel, paths: list[Path]) -> Columns:
    report: object = None
    try:
        read_log(paths[0], robot, tables=paths[1:])
    except RecordingError as error:
        report = error.report
    assert isinstance(report, ColumnProposal)  # files without names need columns
    return Columns.from_text(report.text, "the proposal")


def lines(rows: list[dict]) -> Iterator[str]:
    """Write the page."""
    yield "# Logs with the pose of the base in place of an accelerometer"
    yield ""
    yield (
        f"`python benchmarks/base_pose.py`: robots with a payload trot for {DURATION:.0f} s (MuJoCo, `realistic`); poses of "
        f"the base with noise of {1e3 * POSITION_NOISE:g} mm and {1e3 * ANGLE_NOISE:g} mrad, joints and torques at "
        f"{RATE:.0f} Hz, in files without names, read with the proposed columns; a scale with an error of 0.5 %. Root mean "
        "square errors of the whole robot; *file*: the model file without the payload; *z*: rms of error over std, of all ten "
        f"parameters. Seeds from {FIRST_SEED} on, not used in development. Such a log determines "
        "mass and planar CoM; moments of inertia are wrong by up to 103 %. *Checks*: runs with a failed check."
    )
    yield ""
    yield "| robot | angular velocity | n | CoM x, y, z [mm] | file | Ixx, Iyy, Izz [%] | file | z | coverage | checks |"
    yield "|" + "---|" * 10
    for name in ROBOTS:
        for source in SOURCES:
            of = [row for row in rows if row["case"] == f"{name}/{source}" and "error" in row]
            if not of:
                continue
            error, model, stds, size = (
                np.array([row[part] for row in of]) for part in ("error", "model", "sd", "size")
            )
            cells = [" ".join(f"{value:.1f}" for value in 1e3 * rms(part[:, 1:4])) for part in (error, model)] + [
                " ".join(f"{value:.0f}" for value in 100 * rms(part[:, 4:7] / size)) for part in (error, model)
            ]
            held, failed = np.mean([row["inside"] for row in of]), sum(bool(row["checks"]) for row in of)
            yield (
                f"| {name} | {source.replace('pose and ', '')} | {len(of)} | {' | '.join(cells)} | "
                f"{np.sqrt(np.mean((error / stds) ** 2)):.2f} | {held:.0%} | {failed} |"
            )
    yield ""
    for row in rows:
        if "failed" in row:
            yield f"- {row['key']}: {row['failed']}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=SEEDS, help="number of seeds per robot")
    arguments = parser.parse_args()
    rows = [json.loads(line) for line in ROWS.read_text(encoding="utf-8").splitlines()] if ROWS.exists() else []
    done = {row["key"] for row in rows}
    for seed in range(FIRST_SEED, FIRST_SEED + arguments.seeds):
        for name in ROBOTS:
            if all(f"{name}/{source}/{seed}" in done for source in SOURCES):
                continue
            for row in runs(name, seed):
                keep(rows, ROWS, row)
    write_page("base_pose.md", "\n".join(lines(rows)) + "\n", rows)


if __name__ == "__main__":
    main()
