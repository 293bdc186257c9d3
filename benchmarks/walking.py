"""Accuracy of estimates from logs of walking robots: `make bench-walking`. Writes benchmarks/results/walking.md.

Robots with a payload trot for 20 or 60 s (equipoise.lab.gaits.trot) with varying speed, sidesteps and turns, in PyBullet and
DART with the effects that these engines support, and in MuJoCo with all of them. Others crawl (equipoise.lab.gaits.crawl).
Their logs are written as tables and read like foreign logs; the scale has an error of 0.5 % (rms). The same robots are also
calibrated in MuJoCo, to compare lifts and trot. A trot also measures payloads. An interrupted benchmark resumes from
walking.jsonl.

    python benchmarks/walking.py              # missing runs, then the page
    python benchmarks/walking.py --seeds 2    # the first seeds only
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import tempfile
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import numpy as np
from provenance import commit, write_page
from worlds.world import world

from equipoise import BayesianMethod, Payload, Recording, RobotModel, calibrate, load_robot, nominal_stance, simulate
from equipoise.errors import EquipoiseError
from equipoise.estimator.prior_runs.prior_run import PriorRun
from equipoise.lab.gaits.crawl import crawl
from equipoise.lab.gaits.trot import trot
from equipoise.logs.offline import estimate_log
from equipoise.logs.payload import measure_payload_in_log
from equipoise.logs.reader import read_log
from equipoise.result.statistics import NORMAL_95
from equipoise.robot.inertial import COMPONENTS, InertialParameters, components

RESULTS = Path(__file__).parent / "results"
ROWS = RESULTS / "walking.jsonl"
FIRST_SEED, SCALE_ERROR = 10_000, 5e-3
FIRST_PAYLOAD, LOADED, BARE = 20_000, 20, 5  # seeds of payloads
PAYLOADS = (0.5, 2.0)  # [kg]
BARE_WALK = "prior run and bare walk"
MASS_TARGET, PLACE_TARGET, COVERAGE_TARGET, CPU_TARGET = 5.0, 5.0, 0.9, 5.0  # [%], [mm], -, [s]
BUDGET = 60.0  # [s] of the calibrations, on an A1
TARGETS = {("realistic", 20): (3, 3, 8), ("stress", 20): (5, 5, 12), ("realistic", 60): (2, 2, None)}  # [mm] rms


@dataclass(frozen=True)
class Case:
    """Runs of one kind: engine, preset, robot, duration on an A1 [s], number of seeds, gait."""

    engine: str
    noise: str
    robot: str
    duration: int
    seeds: int
    gait: str = "trot"

    @property
    def key(self) -> str:
        key = f"{self.engine}/{self.noise}/{self.robot}/{self.duration}"
        return key if self.gait == "trot" else f"{self.gait}/{key}"


CASES = (
    *(Case(engine, noise, "unitree_a1", 20, 10) for engine in ("pybullet", "dart") for noise in ("realistic", "stress")),
    *(Case("mujoco", noise, "unitree_a1", 20, 10) for noise in ("realistic", "stress")),
    *(Case(engine, "realistic", "go2", 20, 4) for engine in ("pybullet", "dart")),
    Case("pybullet", "realistic", "unitree_a1", 60, 4),
    Case("dart", "realistic", "unitree_a1", 60, 4),
    Case("pybullet", "realistic", "unitree_a1", 20, 4, "crawl"),
    Case("dart", "stress", "unitree_a1", 20, 4, "crawl"),
    *(Case("mujoco", noise, "unitree_a1", 20, 4, "crawl") for noise in ("realistic", "stress")),
    Case("dart", "realistic", "go2", 20, 2, "crawl"),
)  # fmt: skip


def payload_of(robot: RobotModel, seed: int) -> Payload:
    """Return a payload of a twelfth of the robot's mass at a random position on its trunk."""
    generator, stance = np.random.default_rng([seed, 78]), nominal_stance(robot)
    half = np.abs(stance.feet_in_base[:, :2]).mean(axis=0)
    place = [*(generator.uniform(-0.4, 0.4, 2) * half), generator.uniform(0.1, 0.3) * stance.hip_height]
    return Payload(InertialParameters(0.08 * robot.mass, np.array(place), np.zeros((3, 3))))


