"""Accuracy of motor parameters from swinging legs: `make bench-motors`. Writes benchmarks/results/motors.md.

Simulated robots with typical sensors swing all joints for 10 s and for 30 s on their bellies, or each leg for a quarter of
that on the other three feet. Then in `stress`. Estimates are compared with the simulated motors. An interrupted benchmark
resumes from motors.jsonl. Baselines on the same recordings: `peers/motors.py`.
"""

from __future__ import annotations

import json
import os
import platform
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import mujoco
import numpy as np
from peers import motors as peers
from provenance import commit, write_page

from equipoise import __version__, calibrate, load_robot, simulate
from equipoise.errors import ModelWarning
from equipoise.motors.method import Motors
from equipoise.simulation.effects import Noise

RESULTS = Path(__file__).parent / "results"
ROWS = RESULTS / "motors.jsonl"
FIRST = 10_000  # seeds below are for development
RUNS = {"unitree_a1": 20, "go2": 20, "anymal_c": 8, "solo12": 8, "hyq": 8, "b1": 8}
# Name, label, divisor of errors (None: the truth), and the targets for each duration.
FOUND = (
    ("coulomb_friction", "Coulomb [%]", None, {10: 3.5, 30: 2.0}),
    ("relative_gain", "relative gain [%]", 0.01, {10: 2.0, 30: 1.2}),
    ("armature", "armature [%]", None, {10: 6.0, 30: 3.5}),
    ("viscous_friction", "viscous [%]", None, {10: 13.0, 30: 8.0}),
    ("delay", "delay [ms]", 1e-3, {10: 0.1, 30: 0.1}),
)
HOLD = 90.0  # [%]
GREASE = {"unitree_a1": 12, "go2": 6, "anymal_c": 6}  # runs with Stribeck friction
AT_REST = 0.3  # of Coulomb friction
STRESS = {"unitree_a1": 8, "go2": 8, "anymal_c": 8, "solo12": 8}  # runs in `stress`


def run(name: str, seed: int, duration: int, at_rest: float, world: Noise) -> dict[str, object]:
    """Return errors of all joints in the units of the table, and coverage; at_rest: `AT_REST` or 0."""
    robot = load_robot(name)
    with simulate(robot, world, seed=seed, effects={"stribeck": at_rest} if at_rest else {}) as simulation:
        result = calibrate(simulation.platform, robot, Motors(motor_time=float(duration)))
        result = result.with_truth_of_parts(simulation.truth_of_parts)
    row: dict[str, object] = {"robot": name, "seed": seed, "duration": duration, "world": world, "commit": commit()}
    for quantity, _, unit, _ in FOUND:
        of_joints = [getattr(motor, quantity) for motor in result.motors.values()]
        row[quantity] = [float(one.error / (unit or 0.01 * one.truth)) for one in of_joints]
        row[f"{quantity} holds"] = [not one.missed for one in of_joints]
    if at_rest:
        found = [(one.stribeck_friction, at_rest * one.coulomb_friction.truth) for one in result.motors.values()]
        row["at_rest"] = at_rest
        row["stribeck"] = [100 * (one.value / true - 1) for one, true in found if one.value is not None]
    print(name, seed, duration, world, flush=True)
    return row


def rms(rows: list[dict[str, object]], quantity: str) -> float:
    """Return the rms over all joints and runs."""
    return float(np.sqrt(np.mean(np.square([row[quantity] for row in rows]))))


def page(rows: list[dict[str, Any]], of_peers: list[dict[str, Any]]) -> Iterator[str]:
    """Yield the lines of the page."""
    yield from table(rows)
    yield ""
    yield from with_grease(rows)
    yield ""
    yield from in_stress(rows)
    yield ""
    yield from peers.section(of_peers, {name: label for name, label, *_ in FOUND})
    yield ""
    yield f"equipoise {__version__}, MuJoCo {mujoco.__version__}, Python {platform.python_version()}."


def table(rows: list[dict[str, Any]]) -> Iterator[str]:
    """Yield the lines on equipoise."""
    yield "# Motor parameters without a test stand"
    yield ""
    yield (
        "`make bench-motors`; `--parameters motors --sim-preset realistic`, seeds from 10,000. Root mean square "
        "errors over all joints, "
        "and the share of 95 % intervals that contain the truth. HyQ and B1 cannot lie with free legs, so they stand on three "
        "feet and swing each leg for a quarter of the time. Bold: target missed."
    )
    yield ""
    yield "| robot | runs | swing | " + " | ".join(label for _, label, *_ in FOUND) + " | coverage [%] |"
    yield "|" + "---|" * (len(FOUND) + 4)
    plain = [row for row in rows if row["world"] == "realistic" and "at_rest" not in row]
    for duration in (10, 30):
        goals = " | ".join(f"{targets[duration]:g}" for *_, targets in FOUND)
        yield f"| target | | {duration} s | {goals} | {HOLD:.0f} |"
        for name in RUNS:
            of = [row for row in plain if (row["robot"], row["duration"]) == (name, duration)]
            if of:
                held = 100 * float(np.mean([row[f"{quantity} holds"] for row in of for quantity, *_ in FOUND]))
                cells = [said(rms(of, quantity), targets[duration]) for quantity, _, _, targets in FOUND]
                hold = f"{held:.0f}" if held >= HOLD else f"**{held:.0f}**"
                yield f"| {name} | {len(of)} | {duration} s | " + " | ".join(cells) + f" | {hold} |"


