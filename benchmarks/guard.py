"""False alarms of the guard with healthy robots: `make bench-guard`. Writes benchmarks/results/guard.md.

Every installed robot of the catalogue is calibrated with the guard in simulation, with typical sensor errors. Runs start
standing or lying, with both methods that lift feet. An alarm ends a run; the last column names it.
"""

from __future__ import annotations

import os
import warnings
from pathlib import Path

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import numpy as np
from provenance import write_page

from equipoise import BayesianMethod, calibrate, load_robot, simulate
from equipoise.errors import EquipoiseError, MissingDependencyError, ModelWarning
from equipoise.guard.guard import Guard
from equipoise.method.table import method_named
from equipoise.robot.catalog import CATALOG
from equipoise.robot.model import RobotModel

RESULTS = Path(__file__).parent / "results"
RUNS = (("bayesian", "standing"), ("bayesian", "lying"), ("paper", "standing"))
SEED, BUDGET = 10_000, 60.0


def row(robot: RobotModel, method: str, start: str) -> tuple[bool, str]:
    """Run one case; return true if there was no alarm, and its table line."""
    settings = BayesianMethod(duration=BUDGET) if method == "bayesian" else method_named(method)()
    with simulate(robot, "realistic", seed=SEED, start=start) as simulation:
        guard = Guard(simulation.platform, robot)
        try:
            with guard:
                calibrate(guard, robot, settings)
            outcome = "calm"
        except EquipoiseError as error:
            outcome = f"**{type(error).__name__}: {error}**"
    report = guard.report()
    tilt, ending = np.degrees(report.largest_tilt), ", ".join(report.ending)
    return (
        outcome == "calm",
        f"| {robot.name} | {method} | {start} | {report.commands} | {tilt:.0f} | {ending} | {outcome} |",
    )


def main() -> None:
    """Run all cases and write the page."""
    warnings.simplefilter("ignore", ModelWarning)
    rows: list[tuple[bool, str]] = []
    for name in CATALOG:
        try:
            robot = load_robot(name)
        except MissingDependencyError as error:
            print(f"{name}: {error}")
            continue
        for method, start in RUNS:
            rows.append(row(robot, method, start))
            print(rows[-1][1], flush=True)
    calm = sum(ok for ok, _ in rows)
    text = [
        "# False alarms of the guard",
        "",
        f"`make bench-guard`; `--sim-preset realistic`, seed {SEED}, `bayesian` with {BUDGET:.0f} s of robot time. "
        f"{calm} of {len(rows)} runs ended without an alarm. Lean: largest angle from upright; lift trials tip the robot.",
        "",
        "| robot | method | start | commands | lean [deg] | end | alarm |",
        "|---|---|---|---|---|---|---|",
        *(line for _, line in rows),
    ]
    write_page("guard.md", "\n".join(text) + "\n")


if __name__ == "__main__":
    main()
