"""Balance on two feet against the error of the controller's CoM: `make bench-balance`.

Simulated robots with the preset `realistic` stand on a diagonal for 10 s with a fixed controller. Every run appends a row to
benchmarks/results/balance.jsonl, so that an interrupted benchmark can be resumed. The tables and the figure,
benchmarks/results/balance.md and balance.png, are written from the rows. Everything is seeded.

    python benchmarks/balance.py             # missing runs, then tables and figure
    python benchmarks/balance.py --seeds 3   # the first seeds only
    python benchmarks/balance.py --tables    # tables and figure only
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import platform as machine
import warnings
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from functools import cache
from pathlib import Path

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):  # one core per run
    os.environ.setdefault(_name, "1")

import mujoco
import numpy as np
import pinocchio as pin
from matplotlib.figure import Figure
from provenance import commit, write_page
from scipy.stats import beta

import equipoise
from equipoise import calibrate, load_robot, nominal_stance, simulate
from equipoise.errors import EquipoiseError
from equipoise.lab.balance.balance_routine import BalanceSettings, balance
from equipoise.lab.balance.evaluation import Verdict, evaluate
from equipoise.lab.balance.model_error import DesignModel, calibrated, displaced, error_along, model_file
from equipoise.lab.balance.observer import SensorCorrections
from equipoise.method.table import method_named
from equipoise.robot.model import DIAGONALS
from equipoise.simulation.ground_truth_view import GroundTruthRecorder
from equipoise.simulation.simulation import Simulation

RESULTS = Path(__file__).parent / "results"
ROWS = RESULTS / "balance.jsonl"
ROBOTS = ("unitree_a1", "go2", "solo12")
SIZES = (0, 2, 3, 4, 5, 6, 8, 10, 15, 20)  # [mm]
ERRORS = tuple(sorted({sign * size for size in SIZES for sign in (-1, 1)}))
OBSERVED = (-5, -2, 0, 2, 5)  # [mm]
PAPER = 5.0  # [mm], error that the paper's balance controller tolerates
SEEDS = {"known": 6, "unknown": 3, "observe": 3, "payload": 3}
FIRST = 10_000  # seeds below are for development
# Off the centre of the back; payloads of go2 and solo12 are the A1's 2 kg in proportion to mass and size.
PAYLOADS = {
    "unitree_a1": ("1,0.08,0.03,0.1", "2,0.08,0.03,0.1", "3,0.08,0.03,0.1"),
    "go2": ("2.6,0.085,0.032,0.105",),
    "solo12": ("0.4,0.062,0.023,0.078",),
}
MODELS = ("model file", "planar CoM (paper)", "everything (bayesian)")


@dataclass(frozen=True)
class Case:
    """Job: one run of a sweep (error in mm), or all runs with one payload."""

    kind: str
    robot: str
    seed: int
    diagonal: str = ""
    error: float = 0.0
    payload: str = ""

    @property
    def key(self) -> str:
        return "/".join((self.kind, self.robot, self.diagonal or self.payload, f"{self.error:g}", str(self.seed)))


def cases(seeds: int) -> list[Case]:
    """Return all cases, ordered by seed."""
    found: list[Case] = []
    for kind, count in SEEDS.items():
        for robot in ROBOTS:
            for seed in range(FIRST, FIRST + min(seeds, count)):
                if kind == "payload":
                    found += [Case(kind, robot, seed, payload=payload) for payload in PAYLOADS[robot]]
                    continue
                errors = OBSERVED if kind == "observe" else ERRORS
                found += [Case(kind, robot, seed, diagonal, error) for diagonal in DIAGONALS for error in errors]
    return sorted(found, key=lambda case: (case.seed, list(SEEDS).index(case.kind)))


@cache
def robot_called(name: str) -> equipoise.RobotModel:
    return load_robot(name)


def stand(
    robot: equipoise.RobotModel, simulation: Simulation, design: DesignModel, diagonal: str, settings: BalanceSettings
) -> dict[str, object]:
    """Do one balance trial; return its numbers, lengths in mm, angles in degrees."""
    recorder = GroundTruthRecorder(simulation.truth_view.look, 5)
    run = balance(simulation.platform, robot, design.model, diagonal, settings, design.sensors, recorder.watch)
    verdict: Verdict = evaluate(run, recorder.ground_truths)
    error = error_along(nominal_stance(robot), diagonal, design.model, simulation.truth)
    return {
        "balanced": verdict.balanced,
        "time": round(verdict.time_balanced, 2),
        "failure": verdict.failure,
        "model_error": round(1000 * error, 2),
        "com_std": None if verdict.com_std is None else round(1000 * verdict.com_std, 3),
        "tilt": round(float(np.degrees(verdict.tilt)), 2),
        "torque": None if verdict.largest_torque is None else round(verdict.largest_torque, 1),
        "observed_error": None if verdict.observed_error is None else round(1000 * verdict.observed_error, 2),
    }


def run(case: Case) -> dict[str, object]:
    """Return the row of a case."""
    warnings.simplefilter("ignore")
    row: dict[str, object] = {"key": case.key, **dataclasses.asdict(case), "commit": commit()}
    try:
        return {**row, **(payload_study(case) if case.kind == "payload" else sweep(case))}
    except EquipoiseError as error:
        return {**row, "failed": f"{type(error).__name__}: {error}"}


def sweep(case: Case) -> dict[str, object]:
    """Balance with the truth displaced, with or without correction of the sensor errors."""
    robot = robot_called(case.robot)
    with simulate(robot, "realistic", seed=case.seed) as simulation:
        design = displaced(robot, nominal_stance(robot), simulation.truth, case.diagonal, case.error / 1000)
        if case.kind != "unknown":
            drawn = simulation.errors
            corrections = SensorCorrections(drawn.joint_offset, drawn.imu_tilt, drawn.accelerometer_bias)
            design = dataclasses.replace(design, sensors=corrections)
        settings = BalanceSettings(observe_offset=case.kind == "observe")
        return stand(robot, simulation, design, case.diagonal, settings)


def payload_study(case: Case) -> dict[str, object]:
    """Balance before and after calibrations of the same robot with the same payload."""
    robot = robot_called(case.robot)
    stance = nominal_stance(robot)
    designs = [model_file(robot)]
    for method in ("paper", "bayesian"):
        with simulate(robot, "realistic", case.payload, case.seed) as simulation:
            designs.append(calibrated(robot, stance, calibrate(simulation.platform, robot, method_named(method)())))
    trials: dict[str, dict[str, object]] = {}
    for name, design in zip(MODELS, designs, strict=True):
        trials[name] = {}
        for diagonal in DIAGONALS:
            with simulate(robot, "realistic", case.payload, case.seed) as simulation:
                trials[name][diagonal] = stand(robot, simulation, design, diagonal, BalanceSettings())
    return {"trials": trials}


def load_rows() -> dict[str, dict]:
    if not ROWS.exists():
        return {}
    rows = [json.loads(line) for line in ROWS.read_text(encoding="utf-8").splitlines() if line.strip()]
    return {row["key"]: row for row in rows}


def interval(successes: int, count: int) -> tuple[float, float]:
    """Return the 95 % interval of a binomial probability (Jeffreys)."""
    low = 0.0 if successes == 0 else beta.ppf(0.025, successes + 0.5, count - successes + 0.5)
    high = 1.0 if successes == count else beta.ppf(0.975, successes + 0.5, count - successes + 0.5)
    return float(low), float(high)


def chosen(rows: list[dict], kind: str, robot: str, diagonal: str | None, error: float) -> list[dict]:
    return [
        row
        for row in rows
        if (row["kind"], row["robot"], row["error"]) == (kind, robot, error)
        and diagonal in (None, row["diagonal"])
        and "failed" not in row
    ]


def sweep_table(rows: list[dict], kind: str) -> list[str]:
    lines = [
        "| robot | on | " + " | ".join(f"{error:+d}" if error else "0" for error in ERRORS) + " |",
        "|---|---|" + "---|" * len(ERRORS),
    ]
    for robot in ROBOTS:
        for diagonal in DIAGONALS:
            cells = []
            for error in ERRORS:
                runs = chosen(rows, kind, robot, diagonal, error)
                times = [row["time"] for row in runs]
                stood = sum(row["balanced"] for row in runs)
                cell = f"{stood}/{len(runs)}" if runs else "-"
                cells.append(cell if not runs or stood == len(runs) else f"{cell} ({np.median(times):.1f} s)")
            lines.append(f"| {robot} | {diagonal} | " + " | ".join(cells) + " |")
    return lines


def lean_table(rows: list[dict]) -> list[str]:
    lines = [
        "| robot | std of the CoM at 0 mm [mm] | tilt in the last second at 0, +-2, +-4, +-6 mm [deg] | largest torque [Nm] |",
        "|---|---|---|---|",
    ]
    for robot in ROBOTS:
        stood = [row for row in rows if row["kind"] == "known" and row["robot"] == robot and row.get("balanced")]
        if not stood:
            continue
        com_stds = [row["com_std"] for row in stood if row["error"] == 0]
        tilts = []
        for size in (0, 2, 4, 6):
            some = [row["tilt"] for row in stood if abs(row["error"]) == size]
            tilts.append(f"{np.mean(some):.1f}" if some else "falls")
        torque = max(row["torque"] for row in stood)
        lines.append(f"| {robot} | {np.mean(com_stds):.2f} | {', '.join(tilts)} | {torque:.1f} |")
    return lines


def payload_table(rows: list[dict]) -> list[str]:
    head = [f"{model}, {diagonal}" for model in MODELS for diagonal in DIAGONALS]
    lines = ["| robot | payload (kg, m) | " + " | ".join(head) + " |", "|---|---|" + "---|" * len(head)]
    for robot in ROBOTS:
        for payload in PAYLOADS[robot]:
            runs = [r for r in rows if (r["kind"], r["robot"], r["payload"]) == ("payload", robot, payload)]
            good = [row for row in runs if "failed" not in row]
            if not good:
                continue
            cells = []
            for model in MODELS:
                for diagonal in DIAGONALS:
                    trials = [row["trials"][model][diagonal] for row in good]
                    stood = sum(trial["balanced"] for trial in trials)
                    time = np.median([trial["time"] for trial in trials])
                    error = np.sqrt(np.mean([trial["model_error"] ** 2 for trial in trials]))
                    cells.append(f"{stood}/{len(trials)}, {time:.1f} s, off {error:.1f} mm")
            lines.append(f"| {robot} | {payload} | " + " | ".join(cells) + " |")
    return lines


def observer_table(rows: list[dict]) -> list[str]:
    lines = [
        "| robot | " + " | ".join(f"{error:+d} mm" if error else "0 mm" for error in OBSERVED) + " | rms error [mm] |",
        "|---|" + "---|" * (len(OBSERVED) + 1),
    ]
    for robot in ROBOTS:
        cells, misses = [], []
        for error in OBSERVED:
            runs = chosen(rows, "observe", robot, None, error)
            stood = [row for row in runs if row["balanced"]]
            found = [row["observed_error"] for row in stood]
            misses += [value - error for value in found]
            mean = f"{np.mean(found):+.2f} +- {np.std(found):.2f}" if found else "-"
            cells.append(f"{mean} ({len(stood)}/{len(runs)})")
        if misses:
            lines.append(f"| {robot} | " + " | ".join(cells) + f" | {np.sqrt(np.mean(np.square(misses))):.2f} |")
    return lines


def draw(rows: list[dict]) -> None:
    """Draw the probability of balancing for 10 s against the error, a panel per robot."""
    figure = Figure(figsize=(15.0, 5.2), layout="constrained", facecolor="white")
    figure.suptitle(
        "Share of runs that balance on two feet for 10 s against the error of the controller's CoM", fontsize=13
    )
    panels = figure.subplots(1, len(ROBOTS), sharey=True)
    for axes, robot in zip(panels, ROBOTS, strict=True):
        for sign in (-1, 1):
            label = "the paper's 5 mm" if sign > 0 else None
            axes.axvline(sign * PAPER, color="dimgrey", linestyle=(0, (4, 2)), linewidth=1.3, label=label)
        styles = (("known", "FL_RR", "C0", "o", -0.15), ("known", "FR_RL", "C1", "s", 0.15))
        for kind, diagonal, colour, marker, shift in styles:
            _curve(axes, rows, kind, robot, diagonal, (colour, marker, "-", shift), diagonal)
        _curve(axes, rows, "unknown", robot, None, ("dimgrey", "^", ":", 0.0), "both, sensor errors not corrected")
        axes.set_title(robot, fontsize=12)
        axes.set_xlabel("controller's CoM in front of the true one [mm]", fontsize=10)
        axes.set_ylim(-0.04, 1.04)
        axes.grid(color="lightgrey")
        axes.set_axisbelow(True)
    panels[0].set_ylabel("share that balanced for 10 s; bands: 95 %", fontsize=10)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), fontsize=9, frameon=False)
    figure.savefig(RESULTS / "balance.png", dpi=150)


def _curve(axes, rows, kind, robot, diagonal, style, label) -> None:
    colour, marker, line, shift = style
    points = []
    for error in ERRORS:
        runs = chosen(rows, kind, robot, diagonal, error)
        if runs:
            stood = sum(row["balanced"] for row in runs)
            points.append((error + shift, stood / len(runs), *interval(stood, len(runs))))
    if points:
        x, share, low, high = np.transpose(points)
        axes.fill_between(x, low, high, color=colour, alpha=0.12, lw=0)
        axes.plot(x, share, color=colour, marker=marker, linestyle=line, markersize=5, label=label)


def write_tables() -> str:
    rows = list(load_rows().values())
    failed = [row for row in rows if "failed" in row]
    lines = [
        "# Balancing on two feet",
        "",
        f"`make bench-balance`; equipoise {equipoise.__version__}, Pinocchio {pin.__version__}, MuJoCo {mujoco.__version__}, "
        f"Python {machine.python_version()}. Preset `realistic`, 10 s, a controller with a fixed model that uses encoders "
        "and IMU only. Success according to the simulated truth: lifted feet clear of the floor, standing feet on it and in "
        "place, tilt below 20 deg (at this limit the routine catches the robot).",
        "",
        "## Tolerated error of the centre of mass",
        "",
        "Runs that balanced, of all runs; in brackets the median time to the fall. The controller is designed on the truth "
        "with the CoM displaced [mm] along the horizontal normal of the support line; positive: too far forward. "
        "Constant sensor errors (joint offsets, IMU mounting, accelerometer bias) are corrected, to study the CoM alone. "
        "Errors of leg masses, torque gains, friction and the floor's slope are not.",
        "",
        *sweep_table(rows, "known"),
        "",
        "The same without correction of sensor errors (joint offsets 5 mrad, IMU tilt 5 mrad rms):",
        "",
        *sweep_table(rows, "unknown"),
        "",
        "![probability of balancing against the error](balance.png)",
        "",
        "A robot that does not fall leans in proportion to the error.",
        "",
        *lean_table(rows),
        "",
        "## Before and after calibration, with a payload off centre",
        "",
        "Runs that balanced, median time, and rms error of the controller's CoM across the support line. Each robot is "
        "calibrated with its payload and its own sensor errors, without a scale, and balances afterwards. With `bayesian`, "
        "the estimated joint offsets and IMU mounting are corrected; with the others, sensor errors are not corrected.",
        "",
        *payload_table(rows),
        "",
        "## Observed error of the centre of mass",
        "",
        "With `--observe-offset` the controller also estimates the distance of its CoM in front of the true one, and "
        "compensates it. Estimates (mean +- std over runs that balanced, number of these) for the true errors in the head. "
        "Sensor errors are corrected.",
        "",
        *observer_table(rows),
    ]
    if failed:
        lines += ["", "## Failed runs", "", *(f"- {row['key']}: {row['failed']}" for row in failed)]
    text = "\n".join(lines) + "\n"
    write_page("balance.md", text, rows)
    draw(rows)
    return text


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tables", action="store_true", help="write the tables from the existing rows")
    parser.add_argument("--seeds", type=int, default=max(SEEDS.values()), help="number of seeds")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    arguments = parser.parse_args()
    if not arguments.tables:
        done = load_rows()
        missing = [case for case in cases(arguments.seeds) if case.key not in done]
        with ProcessPoolExecutor(arguments.jobs) as pool, ROWS.open("a", encoding="utf-8") as out:
            futures = {pool.submit(run, case): case for case in missing}
            for count, future in enumerate(as_completed(futures), 1):
                row = future.result()
                out.write(json.dumps(row) + "\n")
                out.flush()
                print(f"[{count}/{len(missing)}] {row['key']} {row.get('failed', '')}", flush=True)
    print(write_tables())


if __name__ == "__main__":
    main()
