"""Influence of single effects on a result, and their detection by checks: `make bench-robustness`.

The preset `realistic` with one additional effect, at half, once and twice its test size on an A1, and once on a Go2 and an
ANYmal C; also the presets `ideal`, `realistic` and `stress` alone. Calibrations use the Bayesian method for 120 s (A1 robot
time), with a payload drawn from the seed and a scale with an error of 0.5 %. An interrupted benchmark resumes from the rows in
benchmarks/results/robustness.jsonl, from which benchmarks/results/robustness.md is written.

    python benchmarks/robustness.py                   # missing runs, then the page
    python benchmarks/robustness.py --first 2         # the first two seeds of every case only
    python benchmarks/robustness.py --only-effects springs    # cases of some effects only
    python benchmarks/robustness.py --keep DIR        # keep the recordings; with --again, estimate kept ones again
    python benchmarks/robustness.py --check 5         # repeat five random rows; fails if one changes
    python benchmarks/robustness.py --check 5 --within 3  # allow three stds: rounding of another processor may change a plan
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import random
import shutil
import sys
import warnings
from collections import Counter
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from functools import cache
from itertools import repeat
from pathlib import Path

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):  # one core per run
    os.environ.setdefault(_name, "1")

import numpy as np
from accuracy import Row, judged, load_rows, payload_of, relative, rms, rounded
from provenance import commit, write_page

from equipoise import (
    BayesianMethod,
    Calibration,
    RobotModel,
    RunFolder,
    calibrate,
    estimate,
    load_robot,
    nominal_stance,
    simulate,
)
from equipoise.errors import EquipoiseError, MissingDependencyError
from equipoise.robot.inertial import RobotInertia
from equipoise.robot.scale import Scale
from equipoise.simulation.effects import IDEAL, REALISTIC, STRESS, EffectSizes

RESULTS = Path(__file__).parent / "results"
ROWS = RESULTS / "robustness.jsonl"
SEEDS = range(10_000, 10_012)
FACTORS = {"unitree_a1": (1.0, 0.5, 2.0), "go2": (1.0,), "anymal_c": (1.0,)}
ALONE = ("ideal", "realistic")  # presets alone, for false alarms
BUDGET = 120.0  # [s] on an A1
SCALE = 0.005  # a scale's error, as a fraction
SILENT = 4.0  # error in standard deviations, without a failed check
MOVED = 0.02  # [std], allowed change of a repeated row
# No effect without springs; an error that checks name (tests/estimator/test_outside_forces.py).
_LEFT_OUT = ("spring_spread", "sling")
# A cable of 0.3 kg hanging from the robot is visible to an operator. No motion distinguishes its weight from the CoM.
_SAID = {"vertical_pull": "heavy"}
EFFECTS = tuple(
    row.name
    for row in EffectSizes.rows()
    if row.size_alone not in (row.realistic, row.none) and row.name not in _LEFT_OUT
)
"""Effects that are smaller in `realistic` or not part of it."""


@dataclass(frozen=True)
class Case:
    """Run of a robot with a scaled effect or a preset. The seed draws payload, effects, sensors and scale."""

    name: str
    factor: float
    robot: str
    seed: int

    @property
    def key(self) -> str:
        return f"{self.robot}/{self.name}/{self.factor:g}/{self.seed}"

    def sizes(self, scale: Scale) -> EffectSizes:
        """Effects of the simulated robot."""
        if self.name in ALONE:
            return {"ideal": IDEAL, "realistic": REALISTIC}[self.name].scaled_to(scale)
        if self.name == "stress":
            varied = [name for name in EFFECTS if EffectSizes.row(name).varied and EffectSizes.row(name).alone is None]
            return STRESS.scaled_to(scale).times(dict.fromkeys((*varied, "spring_spread"), self.factor))
        return REALISTIC.scaled_to(scale).with_effects({self.name: None}, scale).times({self.name: self.factor})


def cases(
    seeds: Sequence[int], only: Sequence[str] = (), robots: Sequence[str] = (), sizes: Sequence[float] = ()
) -> list[Case]:
    """Return all cases, ordered by seed."""
    named = [
        (name, factor, robot)
        for robot, factors in FACTORS.items()
        for factor in factors
        for name in (*ALONE, "stress", *EFFECTS)
        if (factor == 1.0 or name not in ALONE) and (not only or name in only)
        if (not robots or robot in robots) and (not sizes or factor in sizes)
    ]
    return [Case(*which, seed) for seed in seeds for which in named]


@cache
def robot_called(name: str) -> RobotModel:
    return load_robot(name)


def is_there(robot: str) -> bool:
    """Return true if a robot's model is installed."""
    try:
        robot_called(robot)
    except MissingDependencyError:
        return False
    return True


