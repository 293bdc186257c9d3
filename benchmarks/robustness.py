"""What each effect of the world does to a result, and whether anybody is told: `make bench-robustness`.

The preset `realistic` with one effect of the table besides (docs/simulation-studies.md), at half,
once and twice the size that it is
tried with on an A1 and once on a Go2 and an ANYmal C; the presets `ideal` and `realistic` alone, and `stress`; by the precise
method for 120 s of an A1's robot time, with a payload drawn from the seed and a scale that errs by 0.5 %. Each run appends a
row to benchmarks/results/robustness.jsonl: interrupted, it goes on where it was. benchmarks/results/robustness.md is made from
the rows.

    python benchmarks/robustness.py                   # what is missing, then the page
    python benchmarks/robustness.py --first 2         # the first two seeds of every case only
    python benchmarks/robustness.py --only-effects springs    # cases of some effects only
    python benchmarks/robustness.py --keep DIR        # keep the recordings; with --again, estimate kept ones anew
    python benchmarks/robustness.py --check 5         # five rows at random again; fails if one moved
    python benchmarks/robustness.py --check 5 --within 3  # by three deviations: another processor's rounding may change a plan
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
from equipoise.simulation.effects import IDEAL, REALISTIC, STRESS, SensorErrors

RESULTS = Path(__file__).parent / "results"
ROWS = RESULTS / "robustness.jsonl"
SEEDS = range(10_000, 10_012)
FACTORS = {"unitree_a1": (1.0, 0.5, 2.0), "go2": (1.0,), "anymal_c": (1.0,)}
ALONE = ("ideal", "realistic")  # presets as they are, for false alarms
BUDGET = 120.0  # [s] on an A1
SCALE = 0.005  # a scale's error, as a fraction
SILENT = 4.0  # standard deviations off, with every check green
MOVED = 0.02  # standard deviations, by which a row made again may differ
# Nothing without springs; a mistake, which checks name (tests/estimator/test_outside_forces.py).
_LEFT_OUT = ("spring_spread", "sling")
# An operator sees a cable of 0.3 kg that hangs from the robot. No motion distinguishes its weight from the CoM.
_SAID = {"vertical_pull": "heavy"}
EFFECTS = tuple(
    row.name
    for row in SensorErrors.rows()
    if row.by_itself not in (row.realistic, row.none) and row.name not in _LEFT_OUT
)
"""Those that `realistic` does not have, or has smaller."""


@dataclass(frozen=True)
class Case:
    """One run: an effect or a preset, so many times, on a robot; the seed draws payload, world, sensors and scale."""

    name: str
    factor: float
    robot: str
    seed: int

    @property
    def key(self) -> str:
        return f"{self.robot}/{self.name}/{self.factor:g}/{self.seed}"

    def sizes(self, scale: Scale) -> SensorErrors:
        """What the simulated robot has."""
        if self.name in ALONE:
            return {"ideal": IDEAL, "realistic": REALISTIC}[self.name].scaled_to(scale)
        if self.name == "stress":
            varied = [
                name for name in EFFECTS if SensorErrors.row(name).varied and SensorErrors.row(name).alone is None
            ]
            return STRESS.scaled_to(scale).times(dict.fromkeys((*varied, "spring_spread"), self.factor))
        return REALISTIC.scaled_to(scale).having({self.name: None}, scale).times({self.name: self.factor})


def cases(
    seeds: Sequence[int], only: Sequence[str] = (), robots: Sequence[str] = (), sizes: Sequence[float] = ()
) -> list[Case]:
    """All of them, seed by seed: half a benchmark is a smaller one."""
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
    """Whether a robot's model is installed."""
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
                duration=BUDGET * scale.time, mass=weighed, mass_std=SCALE * weighed, confirm_mass=True,  # no one to ask
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
    return row | told(result.with_truth(truth))


def _kept(
    platform: object, robot: RobotModel, settings: BayesianMethod, truth: RobotInertia, folder: Path
) -> Calibration:
    shutil.rmtree(folder, ignore_errors=True)  # of a run that was cut short
    with RunFolder.create(folder, robot, settings, {}) as store:
        store.save_truth(truth)
        return calibrate(platform, robot, settings, store.keep)


def told(result: Calibration) -> Row:
    """What a user reads of the whole robot, beside the truth; every interval is the one that is printed."""
    body = list(result.composite)
    return judged(result) | {
        "truth": [quantity.truth for quantity in body],
        "verdict": [quantity.verdict for quantity in body],
        "file_error": [quantity.model - quantity.truth for quantity in body],
        "robot_time": sum(trial.duration for trial in result.trials),
    }


def deviates(row: Row) -> np.ndarray:
    """(10,) errors in standard deviations."""
    return np.array(row["error"]) / np.array(row["sd"])


def is_silent(row: Row) -> bool:
    """Whether something is far off and no check says so."""
    return not row["alarms"] and bool(np.abs(deviates(row)).max() > SILENT)


