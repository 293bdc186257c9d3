"""Payload measurement in half a minute with a prior run: `make bench-weigh`. Writes benchmarks/results/weigh.md.

A simulated robot with typical sensors, narrow leg priors and no cable is calibrated bare in two minutes. Then it carries 1 kg
ten centimetres above, next to, ahead of or behind the base's origin (scaled to other robots), with the same sensor errors and
other noise. The payload is measured with the prior run in 30 s and in 45 s, and in 30 s after a restart: joint offsets and the
accelerometer's bias change as much as the priors allow, and one joint offset by 5 mrad. One scale with an error of 0.5 % (rms)
and a resolution of 10 g weighs both runs; the same recordings are also estimated without it. An interrupted benchmark resumes
from weigh.jsonl and runs/.
"""

from __future__ import annotations

import json
import os
import time
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import numpy as np
from provenance import commit, write_page

from equipoise import (
    BayesianMethod,
    Calibration,
    Payload,
    Recording,
    RobotModel,
    calibrate,
    estimate,
    load_robot,
    nominal_stance,
    simulate,
)  # fmt: skip
from equipoise.calibration.payload_measurement import measure_payload
from equipoise.errors import EquipoiseError, ModelWarning
from equipoise.estimator.prior_runs.prior_run import PriorRun
from equipoise.json_form import from_json, to_json
from equipoise.robot.inertial import InertialParameters, RobotInertia

RESULTS = Path(__file__).parent / "results"
ROWS = RESULTS / "weigh.jsonl"
FIRST_RUNS = Path("runs") / "bench-weigh"
ROBOTS = ("unitree_a1", "go2")
SEEDS = range(10_000, 10_020)  # below are for development
SCALE_ERROR, SCALE_STEP = 5e-3, 0.01  # [kg]
MOVED = 5e-3  # [rad]
# Changes between two runs in the table of priors.
ZEROS_CHANGE, BIAS_CHANGE = 0.5e-3, 6e-3  # [rad], [m/s2]
CASES = (("30 s", 30.0, False), ("45 s", 45.0, False), ("30 s, switched off", 30.0, True))
# rms of CoM x, y, z [mm]; payload's mass without and with the scale [%]; its CoM x, y, z [mm].
TARGETS = {"30 s": (0.25, 0.25, None, 8, 1, 3, 3, None), "45 s": (0.22, 0.18, 0.65, 8, 1, 3, 3, 10)}


def first_run(name: str, seed: int) -> tuple[PriorRun, RobotInertia, float]:
    """Return the run folder of the bare robot, its truth, and the scale's factor."""
    file = FIRST_RUNS / f"first-{name}-{seed}.json"
    if not file.exists():
        factor = 1 + SCALE_ERROR * float(np.random.default_rng([seed, 77]).standard_normal())
        robot = load_robot(name)
        with simulate(robot, "realistic", None, seed, noise_seed=2 * seed + 1) as simulation:
            method = BayesianMethod(leg_prior="narrow", cable="none", mass=read(factor, simulation.truth))
            result, truth = calibrate(simulation.platform, robot, method), to_json(simulation.truth)
        kept = {"known": result.evidence.keepsake(result.settings), "truth": truth, "factor": factor}
        FIRST_RUNS.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(kept), encoding="utf-8")
    table = json.loads(file.read_text(encoding="utf-8"))
    return replace(PriorRun(**table["known"]), run=""), from_json(RobotInertia, table["truth"]), table["factor"]


def read(factor: float, truth: RobotInertia) -> float:
    """Return the reading of the scale [kg]."""
    return round(factor * truth.composite.mass / SCALE_STEP) * SCALE_STEP


def payload_of(robot: RobotModel, seed: int) -> Payload:
    """Return a payload of 1 kg on an A1, ten centimetres from the base's origin."""
    a1 = load_robot("unitree_a1")
    size = nominal_stance(robot).hip_height / nominal_stance(a1).hip_height
    direction = ([1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1])[seed % 5]
    place = 0.1 * size * np.array(direction, dtype=float)
    return Payload(InertialParameters(robot.mass / a1.mass, place, np.zeros((3, 3))))


