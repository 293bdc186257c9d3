"""Accuracy of calibrations and coverage of their intervals: `make bench-accuracy`.

Simulated robots with random payloads and the presets `stress` and `realistic` are calibrated with the Bayesian method: with
and without a scale, a cable and wide leg priors, all from the same recordings, and rotated by 180 degrees halfway
(`--rotate-halfway`). In `realistic` also with the methods `paper` and `static`. Every run appends a row to
benchmarks/results/accuracy.jsonl, so that an interrupted benchmark can be resumed. benchmarks/results/accuracy.md is written
from the rows. Everything is seeded; nothing was tuned on these seeds.

    python benchmarks/accuracy.py             # missing runs, then tables
    python benchmarks/accuracy.py --part 0.1  # a tenth of the runs
    python benchmarks/accuracy.py --tables    # tables only
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import warnings
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):  # one core per run
    os.environ.setdefault(_name, "1")

import numpy as np
from provenance import commit, write_page
from scipy.stats import binom

import equipoise
from equipoise import (
    BayesianMethod,
    EffectSizes,
    Method,
    calibrate,
    estimate,
    load_robot,
    nominal_stance,
    simulate,
)
from equipoise.errors import EquipoiseError
from equipoise.method.table import method_named
from equipoise.robot.inertial import COMPONENTS, components
from equipoise.robot.scale import Scale
from equipoise.simulation.effects import REALISTIC, STRESS

RESULTS = Path(__file__).parent / "results"
ROWS = RESULTS / "accuracy.jsonl"
COUNTS = {"unitree_a1": 200, "go2": 50, "anymal_c": 50, "solo12": 50, "b1": 50}
FIRST_SEED = 10_000
WORLDS = {"stress": STRESS, "realistic": REALISTIC}
NAIVE = ("bayesian60", "paper", "static")  # runs of an A1 in `realistic`
NAIVE_SEEDS = 50
TURNED_SEEDS = 50  # of an A1 in `stress`, rotated by 180 degrees halfway
SOURCE_SEEDS = 3  # of each error source alone
SCALE = 0.005  # a scale's error, as a fraction
A1_LEG = 0.4  # [m]
LEAST = 0.90  # least coverage

Row = dict[str, Any]

# Single error sources; those that interact are combined.
SOURCES = {
    "joint offsets 5 mrad": ("joint_offset",),
    "IMU tilt 5 mrad": ("imu_tilt",),
    "accelerometer bias": ("accelerometer_bias",),
    "gyroscope bias": ("gyro_bias",),
    "encoder noise": ("encoder_noise", "joint_velocity_noise"),
    "IMU noise": ("gyro_noise", "accelerometer_noise"),
    "leg masses 3 %": ("leg_mass",),
    "joint friction, armature": ("coulomb_friction", "viscous_friction", "armature"),
    "torque gains 3 %, torque noise": ("torque_gain", "torque_noise"),
    "delays 2 ms, clock 0.5 ms": ("command_delay", "sensor_delay", "imu_clock_offset"),
    "floor slope 5 mrad": ("floor_slope",),
    "none": (),
}


@dataclass(frozen=True)
class Case:
    """Run: robot, seed (of payload, sensors and scale), method, and preset or single error source."""

    robot: str
    seed: int
    method: str
    source: str

    @property
    def key(self) -> str:
        return "/".join((self.robot, self.source, self.method, str(self.seed)))


def cases() -> list[Case]:
    """Return all cases, with those of all parts mixed evenly."""
    counts = {(robot, "bayesian", world): count for world in WORLDS for robot, count in COUNTS.items()}
    counts |= {("unitree_a1", method, "realistic"): NAIVE_SEEDS for method in NAIVE}
    counts["unitree_a1", "turned", "stress"] = TURNED_SEEDS
    parts = [
        (seed / count, Case(robot, FIRST_SEED + seed, method, world))
        for (robot, method, world), count in counts.items()
        for seed in range(count)
    ]
    sources = [
        Case("unitree_a1", FIRST_SEED + seed, method, source)
        for seed in range(SOURCE_SEEDS)
        for source in SOURCES
        for method in ("bayesian", "paper")
    ]
    return [*(case for _, case in sorted(parts, key=lambda part: part[0])), *sources]


def errors_of(case: Case, scale: Scale) -> EffectSizes:
    if case.source in WORLDS:
        return WORLDS[case.source].scaled_to(scale)
    sizes = REALISTIC.scaled_to(scale)
    kept = {*SOURCES[case.source], "floor_friction"}
    blank = {f.name: 0.0 for f in dataclasses.fields(sizes) if f.name not in kept}
    return dataclasses.replace(sizes, **blank)


def payload_of(robot: equipoise.RobotModel, generator: np.random.Generator) -> str:
    """Draw a payload of 5 to 30 % of the base's mass with random position on the back and random size."""
    size = nominal_stance(robot).scale.length
    mass = generator.uniform(0.05, 0.30) * float(robot.pinocchio.inertias[1].mass)
    at = size * np.array(
        [generator.uniform(-0.12, 0.12), generator.uniform(-0.05, 0.05), generator.uniform(0.03, 0.12)]
    )
    inertia = mass * (size * np.array([0.08, 0.12, 0.10])) ** 2
    return ",".join(f"{value:.6g}" for value in (mass, *at, *inertia))


