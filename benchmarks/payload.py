"""Accuracy of a payload from the difference of two calibrations: `make bench-payload`. Writes benchmarks/results/payload.md.

A simulated robot with typical sensors is calibrated without and with 1 kg ten centimetres above, next to, ahead of or behind
the base's origin (scaled to other robots), with the same sensor errors and other noise. The scale, if any, has an error of
0.5 % (rms) in both calibrations and a resolution of 10 g. An interrupted benchmark resumes from payload.jsonl.
"""

from __future__ import annotations

import json
import os
import warnings
from pathlib import Path

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import numpy as np
from provenance import commit, write_page

from equipoise import (
    Payload,
    Recording,
    ScaleReadings,
    calibrate,
    find_payload_change,
    load_robot,
    nominal_stance,
    simulate,
)
from equipoise.errors import ModelWarning
from equipoise.result.statistics import NORMAL_95
from equipoise.robot.inertial import InertialParameters, RobotInertia
from equipoise.robot.model import RobotModel

RESULTS = Path(__file__).parent / "results"
ROWS = RESULTS / "payload.jsonl"
SEEDS = {"unitree_a1": 20, "go2": 8, "anymal_c": 4}
FIRST = 10_000  # seeds below are for development
SCALE_ERROR, SCALE_STEP = 5e-3, 0.01  # [kg]
WAYS = ("no scale", "scale")


def calibrated(robot: RobotModel, payload: Payload | None, seed: int) -> tuple[list[Recording], RobotInertia]:
    """Run one calibration; return recordings and truth. Bare and loaded runs have equal errors and different noise."""
    recordings: list[Recording] = []
    with simulate(robot, "realistic", payload, seed, noise_seed=2 * seed + (payload is None)) as simulation:
        calibrate(simulation.platform, robot, keep=recordings.append)
        return recordings, simulation.truth


def run(name: str, seed: int) -> list[dict[str, object]]:
    """Return a row with and one without the scale."""
    robot = load_robot(name)
    a1 = load_robot("unitree_a1")
    generator = np.random.default_rng([seed, 77])
    size = nominal_stance(robot).hip_height / nominal_stance(a1).hip_height
    direction = ([1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1])[seed % 5]
    place = 0.1 * size * np.array(direction, dtype=float)
    payload = Payload(InertialParameters(robot.mass / a1.mass, place, np.zeros((3, 3))))
    (before, bare), (after, loaded) = (calibrated(robot, load, seed) for load in (None, payload))
    factor = 1 + SCALE_ERROR * generator.standard_normal()
    read = tuple(round(factor * truth.composite.mass / SCALE_STEP) * SCALE_STEP for truth in (bare, loaded))
    rows: list[dict[str, object]] = []
    for way, scale in zip(WAYS, (None, ScaleReadings(read)), strict=True):
        found = find_payload_change(robot, before, after, scale).with_truth(bare, loaded)
        error, sd = ([getattr(one, name) for one in found.payload] for name in ("error", "std"))
        truth = found.payload.mass.truth
        rows.append(
            {"robot": name, "seed": seed, "way": way, "mass": truth, "error": error, "sd": sd, "commit": commit()}
        )
    print(name, seed, flush=True)
    return rows


def lines(rows: list[dict[str, object]]) -> list[str]:
    """The table."""
    text = [
        "# Payload from the difference of two calibrations",
        "",
        "`make bench-payload`; `--sim-preset realistic`, 1 kg on an A1 at 10 cm from the base's origin, in proportion "
        "on others.",
        "Root mean square and largest errors of the payload's mass and CoM. Coverage: share of 95 % intervals with the truth.",
        "",
        "| robot | pairs | | mass [%] | largest | x, y [mm] | largest | z [mm] | largest | coverage |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name in SEEDS:
        for way in WAYS:
            of = [row for row in rows if (row["robot"], row["way"]) == (name, way) and row["error"][1] is not None]
            if not of:
                continue
            error = np.array([row["error"] for row in of], dtype=float)
            inside = np.abs(error) <= NORMAL_95 * np.array([row["sd"] for row in of], dtype=float)
            mass = 100 * error[:, 0] / np.array([row["mass"] for row in of])
            place = 1e3 * error[:, 1:4]

            def rms_and_max(values: np.ndarray, form: str) -> str:
                return f"{format(np.sqrt(np.mean(values**2)), form)} | {format(np.abs(values).max(), form)}"

            text.append(
                f"| {name} | {len(of)} | {way} | {rms_and_max(mass, '.1f')} | {rms_and_max(place[:, :2], '.1f')} | "
                f"{rms_and_max(place[:, 2], '.1f')} | {inside.mean():.0%} |"
            )
    return text


def main() -> None:
    """Run missing cases and write the page."""
    warnings.simplefilter("ignore", ModelWarning)
    rows = [json.loads(line) for line in ROWS.read_text().splitlines()] if ROWS.exists() else []
    done = {(row["robot"], row["seed"]) for row in rows}
    for name, count in SEEDS.items():
        for seed in range(FIRST, FIRST + count):
            if (name, seed) in done:
                continue
            new = run(name, seed)
            rows += new
            with ROWS.open("a", encoding="utf-8") as file:
                file.writelines(json.dumps(row) + "\n" for row in new)
            write_page("payload.md", "\n".join(lines(rows)) + "\n", rows)
    print("\n".join(lines(rows)))


if __name__ == "__main__":
    main()
