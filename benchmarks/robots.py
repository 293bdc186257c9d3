"""Accuracy on all catalogue robots with both methods: `make bench-robots`.

The bare robot with perfect sensors (`ideal`), and with a payload, sensor errors and a scale of 0.5 % drawn from one seed
(`realistic`). The paper's method has default settings, the Bayesian method 60 s (A1 robot time). Each run appends a row to
benchmarks/results/robots.jsonl, from which an interrupted benchmark resumes. benchmarks/results/robots.md is written from the
rows.

    python benchmarks/robots.py                      # missing runs, then the page
    python benchmarks/robots.py --files SPOT.xml     # also robots from your own files, including arms
    python benchmarks/robots.py --tables             # page only
"""

from __future__ import annotations

import argparse
import json
import os
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import numpy as np
from accuracy import Row, judged, load_rows, payload_of, relative, rounded
from provenance import commit, write_page

from equipoise import BayesianMethod, Calibration, PaperMethod, calibrate, load_robot, nominal_stance, simulate
from equipoise.errors import EquipoiseError, MissingDependencyError
from equipoise.result.statistics import NORMAL_95
from equipoise.robot.catalog import CATALOG

RESULTS = Path(__file__).parent / "results"
ROWS = RESULTS / "robots.jsonl"
METHODS, NOISES = ("paper", "bayesian"), ("ideal", "realistic")
SEED = 10_000
BUDGET = 60.0  # [s] on an A1
SCALE = 0.005  # a scale's error, as a fraction
PAPER_LIMIT = 2.0  # [mm] per coordinate with legs of 0.4 m and perfect sensors


@dataclass(frozen=True)
class Case:
    """Calibration of a robot from the catalogue or from a file."""

    robot: str
    noise: str
    method: str

    @property
    def key(self) -> str:
        return f"{Path(self.robot).stem}/{self.noise}/{self.method}"


def run(case: Case) -> Row | None:
    """Return the row of a case; None if the robot's package is not installed."""
    warnings.simplefilter("ignore")
    row: Row = {
        "key": case.key, "robot": Path(case.robot).stem, "named": case.robot in CATALOG, "noise": case.noise,
        "method": case.method, "commit": commit(),
    }  # fmt: skip
    try:
        robot = load_robot(case.robot)
        generator = np.random.default_rng(SEED)
        payload = None if case.noise == "ideal" else payload_of(robot, generator)
        row |= {"leg_length": robot.leg_length, "held": dict(robot.locked_joints), "payload": payload}
        with simulate(robot, case.noise, payload, SEED) as simulation:
            weighed = simulation.truth.composite.mass * (1 + SCALE * generator.standard_normal())
            method = (
                PaperMethod()
                if case.method == "paper"
                else BayesianMethod(duration=BUDGET * nominal_stance(robot).scale.time)
            )
            if case.method == "bayesian" and case.noise != "ideal":
                method = BayesianMethod(duration=method.duration, mass=weighed, mass_std=SCALE * weighed)
            result = calibrate(simulation.platform, robot, method).with_truth(simulation.truth)
    except MissingDependencyError:
        return None
    except EquipoiseError as error:
        return row | {"failed": f"{type(error).__name__}: {error}"}
    return row | result_columns(result)


def result_columns(result: Calibration) -> Row:
    """Return the result and the truth."""
    return judged(result) | {
        "truth": [quantity.truth for quantity in result.composite],
        "robot_time": sum(trial.duration for trial in result.trials),
        "bracket": [line.upper - line.lower for line in result.support_lines.values()],
        "warnings": list(result.warnings),
    }


def allowed(row: Row) -> float:
    """Return the allowed error of the paper's method with perfect sensors [mm]."""
    return PAPER_LIMIT * row["leg_length"] / 0.4


def paper_line(row: Row) -> str:
    x, y = (1000 * value for value in row["error"][1:3])
    limit, worst = allowed(row), max(abs(x), abs(y))
    met = "" if row["noise"] != "ideal" else "met" if worst <= limit else f"missed by {worst - limit:.1f} mm"
    bracket = max(row["bracket"]) * 1000
    return (
        f"| {row['robot']} | {row['noise']} | {x:+.2f} | {y:+.2f} | {limit:.1f} | {met} | {bracket:.1f} | "
        f"{row['robot_time']:.0f} | {'; '.join(row['warnings'])} | {row['commit']} |"
    )


def bayesian_line(row: Row) -> str:
    error, half = (relative(row, row[name]) for name in ("error", "sd"))
    cells = [f"{error[i]:+.2f} +- {NORMAL_95 * half[i]:.2f}" for i in range(7)]
    return (
        f"| {row['robot']} | {row['noise']} | {' | '.join(cells)} | {sum(row['holds'])} of {len(row['holds'])} | "
        f"{', '.join(row['alarms'])} | {row['robot_time']:.0f} | {row['commit']} |"
    )