def settings_of(case: Case, true_mass: float, generator: np.random.Generator) -> Method:
    weighed = true_mass * (1 + SCALE * generator.standard_normal())
    if case.method == "bayesian60":
        return BayesianMethod(duration=60.0, mass=weighed, mass_std=SCALE * weighed)
    if case.method == "turned":
        return BayesianMethod(rotate_halfway=True, mass=weighed, mass_std=SCALE * weighed)
    return method_named(case.method)().weighed(weighed, SCALE * weighed)


@cache
def robot_called(name: str) -> equipoise.RobotModel:
    return load_robot(name)


def told_otherwise(settings: BayesianMethod) -> dict[str, BayesianMethod]:
    """Return further settings to estimate the recordings with, by label."""
    known = dataclasses.replace(settings, cable="none")
    return {
        "no scale": dataclasses.replace(settings, mass=None, mass_std=None),
        "no cable": known,
        "no cable, legs trusted": dataclasses.replace(known, leg_prior="narrow"),
    }


def run(case: Case) -> Row:
    """One row."""
    warnings.simplefilter("ignore")
    robot = robot_called(case.robot)
    stance = nominal_stance(robot)
    generator = np.random.default_rng([case.seed, 77])
    payload = payload_of(robot, generator)
    row: Row = {"key": case.key, **dataclasses.asdict(case), "payload": payload, "commit": commit()}
    row["leg_length"] = robot.leg_length
    recordings: list[equipoise.Recording] = []
    try:
        with simulate(robot, errors_of(case, stance.scale), payload, case.seed) as simulation:
            truth = simulation.truth
            settings = settings_of(case, truth.composite.mass, generator)
            result = calibrate(simulation.platform, robot, settings, recordings.append).with_truth(truth)
    except EquipoiseError as error:
        return {**row, "failed": f"{type(error).__name__}: {error}"}
    true = components(truth.composite)
    row["truth"] = true.tolist()
    row["file_error"] = [quantity.model - quantity.truth for quantity in result.composite]
    row["robot_time"] = sum(trial.duration for trial in result.trials)
    row["estimation_s"] = sum(result.timings.values())
    if isinstance(settings, BayesianMethod):
        row |= judged(result)
        if case.source in WORLDS and case.method == "bayesian":
            row["otherwise"] = {
                name: judged(estimate(robot, recordings, other).with_truth(truth))
                for name, other in told_otherwise(settings).items()
            }
        return row
    error = [None if quantity.value is None else quantity.error for quantity in result.composite]
    for index, axis in enumerate(("roll", "pitch", "yaw")):
        moment = result.excitations[axis].moment if axis in result.excitations else None
        error[4 + index] = None if moment is None else float(moment - true[4 + index])
    row["error"] = error
    return row


def judged(result: equipoise.Calibration) -> Row:
    """Return errors, standard deviations, coverage of printed intervals, and failed checks."""
    body = list(result.composite)
    return {
        "error": [quantity.error for quantity in body],
        "sd": [quantity.std for quantity in body],
        "holds": [not quantity.missed for quantity in body],
        "alarms": [check.name for check in result.checks if not check.passed],
    }


