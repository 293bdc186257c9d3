"""Does the routine find in DART what it finds in MuJoCo? `make bench-engines`.

Robots with a payload and the preset `realistic` are calibrated by `precise` in both engines; a seed draws the same payload
and the same errors for both. Every run appends a row to benchmarks/results/engines.jsonl, so that an interrupted benchmark
goes on where it was; benchmarks/results/engines.md is made from the rows. All is seeded.

    python benchmarks/engines.py             # what is missing, then the tables
    python benchmarks/engines.py --seeds 2   # the first seeds only
    python benchmarks/engines.py --tables    # the tables only
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import platform as machine
import time
import warnings
from pathlib import Path

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):  # one core per run
    os.environ.setdefault(_name, "1")

import dartpy
import mujoco
import numpy as np
import pinocchio as pin
from accuracy import payload_of, rms, rounded
from commit import commit, made_at

import equipoise
from equipoise import calibrate, load_robot, simulate
from equipoise.errors import EquipoiseError
from equipoise.result.statistics import NORMAL_95
from equipoise.robot.inertial import COMPONENTS, components

RESULTS = Path(__file__).parent / "results"
ROWS = RESULTS / "engines.jsonl"
ROBOTS = ("unitree_a1", "go2", "solo12", "anymal_c")
ENGINES = {"mujoco": "MuJoCo", "dart": "DART"}
FIRST, SEEDS = 10_000, 5  # first seed, and how many
UNITS = {"m": ("kg", 1.0, 3), "c": ("mm", 1e3, 2), "I": ("kg m2", 1.0, 4)}  # by a component's first letter


def run(name: str, seed: int, engine: str) -> dict[str, object]:
    """One row."""
    warnings.simplefilter("ignore")
    robot = load_robot(name)
    payload = payload_of(robot, np.random.default_rng([seed, 77]))
    row: dict[str, object] = {"key": f"{name}/{seed}/{engine}", "robot": name, "seed": seed, "engine": engine}
    row["commit"] = commit()
    begin = time.process_time()
    try:
        with simulate(robot, "realistic", payload, seed, engine=engine) as simulation:
            result = calibrate(simulation.platform, robot)
    except EquipoiseError as error:
        return {**row, "failed": f"{type(error).__name__}: {error}"}
    taken = time.process_time() - begin
    return {
        **row,
        "payload": payload,
        "truth": components(simulation.truth.composite).tolist(),
        "estimate": result.composite.values.tolist(),
        "sd": result.composite.deviations.tolist(),
        "lower": [quantity.lower for quantity in result.composite],
        "upper": [quantity.upper for quantity in result.composite],
        "robot_time": sum(trial.duration for trial in result.trials),
        "cpu_s": taken,
        "warnings": list(result.warnings),
    }


def load_rows() -> dict[str, dict]:
    if not ROWS.exists():
        return {}
    rows = [json.loads(line) for line in ROWS.read_text(encoding="utf-8").splitlines() if line.strip()]
    return {row["key"]: row for row in rows}


def pairs_of(rows: dict[str, dict], robot: str) -> list[tuple[dict, dict]]:
    """What both engines finished, MuJoCo's row first."""
    seeds = sorted({row["seed"] for row in rows.values() if row["robot"] == robot})
    found = [tuple(rows.get(f"{robot}/{seed}/{engine}", {"failed": ""}) for engine in ENGINES) for seed in seeds]
    return [(one, other) for one, other in found if "failed" not in one and "failed" not in other]


def array(pairs: list[tuple[dict, dict]], engine: int, name: str) -> np.ndarray:
    """(n, 10) of one engine's rows."""
    return np.array([pair[engine][name] for pair in pairs])


def differences(pairs: list[tuple[dict, dict]]) -> np.ndarray:
    """(n, 10) DART's estimate less MuJoCo's, over both standard deviations together."""
    apart = array(pairs, 1, "estimate") - array(pairs, 0, "estimate")
    return apart / np.hypot(array(pairs, 0, "sd"), array(pairs, 1, "sd"))


def held(pairs: list[tuple[dict, dict]], engine: int) -> np.ndarray:
    """(n, 10) whether the interval holds the truth."""
    truth = array(pairs, engine, "truth")
    return (array(pairs, engine, "lower") <= truth) & (truth <= array(pairs, engine, "upper"))


def agreement_table(rows: dict[str, dict]) -> list[str]:
    lines = [f"| robot | n | | {' | '.join(COMPONENTS)} |", "|---|---|---|" + "---|" * len(COMPONENTS)]
    for robot in ROBOTS:
        pairs = pairs_of(rows, robot)
        if not pairs:
            continue
        apart = differences(pairs)
        parts: list[tuple[str, list[str]]] = [
            ("DART - MuJoCo over both sd, rms", [f"{value:.2f}" for value in rms(apart)]),
            ("largest", [f"{value:.2f}" for value in np.abs(apart).max(axis=0)]),
        ]
        for index, engine in enumerate(ENGINES.values()):
            error = (array(pairs, index, "estimate") - array(pairs, index, "truth")) / array(pairs, index, "sd")
            parts.append((f"{engine}: error over sd, rms", [f"{value:.2f}" for value in rms(error)]))
            inside = held(pairs, index).sum(axis=0)
            parts.append((f"{engine}: intervals that hold the truth", [f"{count} of {len(pairs)}" for count in inside]))
        for place, (label, cells) in enumerate(parts):
            first = f"{robot} | {len(pairs)}" if place == 0 else " | "
            lines.append(f"| {first} | {label} | {' | '.join(cells)} |")
    return lines