def write(recording: Recording, file: Path) -> None:
    """Write a table with the standard columns of logs."""
    joints, imu = recording.joints, recording.imu
    signals = [f"{signal}.{joint}" for signal in ("position", "velocity", "torque") for joint in recording.joint_names]
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(
            ["time", *signals, *(f"{sensor}.{axis}" for sensor in ("gyro", "accelerometer") for axis in "xyz")]
        )
        rows = [
            joints.time,
            joints.position,
            joints.velocity,
            joints.torque,
            imu.angular_velocity_in_imu,
            imu.acceleration_in_imu,
        ]
        writer.writerows(np.column_stack(rows).tolist())


def run(case: Case, seed: int) -> dict[str, object]:
    """A row."""
    warnings.simplefilter("ignore")
    robot = load_robot(case.robot)
    scale = nominal_stance(robot).scale
    row: dict[str, object] = {"key": f"{case.key}/{seed}", "case": case.key, "seed": seed, "commit": commit()}
    try:
        with world(case.engine, case.noise, robot, payload_of(robot, seed), seed) as (platform, truth):
            walked = {"trot": trot, "crawl": crawl}[case.gait]
            recording = walked(platform, robot, (1 + case.duration) * scale.time, phase=float(seed))
        weighed = truth.mass * (1 + SCALE_ERROR * float(np.random.default_rng([seed, 77]).standard_normal()))
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder, "trot.csv")
            write(recording, file)
            begun = time.process_time()
            found = estimate_log(
                robot, read_log(file, robot), BayesianMethod(mass=weighed, mass_std=SCALE_ERROR * weighed)
            )
            row["cpu"] = time.process_time() - begun
        row |= numbers(found.result, truth)
        row["steps"] = sum(segment.steps for segment in found.report.segments)
        if case.engine == "mujoco" and case.gait == "trot":
            with world(case.engine, case.noise, robot, payload_of(robot, seed), seed) as (platform, truth):
                lifted = calibrate(
                    platform,
                    robot,
                    BayesianMethod(duration=BUDGET * scale.time, mass=weighed, mass_std=SCALE_ERROR * weighed),
                )
            row["lifts"] = numbers(lifted, truth)
    except EquipoiseError as error:
        row["failed"] = f"{type(error).__name__}: {error}"
    return row


