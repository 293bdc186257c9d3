"""Effect and detection of wrong model files: `make bench-wrong-files`.

Simulated robots are calibrated, and their recordings are also estimated with files with a shifted IMU, longer legs, shifted
hips, or of another robot. Writes benchmarks/results/wrong_files.md. An interrupted benchmark resumes from wrong_files.jsonl.
"""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import numpy as np
from accuracy import payload_of, rounded
from provenance import commit, write_page

from equipoise import BayesianMethod, RobotModel, calibrate, load_robot, nominal_stance, simulate
from equipoise.errors import EquipoiseError
from equipoise.recording.recording import Recording
from equipoise.result.statistics import NORMAL_95
from equipoise.robot.description import RobotDescription
from equipoise.robot.inertial import components

RESULTS = Path(__file__).parent / "results"
ROWS = RESULTS / "wrong_files.jsonl"
FIRST = 10_000  # seeds below are for development
SEEDS = {
    ("unitree_a1", "realistic"): 6,
    ("unitree_a1", "stress"): 6,
    ("go2", "stress"): 4,
    ("anymal_c", "stress"): 4,
}
OTHER = {"unitree_a1": "go2", "go2": "unitree_a1", "anymal_c": "anymal_b"}
SILENT = 4.0  # standard deviations
Row = dict[str, Any]


def as_it_is(name: str) -> RobotModel:
    return load_robot(name)


def with_imu_at(*shift: float) -> Callable[[str], RobotModel]:
    """Return a function that shifts the IMU in the file [m]."""

    def model(name: str) -> RobotModel:
        place = np.array(load_robot(name).imu_in_base.translation) + shift
        return load_robot(name, RobotDescription(imu_position=tuple(place.tolist())))

    return model


def with_legs(longer: float, legs: tuple[str, ...] = ("FL", "FR", "RL", "RR")) -> Callable[[str], RobotModel]:
    """Return a function that lengthens thighs and calves in the file [m]."""

    def model(name: str) -> RobotModel:
        robot = changeable(name)
        for leg in (robot.legs[leg] for leg in legs):
            places, frame = robot.pinocchio.jointPlacements, robot.pinocchio.frames[leg.foot_frame_id]
            places[leg.joint_ids[-1]].translation = lengthened(places[leg.joint_ids[-1]].translation, longer)
            foot = frame.placement
            foot.translation = lengthened(foot.translation, longer)
            frame.placement = foot
        return robot

    return model


def with_hips(farther: float) -> Callable[[str], RobotModel]:
    """Return a function that moves the hips in the file farther ahead and behind [m]."""

    def model(name: str) -> RobotModel:
        robot = changeable(name)
        for leg in robot.legs.values():
            place = robot.pinocchio.jointPlacements[leg.joint_ids[0]]
            place.translation = place.translation + farther * np.sign(place.translation) * [1, 0, 0]
        return robot

    return model


def changeable(name: str) -> RobotModel:
    """Return a robot with its own copy of the Pinocchio model."""
    robot = load_robot(name)
    return robot.with_base(robot.pinocchio.inertias[1])


def lengthened(vector: np.ndarray, by: float) -> np.ndarray:
    return vector * (1 + by / np.linalg.norm(vector))


FILES: dict[str, Callable[[str], RobotModel]] = {
    "the robot's": as_it_is,
    "IMU 1 cm up": with_imu_at(0, 0, 0.01),
    "IMU 3 cm up": with_imu_at(0, 0, 0.03),
    "IMU 5 cm ahead, 2 cm to the left": with_imu_at(0.05, 0.02, 0),
    "thighs and calves 5 mm longer": with_legs(5e-3),
    "thighs and calves 15 mm longer": with_legs(15e-3),
    "one leg's thigh and calf 8 mm longer": with_legs(8e-3, ("FL",)),
    "hips 1 cm farther ahead and behind": with_hips(0.01),
    "another robot's": lambda name: load_robot(OTHER[name]),
}