def run_table(pair: tuple[dict, dict]) -> list[str]:
    """Every quantity of one robot in both engines."""
    lines = ["| | truth | MuJoCo | DART | difference over both sd |", "|---|---|---|---|---|"]
    apart = differences([pair])[0]
    for index, name in enumerate(COMPONENTS):
        unit, factor, digits = UNITS[name[0]]
        cells = []
        for row in pair:
            half = (row["upper"][index] - row["lower"][index]) / 2
            missed = not row["lower"][index] <= row["truth"][index] <= row["upper"][index]
            text = f"{factor * row['estimate'][index]:.{digits}f} ± {factor * half:.{digits}f}"
            cells.append(f"**{text}**" if missed else text)
        truth = f"{factor * pair[0]['truth'][index]:.{digits}f}"
        lines.append(f"| {name} [{unit}] | {truth} | {' | '.join(cells)} | {apart[index]:+.2f} |")
    return lines


def speed_table(rows: dict[str, dict]) -> list[str]:
    lines = ["| robot | robot time | " + " | ".join(ENGINES.values()) + " |", "|---|---|---|---|"]
    for robot in ROBOTS:
        pairs = pairs_of(rows, robot)
        if pairs:
            seconds = [np.median([pair[index]["cpu_s"] for pair in pairs]) for index in range(2)]
            robot_time = np.mean([row["robot_time"] for pair in pairs for row in pair])
            lines.append(f"| {robot} | {robot_time:.0f} s | {seconds[0]:.1f} s | {seconds[1]:.1f} s |")
    return lines


def write_tables() -> str:
    rows = load_rows()
    pairs = [pair for robot in ROBOTS for pair in pairs_of(rows, robot)]
    apart = np.abs(differences(pairs))
    inside = [float(held(pairs, index).mean()) for index in range(2)]
    failed = [row for row in rows.values() if "failed" in row]
    told = {
        engine: sum(bool(pair[index]["warnings"]) for pair in pairs) for index, engine in enumerate(ENGINES.values())
    }
    lines = [
        "# The same routine in two engines",
        "",
        f"`make bench-engines`; equipoise {equipoise.__version__}, Pinocchio {pin.__version__}, MuJoCo {mujoco.__version__}, "
        f"DART {dartpy.__version__}, Python {machine.python_version()}. Method `precise`, preset `realistic`, no scale; "
        "random payloads of 5 to 30 % of the base's mass. A seed draws the same payload, sensors, motors and floor for both "
        "engines; contact, joint friction and integration are each engine's own. Whole robot at the nominal stance.",
        "",
        f"Of {apart.size} quantities in {len(pairs)} pairs of runs the engines differ by less than {NORMAL_95} of both "
        f"standard deviations together in {np.mean(apart < NORMAL_95):.1%}, rms {rms(apart.ravel()):.2f}, at most "
        f"{apart.max():.2f}. "
        f"The 95 % intervals hold the truth in {inside[0]:.1%} (MuJoCo) and {inside[1]:.1%} (DART). Checks found something in "
        + " and ".join(f"{count} of {len(pairs)} runs in {engine}" for engine, count in told.items()) + ".",
        "",
        *agreement_table(rows),
        "",
        "## One payload of each robot",
        "",
        "Estimate and half of its 95 % interval; bold: it does not hold the truth. Other seeds are in engines.jsonl.",
    ]  # fmt: skip
    for robot in ROBOTS:
        if found := pairs_of(rows, robot):
            lines += ["", f"### {robot}", "", *run_table(found[0])]
    lines += [
        "",
        "## Computing",
        "",
        "CPU time of a whole calibration on one core of a machine that ran other things too, planning and estimating "
        "included; median.",
        "",
        *speed_table(rows),
    ]
    if failed:
        lines += ["", "## Runs that failed", "", *(f"- {row['key']}: {row['failed']}" for row in failed)]
    text = "\n".join([*lines, "", made_at(rows.values())]) + "\n"
    (RESULTS / "engines.md").write_text(text, encoding="utf-8")
    return text


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tables", action="store_true", help="make the tables from the rows there are")
    parser.add_argument("--seeds", type=int, default=SEEDS, help="of each robot")
    arguments = parser.parse_args()
    if not arguments.tables:
        done = load_rows()
        with ROWS.open("a", encoding="utf-8") as out:
            for seed, robot, engine in itertools.product(range(FIRST, FIRST + arguments.seeds), ROBOTS, ENGINES):
                if f"{robot}/{seed}/{engine}" not in done:
                    row = run(robot, seed, engine)
                    out.write(json.dumps(rounded(row)) + "\n")
                    out.flush()
                    print(row["key"], row.get("failed", ""), flush=True)
    print(write_tables())


if __name__ == "__main__":
    main()