def measure(seed: int) -> dict[str, object]:
    """Return a row of the payload of a trot: with or without a prior run, and with a scale, a bare walk or neither."""
    warnings.simplefilter("ignore")
    robot, generator = load_robot("unitree_a1"), np.random.default_rng([seed, 79])
    stance, factor = nominal_stance(robot), 1 + SCALE_ERROR * float(generator.standard_normal())
    half = np.abs(stance.feet_in_base[:, :2]).mean(axis=0)
    place = np.array([*(generator.uniform(-0.4, 0.4, 2) * half), generator.uniform(0.1, 0.3) * stance.hip_height])
    mass = float(generator.uniform(*PAYLOADS))
    loaded = seed < FIRST_PAYLOAD + LOADED
    row: dict[str, object] = {"key": f"payload/{seed}", "case": "payload", "seed": seed, "commit": commit(), "ways": {}}
    row |= {"mass": mass if loaded else 0.0, "place": place.tolist()}
    try:
        with simulate(robot, "realistic", None, seed, noise_seed=2 * seed + 1) as simulation:
            bare = factor * simulation.truth.composite.mass
            method = BayesianMethod(leg_prior="narrow", cable="none", mass=bare)
            first = calibrate(simulation.platform, robot, method)
        prior_run = PriorRun.of(first.evidence.posterior, first.settings, "bare")
        payload = Payload(InertialParameters(mass, place, np.zeros((3, 3)))) if loaded else None
        with simulate(robot, "realistic", payload, seed, noise_seed=2 * seed) as simulation:
            seconds = 60 if seed % 10 == 0 else 20
            recording = trot(simulation.platform, robot, (1 + seconds) * stance.scale.time, phase=float(seed))
            weighed = factor * simulation.truth.composite.mass
        with simulate(robot, "realistic", None, seed, noise_seed=5 * seed) as simulation:
            walk = trot(simulation.platform, robot, 21 * stance.scale.time, phase=seed + 2.5)
        with tempfile.TemporaryDirectory() as folder:
            file, bare_file = Path(folder, "trot.csv"), Path(folder, "bare.csv")
            write(recording, file)
            write(walk, bare_file)
            for way, method in {
                "prior run": BayesianMethod(prior_run=prior_run, cable="none"),
                "prior run and scale": BayesianMethod(prior_run=prior_run, cable="none", mass=weighed),
                BARE_WALK: BayesianMethod(prior_run=prior_run, cable="none"),
                "model file": BayesianMethod(cable="none"),
                "model file and scale": BayesianMethod(cable="none", mass=weighed),
            }.items():
                row["ways"][way] = measured(robot, file, method, bare_file if way == BARE_WALK else None)
        row["seconds"] = seconds
    except EquipoiseError as error:
        row["failed"] = f"{type(error).__name__}: {error}"
    return row


def measured(robot: RobotModel, file: Path, method: BayesianMethod, bare: Path | None) -> dict[str, object]:
    """Return the payload in a log, and the CPU time of reading and estimating it."""
    begun = time.process_time()
    found, _ = measure_payload_in_log(
        robot, read_log(file, robot), method, None if bare is None else read_log(bare, robot)
    )
    payload = [*found.change.payload][:4]
    return {
        "cpu": time.process_time() - begun,
        "answer": found.answer,
        "value": [one.value for one in payload],
        "sd": [one.std for one in payload],
        "cannot tell": found.message.partition("cannot tell ")[2],
    }


def payloads(rows: list[dict]) -> Iterator[str]:
    """Yield the table of payloads."""
    loaded, bare = (
        [row for row in rows if (row["mass"] > 0) is full and "failed" not in row] for full in (True, False)
    )
    yield (
        f"`equipoise payload --log`: payloads of {PAYLOADS[0]} to {PAYLOADS[1]} kg at random places on a simulated A1 "
        "(`realistic`), 20 s of trot (60 s for each tenth seed). *Prior run*: the bare robot, two minutes, weighed. Targets: "
        "mass 5 %, place 5 mm, coverage 90 %, 5 s. Bold: missed. *Bare walk*: 20 s of the bare robot, in another phase. "
        "*Determined*: coordinates within 10 mm, half width of the 95 % interval; the answer names "
        "the others. Errors of mass and place are of answers with a place."
    )
    yield ""
    yield (
        "| reference | n | with a place | mass [%] | place x, y, z [mm] | coverage | determined, rms [mm] | false alarms | "
        "CPU of 20, 60 s [s] |"
    )
    yield "|" + "---|" * 9
    for way in loaded[0]["ways"] if loaded else ():
        all_found = [(row, row["ways"][way]) for row in loaded]
        found = [(row, one) for row, one in all_found if one["value"][1] is not None]
        alarms = sum(row["ways"][way]["answer"] in ("added", "removed", "moved") for row in bare)
        if not found:
            yield f"| {way} | {len(loaded)} | 0 | - | - | - | - | {alarms} of {len(bare)} | - |"
            continue
        true = np.array([[row["mass"], *row["place"]] for row, _ in found])
        error = np.array([one["value"] for _, one in found]) - true
        sd = np.array([one["sd"] for _, one in found])
        narrow = NORMAL_95 * sd[:, 1:] <= 10e-3
        cpu = {
            seconds: np.mean([row["ways"][way]["cpu"] for row in (*loaded, *bare) if row["seconds"] == seconds])
            for seconds in (20, 60)
        }
        share = f"{narrow.mean():.0%}, {1e3 * rms(error[:, 1:][narrow]):.1f}" if narrow.any() else "0%, -"
        covered = float(np.mean(np.abs(error) <= NORMAL_95 * sd))
        yield (
            f"| {way} | {len(loaded)} | {len(found)} | {missed(100 * rms(error[:, 0] / true[:, 0]), MASS_TARGET, '.1f')} | "
            f"{' '.join(missed(1e3 * value, PLACE_TARGET, '.0f') for value in rms(error[:, 1:]))} | "
            f"{'**' * (covered < COVERAGE_TARGET)}{covered:.0%}{'**' * (covered < COVERAGE_TARGET)} | {share} | "
            f"{alarms} of {len(bare)} | {', '.join(missed(cpu[each], CPU_TARGET, '.1f') for each in (20, 60))} |"
        )