def run(case: Case, keep: Path | None, again: bool) -> Row:
    """One row."""
    warnings.simplefilter("ignore")
    robot = robot_called(case.robot)
    scale = nominal_stance(robot).scale
    generator = np.random.default_rng([case.seed, 77])
    payload = payload_of(robot, generator)
    row: Row = {"key": case.key, **dataclasses.asdict(case), "payload": payload, "commit": commit()}
    try:
        with simulate(robot, case.sizes(scale), payload, case.seed) as simulation:
            truth = simulation.truth
            weighed = truth.composite.mass * (1 + SCALE * generator.standard_normal())
            settings = BayesianMethod(
                duration=BUDGET * scale.time, mass=weighed, mass_std=SCALE * weighed, confirm_mass=True,  # no operator
                cable=_SAID.get(case.name, "light"),
            )  # fmt: skip
            folder = None if keep is None else keep / case.key.replace("/", "-")
            if again and folder is not None and (folder / "truth.json").exists():
                result = estimate(robot, RunFolder.open(folder).recordings(), settings)
            elif folder is None:
                result = calibrate(simulation.platform, robot, settings)
            else:
                result = _kept(simulation.platform, robot, settings, truth, folder)
    except EquipoiseError as error:
        return {**row, "failed": f"{type(error).__name__}: {error}"}
    return row | detected(result.with_truth(truth))


def _kept(
    platform: object, robot: RobotModel, settings: BayesianMethod, truth: RobotInertia, folder: Path
) -> Calibration:
    shutil.rmtree(folder, ignore_errors=True)  # from an interrupted run
    with RunFolder.create(folder, robot, settings, {}) as store:
        store.save_truth(truth)
        return calibrate(platform, robot, settings, store.keep)


def detected(result: Calibration) -> Row:
    """Return the printed estimates and intervals of the whole robot, with the truth."""
    body = list(result.composite)
    return judged(result) | {
        "truth": [quantity.truth for quantity in body],
        "verdict": [quantity.verdict for quantity in body],
        "file_error": [quantity.model - quantity.truth for quantity in body],
        "robot_time": sum(trial.duration for trial in result.trials),
    }


def deviates(row: Row) -> np.ndarray:
    """Return the (10,) errors in standard deviations."""
    return np.array(row["error"]) / np.array(row["sd"])


def is_silent(row: Row) -> bool:
    """Return true for a large error without a failed check."""
    return not row["alarms"] and bool(np.abs(deviates(row)).max() > SILENT)


def fired(rows: Sequence[Row]) -> str:
    """Return the number of runs with a failed check, and the count of each check."""
    alarms = Counter(alarm for row in rows for alarm in row["alarms"])
    names = ", ".join(f"{name} {count}" for name, count in alarms.most_common())
    return f"{sum(bool(row['alarms']) for row in rows)} {names}"


HEAD = (
    "| effect | size | runs | mass % | CoM x, y, z [mm] | Ixx, Iyy, Izz % | file: mass; CoM; I | largest z | coverage | "
    "doubtful | checks | silent |"
)


def line(label: str, size: str, rows: Sequence[Row]) -> str:
    """Return a line of the table."""
    good = [row for row in rows if "failed" not in row]
    runs = f"{len(good)}" if len(good) == len(rows) else f"{len(good)} of {len(rows)}"
    if not good:
        return f"| {label} | {size} | {runs} |" + " - |" * 9
    ours, file = (rms(np.array([relative(row, row[name])[:7] for row in good])) for name in ("error", "file_error"))
    doubtful = np.mean([[verdict == "doubtful" for verdict in row["verdict"]] for row in good])
    worse = ours > file
    cells = [
        f"**{value:.2f}**" if bad and doubtful < 1 else f"{value:.2f}" for value, bad in zip(ours, worse, strict=True)
    ]
    return (
        f"| {label} | {size} | {runs} | {cells[0]} | {' '.join(cells[1:4])} | {' '.join(cells[4:])} | {file[0]:.1f}; "
        f"{' '.join(f'{value:.1f}' for value in file[1:4])}; {' '.join(f'{value:.1f}' for value in file[4:])} | "
        f"{max(np.abs(deviates(row)).max() for row in good):.1f} | {np.mean([row['holds'] for row in good]):.0%} | "
        f"{doubtful:.0%} | {fired(good)} | {sum(map(is_silent, good))} |"
    )


def size_of(name: str, factor: float) -> str:
    """Return the size on an A1 as text."""
    if name in ALONE or name == "stress":
        return f"{factor:g} x"
    effect = EffectSizes.row(name)
    return f"{effect.times(effect.size_alone, factor):.5g} {effect.unit}".strip()


def tables(rows: Sequence[Row]) -> list[str]:
    """Return a table for each robot and factor."""
    text: list[str] = []
    for robot, factors in FACTORS.items():
        for factor in sorted(factors):
            text += ["", f"## {robot}, {factor:g} times the size", "", HEAD, "|" + "---|" * (HEAD.count("|") - 1)]
            for name in (*ALONE, "stress", *EFFECTS):
                of = [row for row in rows if (row["robot"], row["factor"], row["name"]) == (robot, factor, name)]
                text += [line(name, size_of(name, factor), of)] if of else []
    return text


