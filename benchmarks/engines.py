"""Comparison of calibrations in MuJoCo, DART and PyBullet: `make bench-engines`.

Robots with a payload are calibrated with `bayesian` in three engines, with perfect sensors (`ideal`) and with the errors of
`realistic` that an engine supports. A seed draws the same payload and errors for all. PyBullet is not part of the package, and
nothing was tuned in it. Every run appends a row to benchmarks/results/engines.jsonl, so that an interrupted benchmark can be
resumed. benchmarks/results/engines.md is written from the rows. Everything is seeded.

    python benchmarks/engines.py             # missing runs, then tables
    python benchmarks/engines.py --seeds 2   # the first seeds only
    python benchmarks/engines.py --tables    # tables only
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import platform as machine
import time
import warnings
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):  # one core per run
    os.environ.setdefault(_name, "1")

import numpy as np
from accuracy import load_rows, payload_of, rms, rounded
from provenance import commit, write_page
from worlds.world import ENGINES, lacking, world

from equipoise import Payload, calibrate, load_robot
from equipoise.errors import EquipoiseError
from equipoise.robot.inertial import COMPONENTS, components

RESULTS = Path(__file__).parent / "results"
ROWS = RESULTS / "engines.jsonl"
ROBOTS = ("unitree_a1", "go2", "solo12", "anymal_c")
FIRST, SEEDS = 10_000, 5  # first seed and number of seeds
PRESETS = ("ideal", "realistic")
UNITS = {"m": ("kg", 1.0, 3), "c": ("mm", 1e3, 2), "I": ("kg m2", 1.0, 4)}  # by a component's first letter
Row = dict[str, object]
ABOUT = """# Calibration in three physics engines

