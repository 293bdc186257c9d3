"""Regression test of numeric results: `python benchmarks/same_numbers.py compare FOLDER`.

First run `python benchmarks/same_numbers.py make FOLDER` with the old code. It runs these commands on three robots: calibrate
with each method, compare, balance, export, and estimate from the run's log as a foreign log. With the new code, `compare`
estimates from the stored recordings, repeats everything else, and prints the difference of each number, in standard
deviations of the run if available, else relative to its size.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROBOTS = {"unitree_a1": "1.2,0.08,-0.02,0.09", "laikago": "2,0.05,0.03,0.1", "solo12": "0.3,0.03,0.01,0.05"}
METHODS = ("bayesian", "paper", "static")
FORMATS = ("json", "quadruped-pympc", "mit-cheetah", "mjlab", "sdf", "xacro")
BODIES = ("composite", "base")
ROUNDING, WORTH_SHOWING = 1e-9, 0.05  # of a standard deviation


def equipoise(*arguments: object, fails: bool = False) -> str:
    """Return the output of a command."""
    command = [sys.executable, "-m", "equipoise", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode and not fails:
        raise SystemExit(f"{' '.join(command)}: {done.stderr}")
    return done.stdout


def calibrations(folder: Path) -> Iterator[tuple[Path, list[object]]]:
    """Return run folders and their commands."""
    for robot, payload in ROBOTS.items():
        for method in METHODS:
            made: list[object] = [
                "calibrate",
                robot,
                "--method",
                method,
                "--seed",
                7,
                "--quiet",
                "--no-report",
            ]
            yield folder / f"{robot}-{method}", made
        yield folder / f"{robot}-bayesian-payload", [*made[:2], "--payload", payload, *made[4:]]


def others(folder: Path, out: Path) -> None:
    """Compute all results of the stored runs in another folder."""
    out.mkdir(parents=True, exist_ok=True)
    for run, _ in calibrations(folder):
        (out / f"estimate-{run.name}.json").write_text(equipoise("estimate", run, "--json", "--quiet", "--no-report"))
    for robot in ROBOTS:
        plain, loaded = folder / f"{robot}-bayesian", folder / f"{robot}-bayesian-payload"
        (out / f"delta-{robot}.json").write_text(equipoise("compare", plain, loaded, "--json", "--quiet"))
        log = next(plain.glob("*.mcap"))
        output = equipoise("estimate", log, "--robot", robot, "--json", "--quiet", "--no-report", fails=True)
        (out / f"log-{robot}.json").write_text(output or "{}")
        output = equipoise(
            "balance", robot, "--com", plain / "calibration.json", "--seed", 7, "--duration", "3s", "--json", fails=True
        )
        (out / f"balance-{robot}.json").write_text(output or "{}")
        for name in FORMATS:
            to = out / f"export-{robot}-{name}"
            equipoise("export", plain, "--to", name, "--force", "--out", to, "--quiet", fails=True)


def numbers(what: Any, name: str = "") -> Iterator[tuple[str, float]]:
    """Yield all numbers of a JSON value with their paths."""
    if isinstance(what, bool) or what is None:
        return
    if isinstance(what, (int, float)):
        yield name, float(what)
    elif isinstance(what, dict):
        for key, value in what.items():
            yield from numbers(value, f"{name}.{key}")
    elif isinstance(what, list):
        for index, value in enumerate(what):
            yield from numbers(value, f"{name}[{index}]")


def numbers_of(path: Path) -> tuple[dict[str, float], dict[str, float]]:
    """Return a file's numbers, and the standard deviations of some."""
    text = path.read_text()
    if path.suffix != ".json":
        found = re.findall(r"-?\d+\.\d+(?:[eE][-+]?\d+)?", text)
        return {str(index): float(value) for index, value in enumerate(found)}, {}
    table = json.loads(text)
    if "composite" not in table or "trials" not in table:
        table.pop("provenance", None)
        return dict(numbers({key: value for key, value in table.items() if key not in ("schema", "timings")})), {}
    values, stds = {}, {}
    for body in BODIES:
        parts = table[body]
        values |= dict(numbers({key: parts[key] for key in ("mass", "com_in_base", "inertia")}, body))
        spread = covariance(table, body)
        if spread is not None:
            sd = [spread[index][index] ** 0.5 for index in range(10)]
            rows = ((4, 7, 8), (7, 5, 9), (8, 9, 6))  # indices of Ixx, Iyy, Izz, Ixy, Ixz, Iyz after mass and CoM
            stds[f"{body}.mass"] = sd[0]
            stds |= {f"{body}.com_in_base[{axis}]": sd[1 + axis] for axis in range(3)}
            stds |= {f"{body}.inertia[{i}][{j}]": sd[rows[i][j]] for i in range(3) for j in range(3)}
    return values, stds


def covariance(table: dict[str, Any], body: str) -> list[list[float]] | None:
    """Return the covariance of a body's ten parameters in any schema."""
    of_body = table.get("uncertainty", {}).get(body) or table[body].get("uncertainty")  # schema 2, schema 3
    return of_body["covariance"] if of_body else None


def compare(before: Path, now: Path) -> tuple[int, float, float]:
    """Return the number of numbers, and their largest difference, relative and in standard deviations."""
    (old, sd), (new, _) = numbers_of(before), numbers_of(now)
    missing = sorted(set(old) ^ set(new))
    if missing:
        print(f"    {len(missing)} numbers on one side only: {', '.join(missing[:6])}")
    shared = sorted(set(old) & set(new))
    relative = max((abs(new[key] - old[key]) / max(abs(old[key]), 1e-6) for key in shared), default=0.0)
    stds = max((abs(new[key] - old[key]) / sd[key] for key in shared if sd.get(key)), default=0.0)
    return len(shared), relative, stds


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("make", "compare"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--again", action="store_true", help="compare: also repeat the calibrations")
    asked = parser.parse_args()
    folder: Path = asked.folder
    if asked.what == "make":
        for run, made in calibrations(folder):
            if not (run / "calibration.json").exists():
                equipoise(*made, "--out", run)
        others(folder, folder / "made")
        return 0
    out = folder / "compared"
    others(folder, out)
    pairs = [(path, out / path.name) for path in sorted((folder / "made").iterdir())]
    if asked.again:
        for run, made in calibrations(folder):
            equipoise(*made, "--out", again := out / run.name)
            pairs.append((run / "calibration.json", again / "calibration.json"))
    different = 0
    print("| result | numbers | largest relative difference | in standard deviations |\n|---|---|---|---|")
    for before, now in pairs:
        count, relative, stds = compare(before, now)
        different += (relative > ROUNDING and stds == 0) or stds > WORTH_SHOWING
        name = before.parent.name if before.name == "calibration.json" else before.name
        print(f"| {name} | {count} | {relative:.1e} | {stds:.1e} |")
    return int(different > 0)


if __name__ == "__main__":
    sys.exit(main())