def rounded(value: object) -> object:
    """Round floats to six digits, because rows are stored in the repository."""
    if isinstance(value, float):
        return float(f"{value:.6g}")
    if isinstance(value, dict):
        return {key: rounded(item) for key, item in value.items()}
    return [rounded(item) for item in value] if isinstance(value, list) else value


def load_rows(path: Path) -> dict[str, Row]:
    """Return the latest row of each key."""
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    return {row["key"]: row for row in map(json.loads, text.splitlines())}


def relative(row: Row, error: list[float | None]) -> np.ndarray:
    """Return errors in %, mm, % of each moment, % of Ixx; nan if missing."""
    true = np.array(row["truth"])
    unit = np.concatenate([[100 / true[0]], [1000.0] * 3, 100 / true[4:7], [100 / true[4]] * 3])
    return np.array([np.nan if value is None else value for value in error], dtype=float) * unit


def rms(values: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(np.square(values), axis=0))


TARGETS = {  # of an A1: mass %, CoM mm, moments %; CoM targets scale with leg length
    ("stress", "bayesian"): (0.75, 0.6, 2.0, 5, 3, 4),
    ("stress", "turned"): (0.5, 0.4, 2.0, 5, 3, 4),
    ("realistic", "bayesian, no cable"): (0.30, 0.25, 1.5, 3, 2, 2),
    ("realistic", "bayesian, no cable, legs trusted"): (0.22, 0.20, 0.45, 1.2, 0.8, 1.2),
}


def lines_of(rows: Iterable[Row]) -> Iterable[tuple[str, str, str, int, list[Row], list[Row]]]:
    """Yield robot, preset, label, planned runs, rows and cells of each table line."""
    rows = list(rows)
    for robot, meant in COUNTS.items():
        for world in WORLDS:
            of = [row for row in rows if (row["robot"], row["source"]) == (robot, world)]
            bayesian = [row for row in of if row["method"] == "bayesian"]
            good = [row for row in bayesian if "failed" not in row]
            if good:
                yield robot, world, "bayesian", meant, good, good
                for name in good[0]["otherwise"]:
                    yield robot, world, f"bayesian, {name}", meant, good, [row["otherwise"][name] for row in good]
                yield robot, world, "model file", meant, good, [{"error": row["file_error"]} for row in good]
            for method in ("turned", *NAIVE):
                good = [row for row in of if row["method"] == method and "failed" not in row]
                if good:
                    yield robot, world, method, TURNED_SEEDS if method == "turned" else NAIVE_SEEDS, good, good