`make bench-engines`; {versions}, Python {python}.
Method `bayesian`, no scale; random payloads of 5 to 30 % of the base's mass. A seed draws the same payload, sensors, motors
and floor for all engines. Contact, joint friction and integration are each engine's own. `ideal`: perfect sensors, and a robot
as in its file. `realistic` without the effects that an engine does not support: {lacks}. Errors of the whole robot at the
nominal stance; each engine computes the truth. PyBullet is not part of the package; nothing was tuned in it.
"""


def run(preset: str, name: str, seed: int, engine: str) -> Row:
    """One row."""
    warnings.simplefilter("ignore")
    robot = load_robot(name)
    payload = payload_of(robot, np.random.default_rng([seed, 77]))
    row: Row = {"key": key_of(preset, name, seed, engine), "commit": commit()}
    begin = time.process_time()
    try:
        with world(engine, preset, robot, Payload.parse(payload), seed) as (platform, truth):
            result = calibrate(platform, robot)
    except EquipoiseError as error:
        return {**row, "failed": f"{type(error).__name__}: {error}"}
    taken = time.process_time() - begin
    return {
        **row,
        "payload": payload,
        "truth": components(truth).tolist(),
        "estimate": result.composite.values.tolist(),
        "sd": result.composite.stds.tolist(),
        "lower": [quantity.lower for quantity in result.composite],
        "upper": [quantity.upper for quantity in result.composite],
        "robot_time": sum(trial.duration for trial in result.trials),
        "cpu_s": taken,
        "alarms": [check.name for check in result.checks if not check.passed],
    }


def key_of(preset: str, robot: str, seed: int, engine: str) -> str:
    return f"{preset}/{robot}/{seed}/{engine}"


def cases(seeds: int) -> list[tuple[str, str, int, str]]:
    """Return preset, robot, seed and engine of all runs, ordered by seed."""
    order = itertools.product(range(FIRST, FIRST + seeds), PRESETS, ROBOTS, ENGINES)
    return [(preset, robot, seed, engine) for seed, preset, robot, engine in order]


def rows_of(rows: dict[str, Row], preset: str, robot: str, engine: str) -> list[Row]:
    """Return the rows of seeds that all engines finished."""
    found: list[Row] = []
    for seed in range(FIRST, FIRST + SEEDS):
        here = {other: rows.get(key_of(preset, robot, seed, other), {"failed": ""}) for other in ENGINES}
        if not any("failed" in row for row in here.values()):
            found.append(here[engine])
    return found


def array(rows: Iterable[Row], name: str) -> np.ndarray:
    """Return the (n, 10) values of a column of rows."""
    return np.array([row[name] for row in rows])


def apart(one: list[Row], other: list[Row]) -> np.ndarray:
    """Return the (n, 10) differences of two engines' errors over their combined standard deviation.

    Errors are compared instead of estimates, because each engine assembles the drawn legs itself.
    """
    errors = [array(rows, "estimate") - array(rows, "truth") for rows in (one, other)]
    return (errors[0] - errors[1]) / np.hypot(array(one, "sd"), array(other, "sd"))


def held(rows: list[Row]) -> np.ndarray:
    """Return (n, 10) flags of intervals that contain the truth."""
    truth = array(rows, "truth")
    return (array(rows, "lower") <= truth) & (truth <= array(rows, "upper"))


def over_sd(rows: list[Row]) -> np.ndarray:
    """Return the (n, 10) errors over their standard deviations."""
    return (array(rows, "estimate") - array(rows, "truth")) / array(rows, "sd")


def summary(rows: dict[str, Row]) -> list[str]:
    """Return a line for each preset and engine, over all robots."""
    lines = [
        "| | engine | runs | coverage | error / std, rms | largest | difference from MuJoCo / combined std, rms | largest "
        "| failed checks |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for preset, (engine, called) in itertools.product(PRESETS, ENGINES.items()):
        here, first = (
            [row for robot in ROBOTS for row in rows_of(rows, preset, robot, one)] for one in (engine, "mujoco")
        )
        if not here:
            continue
        z, difference = np.abs(over_sd(here)), np.abs(apart(here, first))
        cells = ["-", "-"] if engine == "mujoco" else [f"{rms(difference.ravel()):.2f}", f"{difference.max():.2f}"]
        alarms = sum(bool(row["alarms"]) for row in here)
        lines.append(
            f"| {preset} | {called} | {len(here)} | {held(here).mean():.1%} | {rms(z.ravel()):.2f} | {z.max():.2f} | "
            f"{cells[0]} | {cells[1]} | {alarms} |"
        )
    return lines


def robot_table(rows: dict[str, Row], preset: str) -> list[str]:
    """Return errors and coverage of each quantity."""
    lines = [f"| robot | runs | engine | | {' | '.join(COMPONENTS)} |", "|---|---|---|---|" + "---|" * len(COMPONENTS)]
    for robot, (engine, called) in itertools.product(ROBOTS, ENGINES.items()):
        here = rows_of(rows, preset, robot, engine)
        if here:
            z, inside = rms(over_sd(here)), held(here).sum(axis=0)
            lines.append(
                f"| {robot} | {len(here)} | {called} | error / std, rms | {' | '.join(f'{v:.2f}' for v in z)} |"
            )
            lines.append(f"| | | | covered | {' | '.join(map(str, inside))} |")
    return lines


def run_table(runs: list[Row]) -> list[str]:
    """Return every quantity of one robot in all engines."""
    lines = ["| | " + " | ".join(f"{called} | truth" for called in ENGINES.values()) + " |"]
    lines.append("|---|" + "---|---|" * len(ENGINES))
    for index, name in enumerate(COMPONENTS):
        unit, factor, digits = UNITS[name[0]]
        cells: list[str] = []
        for row in runs:
            low, high, truth, value = (row[key][index] for key in ("lower", "upper", "truth", "estimate"))
            text = f"{factor * value:.{digits}f} ± {factor * (high - low) / 2:.{digits}f}"
            cells += [text if low <= truth <= high else f"**{text}**", f"{factor * truth:.{digits}f}"]
        lines.append(f"| {name} [{unit}] | {' | '.join(cells)} |")
    return lines


def speed_table(rows: dict[str, Row]) -> list[str]:
    lines = ["| robot | robot time | " + " | ".join(ENGINES.values()) + " |", "|---|---|" + "---|" * len(ENGINES)]
    for robot in ROBOTS:
        runs = [rows_of(rows, "realistic", robot, engine) for engine in ENGINES]
        if runs[0]:
            seconds = [f"{np.median([row['cpu_s'] for row in of]):.1f} s" for of in runs]
            robot_time = np.mean([row["robot_time"] for of in runs for row in of])
            lines.append(f"| {robot} | {robot_time:.0f} s | {' | '.join(seconds)} |")
    return lines


def write_tables() -> str:
    rows = load_rows(ROWS)
    failed = [row for row in rows.values() if "failed" in row]
    packages = ("equipoise", "pin", "mujoco", "dartpy", "pybullet")
    versions = ", ".join(f"{name} {version(name)}" for name in packages)
    lacks = "; ".join(
        f"{called} lacks {', '.join(f'`{name}`' for name in names)}"
        for engine, called in ENGINES.items()
        if (names := lacking(engine, "realistic"))
    )
    lines = [ABOUT.format(versions=versions, python=machine.python_version(), lacks=lacks), *summary(rows)]
    for preset in PRESETS:
        lines += ["", f"## `{preset}`, by robot", "", *robot_table(rows, preset)]
    lines += ["", "## One payload of each robot, `realistic`", ""]
    lines += [
        "Estimate and half width of its 95 % interval; bold: it misses the truth. Other seeds are in engines.jsonl."
    ]
    for robot in ROBOTS:
        runs = [rows_of(rows, "realistic", robot, engine) for engine in ENGINES]
        if runs[0]:
            lines += ["", f"### {robot}", "", *run_table([of[0] for of in runs])]
    lines += [
        "",
        "## Computing",
        "",
        "CPU time of a whole calibration on one core of a shared machine, planning and estimating included; median.",
        "",
        *speed_table(rows),
    ]
    if failed:
        lines += ["", "## Failed runs", "", *(f"- {row['key']}: {row['failed']}" for row in failed)]
    text = "\n".join(lines) + "\n"
    write_page("engines.md", text, rows.values())
    return text


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tables", action="store_true", help="write the tables from the existing rows")
    parser.add_argument("--seeds", type=int, default=SEEDS, help="of each robot")
    arguments = parser.parse_args()
    done = load_rows(ROWS)
    with ROWS.open("a", encoding="utf-8") as out:
        for case in [] if arguments.tables else cases(arguments.seeds):
            if key_of(*case) not in done:
                row = run(*case)
                out.write(json.dumps(rounded(row)) + "\n")
                out.flush()
                print(row["key"], row.get("failed", ""), flush=True)
    print(write_tables())


if __name__ == "__main__":
    main()
