"""Replay of lifts in simulation with the estimated body and the model file's: `make bench-validate`.

Writes benchmarks/results/validate.md. A simulated robot is calibrated for two minutes, without or with a payload of 1.5 kg on
an A1 (scaled to other robots), and its lifts are replayed. With typical sensors it is calibrated again for 45 s with other
noise, and these lifts are replayed with the body of the first run, whose estimate does not use them. An interrupted benchmark
resumes from validate.jsonl.
"""

from __future__ import annotations

import json
import os
import time
import warnings
from collections.abc import Iterator
from pathlib import Path

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import numpy as np
from provenance import commit, write_page

from equipoise import BayesianMethod, Calibration, Payload, RobotModel, calibrate, load_robot, nominal_stance, simulate
from equipoise.errors import EquipoiseError, ModelWarning
from equipoise.lab.replay.validation import validate
from equipoise.result.held_out import FOUND, MODEL
from equipoise.robot.inertial import InertialParameters

RESULTS = Path(__file__).parent / "results"
ROWS = RESULTS / "validate.jsonl"
ROBOTS = ("unitree_a1", "go2")
SEEDS = range(10_000, 10_003)  # below are for development
CASES = (("ideal", False), ("realistic", False), ("realistic", True))
FIRST = "first run"


def payload_of(robot: RobotModel) -> Payload:
    """Return a payload of 1.5 kg on an A1, 10 cm ahead of and 8 cm above the base's origin."""
    a1 = load_robot("unitree_a1")
    size = nominal_stance(robot).hip_height / nominal_stance(a1).hip_height
    return Payload(InertialParameters(1.5 * robot.mass / a1.mass, size * np.array([0.1, 0, 0.08]), np.zeros((3, 3))))


def calibrated(
    robot: RobotModel, noise: str, loaded: bool, seed: int, noise_seed: int, method: BayesianMethod
) -> Calibration:
    """Return a run in simulation."""
    with simulate(robot, noise, payload_of(robot) if loaded else None, seed, noise_seed=noise_seed) as simulation:
        return calibrate(simulation.platform, robot, method)


def row_of(name: str, seed: int, noise: str, loaded: bool) -> dict[str, object]:
    """Return the tilt errors with the bodies [mm]."""
    robot = load_robot(name)
    row: dict[str, object] = {"robot": name, "seed": seed, "noise": noise, "loaded": loaded, "commit": commit()}
    try:
        first = calibrated(robot, noise, loaded, seed, 2 * seed, BayesianMethod())
        assert first.held_out is not None
        row["held out"] = {body: 1e3 * first.held_out.error(body) for body in first.held_out.bodies}
        row["checks"] = [check.name for check in first.checks if not check.passed]
        started = time.process_time()
        played = validate(first)
        row["cpu"] = time.process_time() - started
        row["played"], row["lifts"] = {body: 1e3 * played.error(body) for body in played.bodies}, len(played.lifts)
        if noise != "ideal":
            second = calibrated(
                robot,
                noise,
                loaded,
                seed,
                2 * seed + 1,
                BayesianMethod(duration=45.0 if name == "unitree_a1" else 50.0),
            )
            played = validate(second, {FIRST: first})
            row["second"] = {body: 1e3 * played.error(body) for body in played.bodies}
    except EquipoiseError as error:
        return {**row, "failed": str(error)}
    return row


def lines(rows: list[dict[str, object]]) -> Iterator[str]:
    """The page."""
    yield "# Replay validation"
    yield ""
    yield (
        "`make bench-validate`: runs of two minutes, seeds from 10,000, no scale; "
        "[method](../../docs/simulation-studies.md#replay-validation). Root mean square over lifts of measured minus "
        "simulated tilt at the end, as a distance at the CoM; median over robots. `ideal` is one run, as nothing is drawn. "
        "A second run of 45 s is of the same robot with other noise: its lifts are replayed with the body of the first run, "
        "which does not use them. In `realistic` the leg masses differ from the file by some percent, so the file of a bare "
        "robot has errors too. Held-out: prediction by the tilt equation with the estimated legs."
    )
    yield ""
    yield (
        "| robot | preset | payload | runs | estimate [mm] | model file [mm] | ratio | second run: body of the first [mm] | "
        "model file [mm] | ratio | held-out: estimate, model file [mm] |"
    )
    yield "|" + "---|" * 11
    for name in ROBOTS:
        for noise, loaded in CASES:
            alike = (name, noise, loaded)
            of = [row for row in rows if (row["robot"], row["noise"], row["loaded"]) == alike and "played" in row]
            if of:
                yield line(of, "1.5 kg of an A1" if loaded else "none")
    yield ""
    for row in rows:
        if "failed" in row:
            yield f"- {row['robot']} {row['seed']}, {row['noise']}: {row['failed']}"
    failed = sum(bool(row.get("checks")) for row in rows)
    cost = np.median([row["cpu"] for row in rows if "cpu" in row])
    yield f"The replay of a run with two bodies takes {cost:.1f} CPU s. A check failed in {failed} of {len(rows)} runs."


def line(rows: list[dict[str, object]], payload: str) -> str:
    """Return a row of the table."""
    there = all("second" in row for row in rows)
    second = [*medians(rows, "second", FIRST)] if there else ["-", "-", "-"]
    held = medians(rows, "held out", FOUND)
    cells = [*medians(rows, "played", FOUND), *second, f"{held[0]}, {held[1]}"]
    return f"| {rows[0]['robot']} | {rows[0]['noise']} | {payload} | {len(rows)} | {' | '.join(cells)} |"


def medians(rows: list[dict[str, object]], what: str, body: str) -> tuple[str, str, str]:
    """Return errors with a body and with the model file's, and their ratio: median, and range if they differ."""
    found, model = (np.array([row[what][one] for row in rows]) for one in (body, MODEL))
    ratio = np.sort(model / found)
    spread = f" ({ratio[0]:.1f} to {ratio[-1]:.1f})" if ratio[-1] - ratio[0] > 0.05 else ""
    return f"{np.median(found):.2f}", f"{np.median(model):.2f}", f"{np.median(ratio):.1f}{spread}"


def main() -> None:
    """Run missing cases and write the page."""
    warnings.simplefilter("ignore", ModelWarning)
    rows = [json.loads(text) for text in ROWS.read_text(encoding="utf-8").splitlines()] if ROWS.exists() else []
    done = {(row["robot"], row["seed"], row["noise"], row["loaded"]) for row in rows}
    for seed in SEEDS:
        for name in ROBOTS:
            for noise, loaded in CASES:
                if (name, seed, noise, loaded) in done or (noise == "ideal" and seed != SEEDS[0]):
                    continue
                rows.append(row_of(name, seed, noise, loaded))
                print(name, seed, noise, loaded, flush=True)
                with ROWS.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(rows[-1]) + "\n")
        write_page("validate.md", "\n".join(lines(rows)) + "\n", rows)


if __name__ == "__main__":
    main()