def missed(value: float, most: float | None, form: str) -> str:
    """Return a number, in bold if it exceeds its target."""
    return f"**{value:{form}}**" if most is not None and value > most else f"{value:{form}}"


def numbers(result: object, truth: InertialParameters) -> dict[str, object]:
    """Return the row of one estimate."""
    true, whole = components(truth), result.composite
    return {
        "error": (whole.values - true).tolist(),
        "sd": whole.stds.tolist(),
        "inside": [bool(one.lower <= value <= one.upper) for one, value in zip(whole, true, strict=True)],
        "model": (np.array([one.model for one in whole]) - true).tolist(),
        "size": true[4:7].tolist(),
        "checks": [check.name for check in result.checks if not check.passed],
    }


def lines(rows: list[dict]) -> Iterator[str]:
    """The page."""
    yield "# Estimates from logs of walking robots"
    yield ""
    yield (
        "`make bench-walking`: a trot with varying speed, sidesteps and turns, logged as a table; a scale with an error of "
        "0.5 %. Root mean square errors of the whole robot; *file*: the model file without the payload. Targets: CoM x, y, z "
        "3, 3, 8 mm (`realistic`), 5, 5, 12 mm (`stress`), 2 mm in the plane in 60 s, coverage 90 %. Bold: target missed. "
        "PyBullet and DART lack springs, backlash and soft feet; MuJoCo has all effects. Seeds were not used in development."
    )
    yield ""
    yield from table(rows, "trot")
    yield ""
    yield (
        "Robots that crawl, one foot after the other; estimates use joint torques with gain errors of 3 to 5 %. Height and "
        "inertia are not identifiable and reported as such. The failed checks report missing lifts and stance motions."
    )
    yield ""
    yield from table(rows, "crawl")
    finished = [row for row in rows if "error" in row]
    if weighed := [row for row in rows if row["case"] == "payload"]:
        yield ""
        yield from payloads(weighed)
    both = [row for row in finished if "lifts" in row]
    if both:
        yield ""
        yield from agreement(both)
    yield ""
    for row in rows:
        if "failed" in row:
            yield f"- {row['key']}: {row['failed']}"


def table(rows: list[dict], gait: str) -> Iterator[str]:
    """Yield the table of a gait."""
    yield (
        f"| engine | preset | robot | {gait} [s] | n | CoM x, y, z [mm] | file | Ixx, Iyy, Izz [%] | coverage | "
        "failed checks | silent | CPU [s] |"
    )
    yield "|" + "---|" * 12
    finished: list[dict] = []
    for case in CASES:
        of = [row for row in rows if row["case"] == case.key and "error" in row and case.gait == gait]
        finished += of
        if of:
            yield accuracy(case, of)
    if finished:
        held = np.mean([one for row in finished for one in row["inside"]])
        yield ""
        yield f"Coverage of all {10 * len(finished)} intervals: {held:.0%}."


