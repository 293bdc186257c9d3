"""Payloads in logs of walks, as a table of payload.md: against a prior run or the model file, weighed or not."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from rows import Row, Table  # isort: skip - it limits the threads of NumPy
import numpy as np
from simulated import FIRST_SEED, SCALE_ERROR, robot_called
from tables import column, coverage, figures, markdown, rms
from walks import GAITS, payload_on_trunk, write_table

from equipoise import BayesianMethod, Payload, RobotModel, calibrate, nominal_stance, simulate
from equipoise.estimator.prior_runs.prior_run import PriorRun
from equipoise.logs.payload import measure_payload_in_log
from equipoise.logs.reader import read_log
from equipoise.result.statistics import NORMAL_95

PAYLOADS = (0.5, 2.0)  # [kg]
LOADED, BARE = 16, 5  # runs with a payload, and without one
BARE_WALK = "prior run and bare walk"
WAYS = ("prior run", "prior run and scale", BARE_WALK, "model file", "model file and scale")
MASS_TARGET, PLACE_TARGET, CPU_TARGET = 5.0, 5.0, 5.0  # [%], [mm], [s]
DETERMINED = 10e-3  # [m], half width of a 95 % interval


def measure(loaded: bool, seed: int) -> Row:
    """Return the payload in a trot of 20 s, or of 60 s for every fifth seed, by way."""
    robot, generator = robot_called("unitree_a1"), np.random.default_rng([seed, 79])
    clock, factor = nominal_stance(robot).scale.time, 1 + SCALE_ERROR * float(generator.standard_normal())
    payload = payload_on_trunk(robot, seed, float(generator.uniform(*PAYLOADS))) if loaded else None
    with simulate(robot, "realistic", None, seed, noise_seed=2 * seed + 1) as simulation:
        method = BayesianMethod(leg_prior="narrow", cable="none", mass=factor * simulation.truth.composite.mass)
        first = calibrate(simulation.platform, robot, method)
    assert first.evidence is not None
    prior_run = PriorRun.of(first.evidence.posterior, first.settings, "bare")
    seconds = 60 if seed % 5 == 0 else 20
    with simulate(robot, "realistic", payload, seed, noise_seed=2 * seed) as simulation:
        walk = GAITS["trot"](simulation.platform, robot, (1 + seconds) * clock, phase=float(seed))
        weighed = factor * simulation.truth.composite.mass
    with simulate(robot, "realistic", None, seed, noise_seed=5 * seed) as simulation:
        bare_walk = GAITS["trot"](simulation.platform, robot, 21 * clock, phase=seed + 2.5)
    with tempfile.TemporaryDirectory() as folder:
        file, bare_file = Path(folder, "trot.csv"), Path(folder, "bare.csv")
        write_table(walk, file)
        write_table(bare_walk, bare_file)
        ways = {
            way: measured(
                robot,
                file,
                BayesianMethod(
                    prior_run=prior_run if "prior run" in way else None,
                    cable="none",
                    mass=weighed if "scale" in way else None,
                ),
                payload,
                bare_file if way == BARE_WALK else None,
            )
            for way in WAYS
        }
    return {"ways": ways, "seconds": seconds}


def measured(robot: RobotModel, file: Path, method: BayesianMethod, payload: Payload | None, bare: Path | None) -> Row:
    """Return the answer, the CPU time of reading and estimating, and errors of mass [%] and place [mm] if it has a place."""
    begun = time.process_time()
    walk = None if bare is None else read_log(bare, robot)
    found, _ = measure_payload_in_log(robot, read_log(file, robot), method, walk)
    row: Row = {"cpu": time.process_time() - begun, "answer": found.answer}
    estimates = [*found.change.payload][:4]
    if payload is None or estimates[1].value is None:
        return row
    true = np.array([payload.parameters.mass, *payload.parameters.com])
    error, sd = (np.array([getattr(one, name) for one in estimates]) for name in ("value", "std"))
    error = error - true
    return row | {
        "payload": (error * [100 / true[0], 1e3, 1e3, 1e3]).tolist(),
        "holds": (np.abs(error) <= NORMAL_95 * sd).tolist(),
        "determined": (NORMAL_95 * sd[1:] <= DETERMINED).tolist(),
    }


def show(rows: list[Row]) -> Iterator[str]:
    yield "## In the log of a walk"
    yield ""
    yield (
        f"`equipoise payload --log`: payloads of {PAYLOADS[0]} to {PAYLOADS[1]} kg at random places on an A1, 20 s of trot, "
        "or 60 s. *Prior run*: the bare robot, two minutes, weighed. *Bare walk*: `--bare-log`, 20 s of the bare robot in "
        f"another phase. Targets: mass {MASS_TARGET:g} %, place {PLACE_TARGET:g} mm, coverage 90 %, {CPU_TARGET:g} s. "
        f"*Determined*: coordinates within {1e3 * DETERMINED:g} mm, half width of the 95 % interval; the answer names the "
        "others. Errors are of answers with a place. *False alarms*: changes that are reported without a payload."
    )
    yield ""
    head = (
        "reference", "n", "with a place", "mass [%]", "place x, y, z [mm]", "coverage", "determined, rms [mm]", "false alarms",
        "CPU of 20, 60 s [s]",
    )  # fmt: skip
    yield from markdown(head, _lines(rows))


def _lines(rows: list[Row]) -> Iterator[list[str]]:
    loaded, bare = ([row for row in rows if row["case"][0] is full] for full in (True, False))
    for way in WAYS:
        all_found = [row["ways"][way] for row in loaded]
        found = [one for one in all_found if "payload" in one]
        alarms = sum(row["ways"][way]["answer"] in ("added", "removed", "moved") for row in bare)
        cpu = [np.mean([row["ways"][way]["cpu"] for row in rows if row["seconds"] == s] or [np.nan]) for s in (20, 60)]
        cells = ["-"] * 4
        if found:
            error, narrow = column(found, "payload"), column(found, "determined").astype(bool)
            near = f", {rms(error[:, 1:][narrow]):.1f}" if narrow.any() else ""
            cells = [
                figures(rms(error[:, :1]), ".1f", MASS_TARGET), figures(rms(error[:, 1:]), ".0f", PLACE_TARGET),
                coverage(found, 0.9), f"{narrow.mean():.0%}{near}",
            ]  # fmt: skip
        yield [
            way, str(len(loaded)), str(len(found)), *cells, f"{alarms} of {len(bare)}", figures(cpu, ".1f", CPU_TARGET)
        ]  # fmt: skip


CASES = [
    (number < LOADED, FIRST_SEED + number) for number in np.random.default_rng(0).permutation(LOADED + BARE).tolist()
]
"""Runs with and without a payload, mixed, so that a part of them has both."""
TABLE = Table("walks", measure, CASES, show)