def run(name: str, preset: str, seed: int) -> list[Row]:
    """Run a calibration and estimate it with each file."""
    robot, kept = load_robot(name), list[Recording]()
    stance = nominal_stance(robot)
    payload = payload_of(robot, np.random.default_rng([seed, 79]))
    with simulate(robot, preset, payload, seed) as simulation:
        mass = simulation.truth.composite.mass * (1 + 0.005 * np.random.default_rng([seed, 77]).standard_normal())
        settings = BayesianMethod(mass=mass)
        calibrate(simulation.platform, robot, settings, kept.append)
    truth = components(simulation.truth.composite)
    rows: list[Row] = []
    for file, made in FILES.items():
        row: Row = {"robot": name, "world": preset, "seed": seed, "file": file, "commit": commit()}
        model = made(name)
        try:
            found = settings.estimate(model, kept, stance)
        except EquipoiseError as error:
            rows.append({**row, "refused": f"{type(error).__name__}: {error}"})
            continue
        rows.append(
            {
                **row,
                "truth": truth.tolist(),
                "error": (found.composite.values - truth).tolist(),
                "sd": found.composite.stds.tolist(),
                "alarms": [check.name for check in found.checks if not check.passed],
                "conflicts": [row.name for row in found.evidence.posterior.unknowns.priors.widened],
            }
        )
    return rows


def table(rows: list[Row]) -> Iterator[str]:
    """Yield the lines of the page."""
    yield "# Wrong model files"
    yield ""
    yield (
        "`make bench-wrong-files`: simulated robots with random payloads, a scale of 0.5 %, 120 s (an A1's), seeds from "
        "10,000. The recordings of each run are estimated with the robot's own file and with others. Another robot: a Go2's "
        "file for an A1, an A1's for a Go2, an ANYmal B's for an ANYmal C. Reported: runs whose result reports a "
        "contradiction with the file; doubtful: a check failed. Silent: an error above four standard deviations without "
        "either. Root mean square errors."
    )
    yield ""
    yield (
        "| robot, preset | file | runs | reported | doubtful | coverage | largest error / std | silent "
        "| CoM x y z [mm] | Ixx Iyy Izz [%] |"
    )
    yield "|" + "---|" * 10
    for (robot, world), count in SEEDS.items():
        for file in FILES:
            of = [row for row in rows if (row["robot"], row["world"], row["file"]) == (robot, world, file)]
            done = [row for row in of if "error" in row]
            if not done:
                continue
            error, sd, truth = (np.array([row[key] for row in done]) for key in ("error", "sd", "truth"))
            z = np.abs(error / sd)
            quiet = np.array([not row["alarms"] and not row["conflicts"] for row in done])
            rms = np.sqrt(np.mean(error**2, axis=0))
            moments = 100 * np.sqrt(np.mean((error[:, 4:7] / truth[:, 4:7]) ** 2, axis=0))
            refused = f" ({len(of) - len(done)} refused)" if len(of) > len(done) else ""
            cells = [
                f"{robot}, {world}",
                file,
                f"{len(done)} of {count}{refused}",
                sum(bool(row["conflicts"]) for row in done),
                sum(bool(row["alarms"]) for row in done),
                f"{np.mean(z < NORMAL_95):.0%}",
                f"{z.max():.1f}",
                int((quiet & (z.max(axis=1) > SILENT)).sum()),
                " ".join(f"{1000 * value:.2f}" for value in rms[1:4]),
                " ".join(f"{value:.1f}" for value in moments),
            ]
            yield f"| {' | '.join(map(str, cells))} |"


def main() -> None:
    warnings.simplefilter("ignore")
    rows = [json.loads(line) for line in ROWS.read_text().splitlines()] if ROWS.exists() else []
    done = {(row["robot"], row["world"], row["seed"]) for row in rows}
    for (name, preset), count in SEEDS.items():
        for seed in range(FIRST, FIRST + count):
            if (name, preset, seed) not in done:
                new = [rounded(row) for row in run(name, preset, seed)]
                rows += new
                print(name, preset, seed, flush=True)
                with ROWS.open("a") as file:
                    file.writelines(json.dumps(row) + "\n" for row in new)
    write_page("wrong_files.md", "\n".join(table(rows)) + "\n", rows)


if __name__ == "__main__":
    main()