def with_grease(rows: list[dict[str, Any]]) -> Iterator[str]:
    """Yield the lines on Stribeck friction."""
    yield "## Stribeck friction"
    yield ""
    yield (
        f"The same with {AT_REST:.0%} more friction at rest than Coulomb's, which decays as exp -(speed / 0.1 rad/s)^2; the "
        "estimator's law differs. F_s: rms error of the reported values."
    )
    yield ""
    yield "| robot | reported in | " + " | ".join(label for _, label, *_ in FOUND) + " | coverage [%] | F_s [%] |"
    yield "|" + "---|" * (len(FOUND) + 4)
    for name in GREASE:
        of = [row for row in rows if row["robot"] == name and "at_rest" in row]
        if of:
            reported = [row for row in of if row["stribeck"]]
            held = 100 * float(np.mean([row[f"{quantity} holds"] for row in of for quantity, *_ in FOUND]))
            cells = [said(rms(of, quantity), targets[10]) for quantity, _, _, targets in FOUND]
            amount = f"{rms(reported, 'stribeck'):.0f}" if reported else "-"
            yield f"| {name} | {len(reported)} of {len(of)} | " + " | ".join(cells) + f" | {held:.0f} | {amount} |"


def in_stress(rows: list[dict[str, Any]]) -> Iterator[str]:
    """Yield the lines on `stress`."""
    yield "## In `stress`"
    yield ""
    yield (
        "10 s of swinging with all effects, including load-dependent friction, which is not a parameter of the motors' fit. "
        "In brackets the share of intervals that contain the truth."
    )
    yield ""
    yield "| robot | runs | " + " | ".join(label for _, label, *_ in FOUND) + " | coverage [%] |"
    yield "|" + "---|" * (len(FOUND) + 3)
    for name in STRESS:
        of = [row for row in rows if (row["robot"], row["world"]) == (name, "stress")]
        if of:
            held = [100 * float(np.mean([row[f"{quantity} holds"] for row in of])) for quantity, *_ in FOUND]
            found = [f"{rms(of, quantity):{'.2f' if quantity == 'delay' else '.1f'}}" for quantity, *_ in FOUND]
            cells = [f"{one} ({share:.0f} %)" for one, share in zip(found, held, strict=True)]
            yield f"| {name} | {len(of)} | " + " | ".join(cells) + f" | {np.mean(held):.0f} |"


def said(value: float, target: float) -> str:
    """Return a number, bold if it misses its target."""
    text = f"{value:.2f}" if target < 1 else f"{value:.1f}"
    return text if value <= target else f"**{text}**"


def of_known_code(path: Path) -> list[dict[str, Any]]:
    """Return the existing rows with a commit and a world; others are repeated."""
    rows = list(map(json.loads, path.read_text().splitlines())) if path.exists() else []
    kept = [row for row in rows if {"commit", "world"} <= {*row}]
    path.write_text("".join(json.dumps(row) + "\n" for row in kept))
    return kept


def main() -> None:
    warnings.simplefilter("ignore", ModelWarning)
    rows = of_known_code(ROWS)
    done = {(row["robot"], row["seed"], row["duration"], row.get("at_rest", 0.0), row["world"]) for row in rows}
    asked: list[tuple[str, int, int, float, Noise]] = [
        (name, FIRST + i, duration, 0.0, "realistic")
        for i in range(max(RUNS.values())) for duration in (10, 30) for name in RUNS if i < RUNS[name]
    ]  # fmt: skip
    asked += [(name, FIRST + i, 10, AT_REST, "realistic") for name, count in GREASE.items() for i in range(count)]
    asked += [(name, FIRST + i, 10, 0.0, "stress") for name, count in STRESS.items() for i in range(count)]
    for case in asked:
        if case not in done:
            rows.append(run(*case))
            with ROWS.open("a") as file:
                file.write(json.dumps(rows[-1]) + "\n")
    of_peers = peers.run_missing()
    write_page("motors.md", "\n".join(page(rows, of_peers)) + "\n", [*rows, *of_peers, *peers.real_log()])


if __name__ == "__main__":
    main()