def accuracy(case: Case, rows: list[dict]) -> str:
    """Return a row of the first table."""
    error, model = np.array([row["error"] for row in rows]), np.array([row["model"] for row in rows])
    com, file = 1e3 * rms(error[:, 1:4]), 1e3 * rms(model[:, 1:4])
    inertia = 100 * rms(error[:, 4:7] / np.array([row["size"] for row in rows]))
    none = (None, None, None)
    targets = TARGETS.get((case.noise, case.duration), none) if case.gait == "trot" else none
    cells = [missed(value, most, ".1f") for value, most in zip(com, targets, strict=True)]
    held = np.mean([one for row in rows for one in row["inside"]])
    failed = sum(bool(row["checks"]) for row in rows)
    silent = sum(not row["checks"] and np.abs(np.array(row["error"]) / np.array(row["sd"])).max() > 4 for row in rows)
    return (
        f"| {case.engine} | {case.noise} | {case.robot} | {case.duration} | {len(rows)} | {' '.join(cells)} | "
        f"{' '.join(f'{value:.1f}' for value in file)} | {' '.join(f'{value:.0f}' for value in inertia)} | "
        f"{'**' if held < 0.9 else ''}{held:.0%}{'**' if held < 0.9 else ''} | {failed} | {silent} | "
        f"{np.mean([row['cpu'] for row in rows]):.1f} |"
    )


def agreement(rows: list[dict]) -> Iterator[str]:
    """Yield the comparison of lifts and trot of the same robots."""
    apart = np.array([np.array(row["error"]) - np.array(row["lifts"]["error"]) for row in rows])
    both = np.hypot(np.array([row["sd"] for row in rows]), np.array([row["lifts"]["sd"] for row in rows]))
    inside = np.abs(apart) <= NORMAL_95 * both
    yield (
        f"Lifts and trot of the same {len(rows)} robots in MuJoCo ({BUDGET:.0f} s of calibration): {inside.mean():.0%} of the "
        "differences are within the combined intervals. Rms of the difference over the combined standard deviation, and "
        "the largest:"
    )
    yield ""
    yield f"| | {' | '.join(COMPONENTS)} |"
    yield "|" + "---|" * (1 + len(COMPONENTS))
    yield f"| rms | {' | '.join(f'{value:.2f}' for value in rms(apart / both))} |"
    yield f"| largest | {' | '.join(f'{value:.2f}' for value in np.abs(apart / both).max(axis=0))} |"


def rms(values: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(values**2, axis=0))


def keep(rows: list[dict], path: Path, row: dict) -> None:
    """Add a row to the rows and to their file, and print its failure or its errors of the CoM [mm]."""
    rows.append(row)
    with path.open("a", encoding="utf-8") as stream:
        stream.write(json.dumps(row) + "\n")
    shown = np.round(1e3 * np.array(row["error"][1:4]), 1) if "error" in row else ""
    print(row["key"], row.get("failed") or shown, flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=1000, help="largest number of seeds per case")
    arguments = parser.parse_args()
    rows = [json.loads(line) for line in ROWS.read_text(encoding="utf-8").splitlines()] if ROWS.exists() else []
    done = {row["key"] for row in rows}
    for number in range(min(arguments.seeds, LOADED + BARE)):
        if f"payload/{FIRST_PAYLOAD + number}" not in done:
            keep(rows, ROWS, measure(FIRST_PAYLOAD + number))
    for number in range(min(arguments.seeds, max(case.seeds for case in CASES))):
        for case in CASES:
            seed = FIRST_SEED + number
            if number >= case.seeds or f"{case.key}/{seed}" in done:
                continue
            keep(rows, ROWS, run(case, seed))
    write_page("walking.md", "\n".join(lines(rows)) + "\n", rows)


if __name__ == "__main__":
    main()