def verdict(rows: Sequence[Row]) -> list[str]:
    """Return the summary and its targets."""
    good = [row for row in rows if "failed" not in row]
    silent = [row for row in good if is_silent(row)]
    text = [f"- Silent runs (an error above {SILENT:g} std without a failed check): **{len(silent)} of {len(good)}**."]
    first = {}
    for row in sorted(silent, key=lambda row: row["factor"]):
        first.setdefault((row["robot"], row["name"]), row["factor"])
    if first:
        sizes = (f"{name} on {robot} at {size_of(name, factor)}" for (robot, name), factor in first.items())
        text.append(f"- Smallest size with a silent run: {'; '.join(sizes)}.")
    for name, factor in (("ideal", 1.0), ("realistic", 1.0), ("stress", 0.5)):
        of = [row for row in good if (row["name"], row["factor"]) == (name, factor)]
        if of:
            detected = sum(bool(row["alarms"]) for row in of)
            text.append(f"- Runs with a failed check, `{name}` at {factor:g} times the size: {detected} of {len(of)}.")
    return text


ABOUT = """# Influence of single effects, and their detection

`make bench-robustness`; {seeds}. The preset `realistic` with one additional effect, a payload drawn from the seed, a scale of
0.5 %, the Bayesian method for 120 s (A1 robot time). Sizes are those on an A1. Errors are root mean square, of the whole
robot; *file*: errors of the model file, without the payload. **Bold**: worse than the file. *Coverage*: share of all ten
printed 95 % intervals that contain the truth; all runs count. Runs with a vertical force use `--cable heavy`. *Doubtful*:
share of values with this verdict. *Checks*: number of runs with a failed check, and its names. *Silent*: runs with an error
above {silent:g} standard deviations and no failed check.
"""


def page(rows: Sequence[Row]) -> str:
    """The page."""
    used = sorted({int(str(row["seed"])) for row in rows})
    about = ABOUT.format(seeds=f"seeds {used[0]} to {used[-1]}", silent=SILENT)
    failed = [f"- {row['key']}: {row['failed']}" for row in rows if "failed" in row]
    return "\n".join(
        [about, *verdict(rows), *tables(rows), *(["", "Ended by name:", "", *failed] if failed else []), ""]
    )


def moved(case: Case, before: Row, within: float) -> str | None:
    """Return the difference of a repeated row; None if it is within the given standard deviations."""
    now = rounded(run(case, None, again=False))
    if "failed" in before or "failed" in now:
        return None if before.get("failed") == now.get("failed") else f"{before.get('failed')} -> {now.get('failed')}"
    change = np.abs(np.array(now["error"]) - np.array(before["error"])) / np.array(before["sd"])
    return None if change.max() < within else f"by {change.max():.2f} sd"


def check(rows: dict[str, Row], count: int, within: float) -> int:
    """Repeat some rows of installed robots; return the number that changed."""
    there = sorted(key for key, row in rows.items() if is_there(str(row["robot"])))
    chosen = [rows[key] for key in random.sample(there, min(count, len(there)))]
    fields = [field.name for field in dataclasses.fields(Case)]
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        found = list(
            pool.map(moved, [Case(**{name: row[name] for name in fields}) for row in chosen], chosen, repeat(within))
        )
    for row, how in zip(chosen, found, strict=True):
        print(row["key"], how or "as before", flush=True)
    return sum(how is not None for how in found)


def made(missing: Iterable[Case], keep: Path | None, again: bool) -> Iterable[Row]:
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        for future in as_completed([pool.submit(run, case, keep, again) for case in missing]):
            yield rounded(future.result())


def main() -> None:
    """Run missing cases, then write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--first", type=int, default=len(SEEDS), metavar="N", help="number of seeds per case")
    parser.add_argument("--only-effects", nargs="*", default=[], metavar="EFFECT", help="effects and presets")
    parser.add_argument("--robots", nargs="*", default=[], metavar="ROBOT", help="robots; default all three")
    parser.add_argument("--sizes", nargs="*", type=float, default=[], metavar="FACTOR", help="factors on the sizes")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="folder for recordings")
    parser.add_argument("--again", action="store_true", help="estimate kept recordings again")
    parser.add_argument("--tables", action="store_true", help="the page only")
    parser.add_argument("--check", type=int, metavar="N", help="repeat N rows and compare")
    parser.add_argument("--within", type=float, default=MOVED, metavar="SD", help="allowed difference [std]")
    given = parser.parse_args()
    rows = load_rows(ROWS)
    if given.check:
        sys.exit(check(rows, given.check, given.within))
    wanted = [] if given.tables else cases(SEEDS[: given.first], given.only_effects, given.robots, given.sizes)
    for row in made([case for case in wanted if given.again or case.key not in rows], given.keep, given.again):
        rows[str(row["key"])] = row
        with ROWS.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")
        print(
            row["key"], row.get("failed") or f"largest z {np.abs(deviates(row)).max():.1f} {row['alarms']}", flush=True
        )
    write_page("robustness.md", page(list(rows.values())), rows.values())
    print(*verdict(list(rows.values())), sep="\n")


if __name__ == "__main__":
    main()