def switch_off(drawn: Mapping[str, np.ndarray], seed: int, joint: int) -> None:
    """Change the sensor errors as after a restart, and one joint offset by more than that."""
    generator = np.random.default_rng([seed, 78])
    drawn["accelerometer_bias"][:] += BIAS_CHANGE * generator.standard_normal(3)
    drawn["joint_offset"][:] += ZEROS_CHANGE * generator.standard_normal(len(drawn["joint_offset"]))
    drawn["joint_offset"][joint] += MOVED if seed % 2 else -MOVED


def second_run(name: str, seed: int, case: tuple[str, float, bool]) -> dict[str, object]:
    """A row."""
    what, budget, switched = case
    robot, (known, bare, factor) = load_robot(name), first_run(name, seed)
    joint = seed % len(robot.joint_names) if switched else None
    recordings: list[Recording] = []
    row: dict[str, object] = {"commit": commit(), "robot": name, "seed": seed, "case": what}
    row["moved"] = None if joint is None else robot.joint_names[joint]
    with simulate(robot, "realistic", payload_of(robot, seed), seed, noise_seed=2 * seed) as simulation:
        truth = simulation.truth
        if joint is not None:
            switch_off(simulation.errors.drawn, seed, joint)
        method = BayesianMethod(prior_run=known, cable="none", duration=budget, mass=read(factor, truth))
        started = time.process_time()
        try:
            result = calibrate(simulation.platform, robot, method, keep=recordings.append)
            alone = estimate(robot, recordings, replace(method, mass=None))
        except EquipoiseError as error:
            return {**row, "failed": str(error)}
    row["cpu"] = time.process_time() - started
    row["robot_time"] = sum(recording.duration for recording in recordings)
    row["checks"] = [check.name for check in result.checks if not check.passed]
    row["named"] = [change.each for change in result.evidence.changes]
    row["amounts"] = [change.value for change in result.evidence.changes]
    row |= numbers("", robot, known, result, bare, truth)
    return row | numbers("no scale ", robot, known, alone, bare, truth)


def numbers(
    way: str, robot: RobotModel, known: PriorRun, result: Calibration, bare: RobotInertia, truth: RobotInertia
) -> dict[str, object]:
    """Return errors and standard deviations of the robot's ten parameters, and of the payload's mass and CoM."""
    whole = result.with_truth(truth).composite
    change = measure_payload(robot, known, result).change.with_truth(bare, truth)
    found = [*change.payload][:4]
    return {
        f"{way}error": whole.errors.tolist(),
        f"{way}sd": whole.stds.tolist(),
        f"{way}payload": change.payload.mass.truth,
        f"{way}payload error": [one.error for one in found],
        f"{way}payload sd": [one.std for one in found],
    }


def lines(rows: list[dict[str, object]]) -> Iterator[str]:
    """The page."""
    yield "# Payload measurement in half a minute"
    yield ""
    yield (
        "`make bench-weigh`; `--sim-preset realistic`, seeds from 10,000, first run of 120 s with `--leg-prior narrow "
        "--cable none` "
        "and a scale. Root mean square errors of the whole robot's CoM, and of a payload of 1 kg on an A1 or a scaled one on "
        "a Go2. The second run has the sensor errors and floor of the first. After a restart, joint offsets change by "
        f"{1e3 * ZEROS_CHANGE:g} mrad (rms), the accelerometer's bias by {1e3 * BIAS_CHANGE:g} mm/s2, and one "
        f"joint offset by {1e3 * MOVED:g} mrad. Bold: target missed."
    )
    yield ""
    yield (
        "| robot | duration | runs | robot time [s] | CoM x, y, z [mm] | payload's mass, no scale [%] | same scale [%] | "
        "payload's CoM x, y, z [mm] | coverage |"
    )
    yield "|" + "---|" * 9
    for case, targets in TARGETS.items():
        shown = [("-" if target is None else f"{target:g}") for target in targets]
        yield f"| target | {case} | | | {' '.join(shown[:3])} | {shown[3]} | {shown[4]} | {' '.join(shown[5:])} | 90 % |"
        for name in ROBOTS:
            if of := [row for row in rows if (row["robot"], row["case"]) == (name, case) and "error" in row]:
                yield accuracy(name, case, of, targets)
    yield ""
    yield from changes(rows)
    failed = [row for row in rows if "failed" in row]
    for row in failed:
        yield f"- {row['robot']} {row['seed']}, {row['case']}: {row['failed']}"


