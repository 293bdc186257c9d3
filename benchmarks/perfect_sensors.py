"""Coverage of intervals and false alarms of checks without sensor errors: `make bench-perfect-sensors`.

Every robot of the catalogue with the preset `ideal`, with and without a payload drawn from a seed, is calibrated with the
Bayesian method for 60 and 120 s (A1 robot time). This shows model errors of the estimator, independent of sensor noise.
Writes benchmarks/results/perfect_sensors.md. An interrupted benchmark resumes from perfect_sensors.jsonl.
"""

from __future__ import annotations

import json
import os
import warnings
from concurrent.futures import ProcessPoolExecutor, as_completed
from itertools import product
from pathlib import Path

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

import numpy as np
from provenance import commit, write_page

from equipoise import BayesianMethod, calibrate, load_robot, nominal_stance, simulate
from equipoise.errors import EquipoiseError
from equipoise.estimator.equations.stance_motion import StanceMotions
from equipoise.estimator.equations.tilt import TiltEquation
from equipoise.result.statistics import NORMAL_95
from equipoise.robot.catalog import CATALOG
from equipoise.robot.inertial import components
from equipoise.robot.model import RobotModel

RESULTS = Path(__file__).parent / "results"
ROWS = RESULTS / "perfect_sensors.jsonl"
BUDGETS = (60, 120)  # [s] on an A1
SEEDS = (None, 10_000)  # of the payload
LIGHTEST, HEAVIEST = 0.05, 0.2  # of the robot's mass

Row = dict[str, object]
Case = tuple[str, int, int | None]


def payload_of(robot: RobotModel, seed: int | None) -> str | None:
    """Return a point mass on the trunk as text."""
    if seed is None:
        return None
    generator, stance = np.random.default_rng(seed), nominal_stance(robot)
    half = np.abs(stance.feet_in_base[:, :2]).mean(axis=0)
    place = [*(generator.uniform(-0.3, 0.3, 2) * half), generator.uniform(0.2, 0.4) * stance.hip_height]
    return ",".join(f"{value:.6g}" for value in (generator.uniform(LIGHTEST, HEAVIEST) * robot.mass, *place))


def run(case: Case) -> Row:
    """One calibration."""
    warnings.simplefilter("ignore")
    name, budget, seed = case
    robot = load_robot(name)
    payload = payload_of(robot, seed)
    settings = BayesianMethod(duration=budget * nominal_stance(robot).scale.time)
    row: Row = {"robot": name, "budget": budget, "seed": seed, "payload": payload, "commit": commit()}
    with simulate(robot, "ideal", payload) as simulation:
        try:
            result = calibrate(simulation.platform, robot, settings)
        except EquipoiseError as error:
            return row | {"failed": f"{type(error).__name__}: {error}"}
    error = result.composite.values - components(simulation.truth.composite)
    std = result.composite.stds
    posterior = result.evidence.posterior
    unused = sum(
        not normalized_residual.used
        for normalized_residual in (*posterior.residuals_of(TiltEquation), *posterior.residuals_of(StanceMotions))
    )
    unread = sum(motion.left_out is not None for motion in posterior.motions)
    alarms = [check.name for check in result.checks if not check.passed]
    return row | {
        "error": error.tolist(), "std": std.tolist(), "left_out": unused + unread, "alarms": alarms,
    }  # fmt: skip


def table(rows: list[Row]) -> list[str]:
    """Return a line for each robot and duration, and one for all."""
    text = [
        "| robot | duration [s] | runs | failed | coverage | largest error / std | CoM x, y, z [mm] | left out | alarms |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for name, budget in [*product(CATALOG, BUDGETS), ("all", "")]:
        of = [row for row in rows if name == "all" or (row["robot"], row["budget"]) == (name, budget)]
        finished = [row for row in of if "error" in row]
        if not finished:
            continue
        error, std = (np.array([row[what] for row in finished]) for what in ("error", "std"))
        ratio, com = np.abs(error / std), 1e3 * np.sqrt(np.mean(error[:, 1:4] ** 2, axis=0))
        alarms = ", ".join(sorted({alarm for row in finished for alarm in row["alarms"]}))
        text.append(
            f"| {name} | {budget} | {len(of)} | {len(of) - len(finished)} | {np.sum(ratio < NORMAL_95)} of {ratio.size} | "
            f"{ratio.max():.1f} | {com[0]:.2f} {com[1]:.2f} {com[2]:.2f} | {sum(row['left_out'] for row in finished)} | "
            f"{sum(bool(row['alarms']) for row in finished)} {alarms} |"
        )
    return text


ABOUT = """# Perfect sensors

`make bench-perfect-sensors`: the Bayesian method in simulation with the preset `ideal`, no scale, with and without a payload
of 5 to 20 % of the robot's mass. Durations are an A1's; larger robots take longer. CoM errors are root mean square. Target: at
least 95 % of all intervals contain the truth (*coverage*), no check fails (*alarms*), nothing is left out.

**{share:.1%} of {count} intervals contain the truth.**
"""


def page(rows: list[Row]) -> str:
    """The page."""
    ratio = np.abs(np.concatenate([np.array(row["error"]) / row["std"] for row in rows if "error" in row]))
    about = ABOUT.format(share=np.mean(ratio < NORMAL_95), count=ratio.size)
    failed = [
        f"- {row['robot']}, {row['budget']} s, {row['payload']}: {row['failed']}" for row in rows if "failed" in row
    ]
    return "\n".join([about, *table(rows), *(["", "Ended with an error:", "", *failed] if failed else []), ""])


def main() -> None:
    """Run missing cases, then write the page."""
    rows = [json.loads(line) for line in ROWS.read_text(encoding="utf-8").splitlines()] if ROWS.exists() else []
    done = {(row["robot"], row["budget"], row["seed"]) for row in rows}
    missing = [case for case in product(CATALOG, BUDGETS, SEEDS) if case not in done]
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        for future in as_completed([pool.submit(run, case) for case in missing]):
            rows.append(future.result())
            with ROWS.open("a", encoding="utf-8") as file:
                file.write(json.dumps(rows[-1]) + "\n")
            print(rows[-1]["robot"], rows[-1]["budget"], rows[-1]["seed"], rows[-1].get("failed", ""), flush=True)
    write_page("perfect_sensors.md", page(rows), rows)
    print(page(rows))


if __name__ == "__main__":
    main()
