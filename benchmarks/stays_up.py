"""Falls during calibrations: `make bench-stays-up`. Writes benchmarks/results/stays_up.md.

Every robot of the catalogue with the preset `realistic`, 20 seeds, 60 and 120 s (A1 robot time), with the Bayesian method. The
seed draws a payload of up to 30 % of the robot's mass, up to 0.3 of half its length and width from the middle and 0.2 to 0.5
hip heights above the base's origin. It also draws drives with up to 30 % less gain and feed-forward torque, which report the
commanded torque. A robot has fallen when its base leans by more than 40 degrees.

An interrupted benchmark resumes from benchmarks/results/stays_up.jsonl. Seeds below 10,000 give the effect on accuracy,
compared with rows of the older code, from its checkout in BEFORE (run in benchmarks/):

    PYTHONPATH=BEFORE/src python stays_up.py --seeds 0 6 --budgets 60 --rows results/stays_up_before.jsonl
"""

from __future__ import annotations

import argparse
import json
import os
import warnings
from collections.abc import Iterable
from pathlib import Path

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

import numpy as np
from provenance import commit, write_page

from equipoise import BayesianMethod, Recording, calibrate, load_robot, nominal_stance, simulate
from equipoise.errors import EquipoiseError
from equipoise.recording.trials import LiftTrial
from equipoise.robot.catalog import CATALOG
from equipoise.robot.inertial import components
from equipoise.robot.model import RobotModel
from equipoise.simulation.simulation import Simulation

RESULTS = Path(__file__).parent / "results"
ROWS, BEFORE = RESULTS / "stays_up.jsonl", RESULTS / "stays_up_before.jsonl"
SEEDS, BUDGETS = range(10_000, 10_020), (60, 120)  # [s] on an A1
HEAVIEST, OFF_CENTRE, ABOVE, SOFTEST = 0.3, 0.3, (0.2, 0.5), 0.3
FALLEN = np.radians(40)

Row = dict[str, object]


def payload_of(robot: RobotModel, generator: np.random.Generator) -> str:
    """Return a point mass on the trunk as text."""
    stance = nominal_stance(robot)
    half = np.abs(stance.feet_in_base[:, :2]).mean(axis=0)
    mass = generator.uniform(0, HEAVIEST) * robot.mass
    place = [*(generator.uniform(-OFF_CENTRE, OFF_CENTRE, 2) * half), generator.uniform(*ABOVE) * stance.hip_height]
    return ",".join(f"{value:.6g}" for value in (max(mass, 1e-3), *place))


def soften(simulation: Simulation, share: float) -> None:
    """Reduce the drives' torques by a share; the engine's gains follow from this at every motion."""
    simulation.errors.torque_gain[:] *= 1 - share


def run(name: str, seed: int, budget: int) -> Row:
    """One calibration."""
    robot = load_robot(name)
    generator = np.random.default_rng([seed, 83])
    payload, softness = payload_of(robot, generator), generator.uniform(0, SOFTEST)
    clock = nominal_stance(robot).scale.time
    settings = BayesianMethod(duration=budget * clock)
    recordings: list[Recording] = []
    leaning: list[float] = []
    row: Row = {"robot": name, "seed": seed, "budget": budget, "payload": payload, "softness": round(softness, 4)}
    row["commit"] = commit()
    with simulate(robot, "realistic", payload, seed) as simulation:
        soften(simulation, softness)

        def keep(recording: Recording) -> None:
            recordings.append(recording)
            leaning.append(simulation.truth_view.look().tilt)

        try:
            result = calibrate(simulation.platform, robot, settings, keep)
        except EquipoiseError as error:
            row |= {"failed": type(error).__name__, "message": str(error)}
        else:
            truth = components(simulation.truth.composite)
            error = result.composite.values - truth
            sd = result.composite.stds
            row |= {"truth": truth.tolist(), "error": error.tolist(), "sd": sd.tolist()}
            row["alarms"] = [check.name for check in result.checks if not check.passed]
        leaning.append(simulation.truth_view.look().tilt)
    lifts = [recording for recording in recordings if isinstance(recording.trial, LiftTrial)]
    lifted = sum(recording.complete for recording in lifts)
    return row | {"fell": bool(max(leaning) > FALLEN), "lifts": lifted, "refused": len(lifts) - lifted}


def read(path: Path) -> list[Row]:
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()] if path.exists() else []


def key(row: Row) -> tuple[object, ...]:
    return row["robot"], row["seed"], row["budget"]


def accuracy(rows: Iterable[Row]) -> str:
    """Return rms errors of the mass, the CoM, and the moments of inertia over the mass."""
    finished = [row for row in rows if "error" in row]
    if not finished:
        return "- | - | - | -"
    error, truth = (np.array([row[name] for row in finished]) for name in ("error", "truth"))
    lengths = np.array([nominal_stance(load_robot(str(row["robot"]))).scale.length for row in finished])
    planar, height = 1e3 * np.linalg.norm(error[:, 1:3], axis=1) / lengths, 1e3 * error[:, 3] / lengths
    mass = 1 + error[:, :1] / truth[:, :1]
    moments = (1 + error[:, 4:7] / truth[:, 4:7]) / mass - 1
    columns = (100 * (mass - 1), planar, height, 100 * moments)
    return " | ".join(f"{np.sqrt(np.mean(np.square(column))):.2f}" for column in columns)