def accuracy(name: str, case: str, rows: list[dict[str, object]], targets: tuple[float | None, ...]) -> str:
    """Return a row of the first table."""
    com = 1e3 * stacked(rows, "error")[:, 1:4]
    mass = [100 * stacked(rows, f"{way}payload error")[:, 0] / stacked(rows, "payload") for way in ("no scale ", "")]
    place = 1e3 * places(rows)
    values = [*rms(com), *(float(rms(one)) for one in mass), *rms(place)]
    cells = [
        f"**{value:.2f}**" if target is not None and value > target else f"{value:.2f}"
        for value, target in zip(values, targets, strict=True)
    ]
    held = float(np.mean(np.concatenate([holding(row) for row in rows])))
    duration = stacked(rows, "robot_time")
    return (
        f"| {name} | {case} | {len(rows)} | {duration.mean():.1f}, at most {duration.max():.1f} | {' '.join(cells[:3])} | "
        f"{cells[3]} | {cells[4]} | {' '.join(cells[5:])} | {held:.0%} |"
    )


def holding(row: dict[str, object]) -> list[bool]:
    """Return coverage flags of ten parameters of the robot and four of the payload, with and without the scale."""
    pairs = [
        pair
        for way in ("", "no scale ")
        for what in ("", "payload ")
        for pair in zip(row[f"{way}{what}error"], row[f"{way}{what}sd"], strict=True)
    ]
    return [abs(error) <= 1.96 * sd for error, sd in pairs if error is not None]


def changes(rows: list[dict[str, object]]) -> Iterator[str]:
    """The second table."""
    yield (
        "| robot | restart: only the changed offset reported | among reported changes | CoM x, y [mm] | "
        "payload's CoM x, y [mm] | coverage | no restart: any change reported | failed checks |"
    )
    yield "|" + "---|" * 8
    for name in ROBOTS:
        of = [row for row in rows if row["robot"] == name and "error" in row]
        moved = [row for row in of if row["moved"] is not None]
        same = [row for row in of if row["moved"] is None]
        if moved:
            alone = sum(row["named"] == [row["moved"]] for row in moved)
            among = sum(row["moved"] in row["named"] for row in moved)
            false, failed = sum(bool(row["named"]) for row in same), sum(bool(row["checks"]) for row in of)
            com, place = (
                " ".join(f"{1e3 * value:.2f}" for value in rms(errors[:, :2]))
                for errors in (stacked(moved, "error")[:, 1:], places(moved))
            )
            held = float(np.mean(np.concatenate([holding(row) for row in moved])))
            yield (
                f"| {name} | {alone} of {len(moved)} | {among} of {len(moved)} | {com} | {place} | {held:.0%} | "
                f"{false} of {len(same)} | {failed} of {len(of)} |"
            )
    yield ""


def stacked(rows: list[dict[str, object]], name: str) -> np.ndarray:
    """Return the (n, ...) numbers of all rows."""
    return np.array([row[name] for row in rows], dtype=float)


def places(rows: list[dict[str, object]]) -> np.ndarray:
    """Return the (n, 3) errors of the payload's CoM, of rows with an estimate [m]."""
    return stacked([row for row in rows if row["payload error"][1] is not None], "payload error")[:, 1:]


def rms(errors: np.ndarray) -> np.ndarray:
    """Return the root mean square over runs."""
    return np.sqrt(np.mean(errors**2, axis=0))


def main() -> None:
    """Run missing cases, ordered by seed, and write the page."""
    warnings.simplefilter("ignore", ModelWarning)
    rows = [json.loads(line) for line in ROWS.read_text(encoding="utf-8").splitlines()] if ROWS.exists() else []
    done = {(row["robot"], row["seed"], row["case"]) for row in rows}
    for seed in SEEDS:
        for name in ROBOTS:
            for case in CASES:
                if (name, seed, case[0]) in done:
                    continue
                rows.append(second_run(name, seed, case))
                print(name, seed, case[0], flush=True)
                with ROWS.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(rows[-1]) + "\n")
        write_page("weigh.md", "\n".join(lines(rows)) + "\n", rows)


if __name__ == "__main__":
    main()