def accuracy_table(rows: Iterable[Row]) -> list[str]:
    lines = [
        "| robot | preset | method | n | mass % | CoM x | y | z mm | Ixx | Iyy | Izz % | Ixy | Ixz | Iyz % of Ixx | time |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for robot, world, label, meant, good, finished in lines_of(rows):
        found = rms(np.array([relative(row, part["error"]) for row, part in zip(good, finished, strict=True)]))
        target = TARGETS.get((world, label))
        limit = np.full(10, np.inf)
        if target:
            limit[1:4] = np.array(target[:3]) * good[0]["leg_length"] / A1_LEG
            limit[4:7] = target[3:]
        cells = [
            "-" if np.isnan(value) else f"**{value:.2f}**" if value > most else f"{value:.2f}"
            for value, most in zip(found, limit, strict=True)
        ]
        seconds = "" if label == "model file" else f"{np.mean([row['robot_time'] for row in good]):.0f} s"
        lines.append(
            f"| {robot} | {world} | {label} | {len(good)} of {meant} | " + " | ".join(cells) + f" | {seconds} |"
        )
        if target:
            cells = ["", *(f"*{value:.2f}*" for value in limit[1:7]), "", "", ""]
            lines.append("| | | *target* | | " + " | ".join(cells) + " | |")
    return lines


def coverage_table(rows: Iterable[Row]) -> list[str]:
    lines = [
        "| robot | preset | | n | " + " | ".join(COMPONENTS) + " | all | runs with a failed check |",
        "|---|---|---|---|" + "---|" * len(COMPONENTS) + "---|---|",
    ]
    for robot, world, label, meant, _, finished in lines_of(rows):
        if "sd" not in finished[0]:
            continue
        holds = np.array([part["holds"] for part in finished])
        least = binom.ppf(0.025, len(finished), LEAST) / len(finished)
        cells = [f"{share:.0%}" if share >= least else f"**{share:.0%}**" for share in holds.mean(axis=0)]
        fired = Counter(name for part in finished for name in part["alarms"])
        names = ", ".join(f"{name} {count}" for name, count in fired.most_common())
        lines.append(
            f"| {robot} | {world} | {label} | {len(finished)} of {meant} | " + " | ".join(cells)
            + f" | {holds.mean():.1%} | {sum(bool(part['alarms']) for part in finished)} {names} |"
        )  # fmt: skip
        ratio = rms(np.array([np.array(part["error"]) / np.array(part["sd"]) for part in finished]))
        lines.append("| | | error / std, rms | | " + " | ".join(f"{value:.2f}" for value in ratio) + " | | |")
    return lines


def source_table(rows: Iterable[Row]) -> list[str]:
    rows = [row for row in rows if row["source"] in SOURCES]
    if not rows:
        return []
    lines = [
        "## Single error sources (A1)",
        "",
        f"RMS over {SOURCE_SEEDS} seeds. Every row includes payloads, contacts, soft legs and the scale's error.",
        "",
        "| error source | method | CoM x | y | z mm | Ixx | Iyy | Izz % | Ixy | Ixz | Iyz % of Ixx |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for source in SOURCES:
        for method in ("bayesian", "paper"):
            good = [r for r in rows if (r["source"], r["method"]) == (source, method) and "failed" not in r]
            if good:
                found = rms(np.array([relative(row, row["error"]) for row in good]))[1:]
                cells = ["-" if np.isnan(value) else f"{value:.2f}" for value in found]
                lines.append(f"| {source} | {method} | " + " | ".join(cells) + " |")
    return [*lines, ""]


ABOUT = """# Accuracy

`make bench-accuracy`; seeds from {first} on, not used in development. RMSE of the whole robot at the nominal stance; random
payloads of 5 to 30 % of the base's mass; mass from a scale with an error of 0.5 % unless stated. Rows with other settings of
the Bayesian method are estimated from the same recordings. *Model file*: errors of the file, without the payload.
Bold: target missed. The paper's I is compared with the whole robot's.
"""


def write_tables() -> str:
    rows = list(load_rows(ROWS).values())
    failed = [f"- {row['key']}: {row['failed']}" for row in rows if "failed" in row]
    seconds = [row["estimation_s"] for row in rows if row["method"] == "bayesian" and "failed" not in row]
    text = "\n".join(
        [
            ABOUT.format(first=FIRST_SEED),
            *accuracy_table(rows),
            "",
            "## Coverage of the 95 % intervals of `bayesian`",
            "",
            f"Share of runs whose printed interval contains the truth; all runs count. Bold: coverage below {LEAST:.0%}.",
            "",
            *coverage_table(rows),
            "",
            *source_table(rows),
            "## Computing",
            "",
            f"Estimation from recordings: median {np.median(seconds):.1f} s on one core, two estimations at once.",
            *(["", "## Failed runs", "", *failed] if failed else []),
            "",
        ]
    )
    write_page("accuracy.md", text, rows)
    return text


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tables", action="store_true", help="write the tables from the existing rows")
    parser.add_argument("--part", type=float, default=1.0, help="fraction of the benchmark, from 0 to 1")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    given = parser.parse_args()
    done = load_rows(ROWS)
    wanted = cases()[: 0 if given.tables else round(given.part * len(cases()))]
    missing = [case for case in wanted if case.key not in done]
    with ProcessPoolExecutor(given.jobs) as pool, ROWS.open("a", encoding="utf-8") as out:
        for count, future in enumerate(as_completed([pool.submit(run, case) for case in missing]), 1):
            row = future.result()
            out.write(json.dumps(rounded(row)) + "\n")
            out.flush()
            print(f"[{count}/{len(missing)}] {row['key']} {row.get('failed', '')}", flush=True)
    print(write_tables())


if __name__ == "__main__":
    main()