def table(rows: list[Row]) -> list[str]:
    """Return a line for each robot and duration, and one for all."""
    text = [
        "| robot | duration | runs | falls | errors | alarms | lifts | skipped | mass [%] | x, y [mm] | z [mm] | I/m [%] |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    groups = [(name, budget) for name in CATALOG for budget in BUDGETS]
    for name, budget in [*groups, ("all", "")]:
        of = [row for row in rows if (row["robot"], row["budget"]) == (name, budget) or name == "all"]
        if not of:
            continue
        broken = sum("failed" in row and not row["fell"] for row in of)
        text.append(
            f"| {name} | {budget} | {len(of)} | {sum(bool(row['fell']) for row in of)} | {broken} | "
            f"{sum(bool(row.get('alarms')) for row in of)} | {np.mean([row['lifts'] for row in of]):.1f} | "
            f"{np.mean([row['refused'] for row in of]):.1f} | {accuracy(of)} |"
        )
    return text


ABOUT = """# Falls during calibrations

`make bench-stays-up`: the Bayesian method in simulation, `realistic`, on every robot of the catalogue.
The seed draws a payload of up to 30 % of the robot's mass (up to 0.3 of half the robot's length and width from the middle,
0.2 to 0.5 hip heights above the base's origin). It also draws drives with up to 30 % less gain and feed-forward torque than
the model, which report the commanded torque. Both are unknown to the method. Durations are an A1's; larger robots take longer.

*Falls*: the base leaned by more than 40 degrees. *Errors*: runs that ended with an error without a fall. *Alarms*: runs with a
failed check. *Lifts*, *skipped*: mean number per run of lifts done, and of lifts skipped because the robot could have tipped
over. Errors are root mean square, lengths scaled to an A1. There is no scale, so mass errors follow from the torque errors.
"""
COST = """
## Effect on accuracy

Seeds 0 to 5 and 60 s, with older code (commit afc01b9), which kept two feet up until the base had rotated by 0.06 rad, and
with the correction, both in that commit's simulation: {fell} of {runs} fell before. Runs with both results: {shared}.

| | lifts | mass [%] | x, y [mm] | z [mm] | I/m [%] |
|---|---|---|---|---|---|"""


def page(kept: list[Row], before: list[Row]) -> str:
    """Write the page, with the effect on accuracy if there are rows of the older code."""
    rows = [row for row in kept if int(str(row["seed"])) in SEEDS]
    target = "missed" if any(row["fell"] for row in rows) else "met"
    seeds = [int(str(row["seed"])) for row in rows]
    of = len(SEEDS) * len(BUDGETS) * len(CATALOG)
    said = f"Target: no robot falls: **{target}** in {len(rows)} of {of} runs, seeds {min(seeds)} to {max(seeds)}."
    text = [ABOUT, said, "", *table(rows)]
    shared = {key(row) for row in before if "error" in row} & {key(row) for row in kept if "error" in row}
    if shared:
        text.append(COST.format(fell=sum(bool(row["fell"]) for row in before), runs=len(before), shared=len(shared)))
        for name, of in (("before", before), ("now", kept)):
            both = [row for row in of if key(row) in shared]
            text.append(f"| {name} | {np.mean([row['lifts'] for row in both]):.1f} | {accuracy(both)} |")
    failures = [row for row in rows if "failed" in row]
    if failures:
        text += ["", "## Runs without a result", ""]
        text += [f"- {row['robot']}, {row['budget']} s, seed {row['seed']}: {row['message']}" for row in failures]
    return "\n".join(text) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=Path, default=ROWS)
    parser.add_argument("--robots", nargs="*", default=list(CATALOG))
    parser.add_argument("--seeds", type=int, nargs=2, default=(SEEDS.start, SEEDS.stop), metavar=("FIRST", "STOP"))
    parser.add_argument("--budgets", type=int, nargs="*", default=BUDGETS)
    asked = parser.parse_args()
    warnings.simplefilter("ignore")
    rows = read(asked.rows)
    done = {key(row) for row in rows}
    for seed in range(*asked.seeds):
        for name in asked.robots:
            for budget in asked.budgets:
                if (name, seed, budget) in done:
                    continue
                rows.append(run(name, seed, budget))
                with asked.rows.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(rows[-1]) + "\n")
                print(
                    name, seed, budget, "fell" if rows[-1]["fell"] else rows[-1].get("failed", "stayed up"), flush=True
                )
    if asked.rows == ROWS:
        write_page("stays_up.md", page(rows, read(BEFORE)), [row for row in rows if int(str(row["seed"])) in SEEDS])
    print("\n".join(table(rows)))


if __name__ == "__main__":
    main()