HEADS = {
    "paper": "| robot | sensors | x [mm] | y [mm] | allowed | | bracket [mm] | time [s] | warnings | commit |",
    "bayesian": (
        "| robot | sensors | mass % | CoM x [mm] | y | z | Ixx % | Iyy % | Izz % | coverage | failed checks | "
        "time [s] | commit |"
    ),
}
LINES = {"paper": paper_line, "bayesian": bayesian_line}


def table(method: str, rows: Sequence[Row]) -> list[str]:
    """Return a line for each robot and preset."""
    of = sorted((row for row in rows if row["method"] == method and "failed" not in row), key=_order)
    return [HEADS[method], "|" + "---|" * (HEADS[method].count("|") - 1), *map(LINES[method], of)]


def _order(row: Row) -> tuple[bool, int, str, str]:
    names = list(CATALOG)
    place = names.index(row["robot"]) if row["named"] else len(names)
    return not row["named"], place, row["robot"], row["noise"]


def verdicts(rows: Sequence[Row]) -> list[str]:
    """Return the summary and its targets."""
    good = [row for row in rows if "failed" not in row]
    ideal = [row for row in good if (row["method"], row["noise"]) == ("paper", "ideal")]
    met = sum(np.abs(row["error"][1:3]).max() * 1000 <= allowed(row) for row in ideal)
    text = [
        f"- The paper's method with perfect sensors, target: x and y within 2 mm, times the leg length over 0.4 m: **{met} of "
        f"{len(ideal)} robots**."
    ]
    for noise in NOISES:
        of = [row for row in good if (row["method"], row["noise"]) == ("bayesian", noise)]
        if of:
            holds = np.concatenate([row["holds"] for row in of])
            fired = sum(bool(row["alarms"]) for row in of)
            text.append(
                f"- The Bayesian method, `{noise}`: {holds.sum()} of {holds.size} intervals contain the truth; a check fails "
                f"in {fired} of {len(of)} runs."
            )
    return text


ABOUT = """# Accuracy on all robots

`make bench-robots`; each row is one run and names its commit. `ideal`: perfect sensors, no payload. `realistic`: a payload of
5 to 30 % of the base's mass, sensor errors and a scale of 0.5 %, drawn from the seed {seed}. Errors of the whole robot,
estimate minus truth. Robots after the catalogue's own are from public model files, which are not part of this repository.
"""
PAPER_ABOUT = """*Allowed* and *met*: with perfect sensors; joint offsets add more error. *Bracket*: the wider of the last two.
"""
PRECISE_ABOUT = "Error, and half width of the 95 % interval; moments relative to the truth.\n"


def page(rows: Sequence[Row]) -> str:
    """The page."""
    sections = [
        ("The paper's method, default settings", [PAPER_ABOUT, *table("paper", rows)]),
        (f"The Bayesian method, {BUDGET:.0f} s (A1 robot time)", [PRECISE_ABOUT, *table("bayesian", rows)]),
        ("Locked joints", held_joints(rows)),
        ("Ended by name", [f"- {row['key']}: {row['failed']}" for row in rows if "failed" in row]),
    ]
    shown = [line for title, lines in sections if lines for line in ("", f"## {title}", "", *lines)]
    return "\n".join([ABOUT.format(seed=SEED), *verdicts(rows), *shown, ""])


def held_joints(rows: Sequence[Row]) -> list[str]:
    """Return the positions of each robot's locked joints, such as an arm's."""
    held = {row["robot"]: row["held"] for row in rows if row.get("held")}
    return [f"- {name}: {', '.join(f'{joint} {q:g}' for joint, q in at.items())} [rad]" for name, at in held.items()]


def main() -> None:
    """Run missing cases, then write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--files", nargs="*", default=[], metavar="PATH", help="additional model files")
    parser.add_argument("--tables", action="store_true", help="the page only")
    given = parser.parse_args()
    rows = load_rows(ROWS)
    robots = () if given.tables else (*CATALOG, *given.files)
    for case in [Case(robot, noise, method) for method, noise, robot in product(METHODS, NOISES, robots)]:
        if case.key in rows or (row := rounded(run(case))) is None:
            continue
        rows[case.key] = row
        with ROWS.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")
        print(
            case.key,
            row.get("failed", [round(1000 * error, 2) for error in row.get("error", [])[1:4] if error]),
            flush=True,
        )
    write_page("robots.md", page(list(rows.values())), rows.values())
    print(*verdicts(list(rows.values())), sep="\n")


if __name__ == "__main__":
    main()