def fired(rows: Sequence[Row]) -> str:
    """In how many runs a check fired, and which how often."""
    alarms = Counter(alarm for row in rows for alarm in row["alarms"])
    names = ", ".join(f"{name} {count}" for name, count in alarms.most_common())
    return f"{sum(bool(row['alarms']) for row in rows)} {names}"


HEAD = (
    "| effect | size | runs | mass % | CoM x, y, z [mm] | Ixx, Iyy, Izz % | file: mass; CoM; I | largest z | hold | "
    "doubtful | checks | silent |"
)


def line(label: str, size: str, rows: Sequence[Row]) -> str:
    """A line of the table."""
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
    """The size on an A1 in words."""
    if name in ALONE or name == "stress":
        return f"{factor:g} x"
    effect = SensorErrors.row(name)
    return f"{effect.times(effect.by_itself, factor):.5g} {effect.unit}".strip()


def tables(rows: Sequence[Row]) -> list[str]:
    """A table for each robot and factor."""
    text: list[str] = []
    for robot, factors in FACTORS.items():
        for factor in sorted(factors):
            text += ["", f"## {robot}, {factor:g} times the size", "", HEAD, "|" + "---|" * (HEAD.count("|") - 1)]
            for name in (*ALONE, "stress", *EFFECTS):
                of = [row for row in rows if (row["robot"], row["factor"], row["name"]) == (robot, factor, name)]
                text += [line(name, size_of(name, factor), of)] if of else []
    return text


def verdict(rows: Sequence[Row]) -> list[str]:
    """The figures that were asked for."""
    good = [row for row in rows if "failed" not in row]
    silent = [row for row in good if is_silent(row)]
    text = [f"- Silent runs (an error above {SILENT:g} sd with every check green): **{len(silent)} of {len(good)}**."]
    first = {}
    for row in sorted(silent, key=lambda row: row["factor"]):
        first.setdefault((row["robot"], row["name"]), row["factor"])
    if first:
        sizes = (f"{name} on {robot} at {size_of(name, factor)}" for (robot, name), factor in first.items())
        text.append(f"- Smallest size at which a run is silent: {'; '.join(sizes)}.")
    for name, factor in (("ideal", 1.0), ("realistic", 1.0), ("stress", 0.5)):
        of = [row for row in good if (row["name"], row["factor"]) == (name, factor)]
        if of:
            told = sum(bool(row["alarms"]) for row in of)
            text.append(f"- A check fires on `{name}` at {factor:g} times the size: {told} of {len(of)}.")
    return text


ABOUT = """# What the world does to a result, and whether anybody is told

`make bench-robustness`; {seeds}. The preset `realistic` with one effect besides, a
payload drawn from the seed, a scale of 0.5 %, the Bayesian method, 120 s of an A1's robot time. Sizes are an A1's; what they
are and why is in [docs/simulation-studies.md](../../docs/simulation-studies.md). Errors are root mean square,
of the whole robot; *file*:
the same of the model file, which does not know the payload. **Bold**: worse than the file. *Hold*: share of all ten 95 %
intervals, as printed, that hold the truth; all runs count. Runs with a
vertical pull state `--cable heavy`. *Doubtful*: share of the values whose verdict says so. *Checks*:
runs in which one fired, and which. *Silent*: runs with an error above {silent:g} standard deviations and no check.
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
    """By what a row differs from the same made again; None: by no more than so many standard deviations."""
    now = rounded(run(case, None, again=False))
    if "failed" in before or "failed" in now:
        return None if before.get("failed") == now.get("failed") else f"{before.get('failed')} -> {now.get('failed')}"
    change = np.abs(np.array(now["error"]) - np.array(before["error"])) / np.array(before["sd"])
    return None if change.max() < within else f"by {change.max():.2f} sd"


def check(rows: dict[str, Row], count: int, within: float) -> int:
    """Some rows again, of robots that are installed; the number that moved."""
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
    """What is missing, then the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--first", type=int, default=len(SEEDS), metavar="N", help="seeds of every case")
    parser.add_argument("--only-effects", nargs="*", default=[], metavar="EFFECT", help="effects and presets")
    parser.add_argument("--robots", nargs="*", default=[], metavar="ROBOT", help="robots, by default all three")
    parser.add_argument("--sizes", nargs="*", type=float, default=[], metavar="FACTOR", help="factors on the sizes")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="folder for recordings")
    parser.add_argument("--again", action="store_true", help="estimate kept recordings again")
    parser.add_argument("--tables", action="store_true", help="the page only")
    parser.add_argument("--check", type=int, metavar="N", help="make N rows again and compare")
    parser.add_argument("--within", type=float, default=MOVED, metavar="SD", help="by which they may differ")
    given = parser.parse_args()
    rows = load_rows(ROWS)
    if given.check:
        sys.exit(check(rows, given.check, given.within))
    wanted = [] if given.tables else cases(SEEDS[: given.first], given.only, given.robots, given.sizes)
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
