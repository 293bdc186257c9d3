"""The paper's method, its results reproduced, and balancing on two feet: `make bench-paper`.

Writes benchmarks/results/paper.md, and paper/README.md by `equipoise lab reproduce`. Search: simulated calibrations by the
paper's method. Effects: calibrations of A1s on which the size of each simulated effect is drawn; a fit gives the share of
each effect in the error. Balance: robots stand on a diagonal for 10 s with a fixed controller, designed on the truth with a
displaced CoM and known sensor errors, on a model file, or on a calibration.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from pathlib import Path

from rows import Page, Row, Table, main  # isort: skip - it limits the threads of NumPy
import numpy as np
from provenance import write_page
from simulated import FIRST_SEED, cases_of, robot_called
from tables import column, figures, interval_of_share, markdown, rms

from equipoise import ComSearchSettings, PaperMethod, RobotModel, calibrate, nominal_stance, simulate
from equipoise.lab.balance.balance_routine import balance
from equipoise.lab.balance.evaluation import evaluate, true_traces
from equipoise.lab.balance.model_error import DesignModel, calibrated, displaced, error_along, model_file
from equipoise.lab.balance.observer import SensorCorrections
from equipoise.lab.pages.reproduction_page import reproduction_page, save_reproduction
from equipoise.lab.study.reproduction import reproduce
from equipoise.lab.study.rows import table_of
from equipoise.lab.study.study import Study
from equipoise.lab.study.study_statistics import WITHIN, planar_errors, slopes
from equipoise.lab.study.summary import slope_numbers, source_label
from equipoise.lab.study.trial import run_trial
from equipoise.method.table import method_named
from equipoise.robot.catalog import CATALOG
from equipoise.robot.model import DIAGONALS
from equipoise.simulation.effects import Noise
from equipoise.simulation.ground_truth_view import GroundTruthRecorder
from equipoise.simulation.simulation import Simulation

AXES = ("roll", "pitch", "yaw")
FEET_SEEDS = 20
# Preset, feet, tolerance [mm], payload as a share of the robot's mass, number of seeds.
A1_SEARCHES: dict[tuple[Noise, str, int, float], int] = {
    ("ideal", "measured", 1, 0): 1,
    ("ideal", "commanded", 5, 0): 1,
    ("realistic", "measured", 1, 0): FEET_SEEDS,
    ("realistic", "commanded", 1, 0): FEET_SEEDS,
}
ALL_SEARCHES: dict[tuple[Noise, str, int, float], int] = {
    ("ideal", "measured", 5, 0): 1,
    ("ideal", "measured", 5, 0.08): 1,
}
ALLOWED = {("ideal", 1): 2.0, ("ideal", 5): 5.0}  # [mm], by preset and tolerance; more on longer legs than an A1's
MOST_HALVINGS = {5: 6}  # of each diagonal, by tolerance
A1_LEG = 0.4  # [m]

TRIALS, BAYESIAN_TRIALS = 200, 40  # of the reproduction
EFFECT_TRIALS = 240
SIGNIFICANT = 2.0  # standard errors of a slope

BALANCED = ("unitree_a1", "go2", "solo12")
BALANCE_SEEDS = 3
SIZES = (0, 2, 3, 4, 5, 6, 8, 10, 15)  # [mm]
ERRORS = tuple(sorted({sign * size for size in SIZES for sign in (-1, 1)}))
# Off the centre of the back; payloads of go2 and solo12 are the A1's 2 kg in proportion to mass and size.
PAYLOADS = (
    ("unitree_a1", "1,0.08,0.03,0.1"), ("unitree_a1", "2,0.08,0.03,0.1"), ("unitree_a1", "3,0.08,0.03,0.1"),
    ("go2", "2.6,0.085,0.032,0.105"), ("solo12", "0.4,0.062,0.023,0.078"),
)  # fmt: skip
MODELS = ("model file", "paper", "bayesian")


def search(name: str, preset: Noise, feet: str, tolerance: int, load: float, seed: int) -> Row:
    """Return the row of a calibration by the paper's method.

    Args:
        tolerance: tolerance of the search [mm].
        load: payload as a share of the robot's mass, ahead, to the right and above the base's origin.
    """
    robot = robot_called(name)
    x, y, z = (ratio * robot.leg_length for ratio in (0.25, -0.12, 0.2))
    payload = f"{load * robot.mass:.4f},{x:.4f},{y:.4f},{z:.4f}" if load else None
    method = PaperMethod(feet, com_search=ComSearchSettings(tolerance=1e-3 * tolerance))
    with simulate(robot, preset, payload, seed) as simulation:
        result = calibrate(simulation.platform, robot, method).with_truth(simulation.truth)
    lifts = [trial for trial in result.trials if trial.kind == "lift"]
    moments = result.moment_errors()
    return {
        "com": result.composite.com_in_base.errors[:2].tolist(),
        "halvings": max(len({trial.offset for trial in lifts if trial.about == one}) for one in DIAGONALS),
        "moments": [moments[axis]["against_composite"] if axis in moments else None for axis in AXES],
        "robot_time": sum(trial.duration for trial in result.trials),
        "leg_length": robot.leg_length,
    }


def show_searches(rows: list[Row]) -> Iterator[str]:
    yield "## Accuracy of the method `paper`"
    yield ""
    yield (
        "Allowed: per axis within 2 mm at a tolerance of 1 mm; within 5 mm, scaled with the leg length for larger robots, at "
        "5 mm, in at most 6 halvings of each diagonal. Robots of the catalogue have two runs: without a payload, and with an "
        "off-centre payload of 8 % of their mass, because symmetric models balance in the first trial. `realistic` has "
        "joint offsets and IMU errors, which two level support lines cannot separate from a CoM offset. I: equation 5, "
        "against the whole robot. Root mean square errors."
    )
    yield ""
    head = (
        "robot", "preset", "feet", "tolerance", "runs", "CoM x, y [mm]", "largest error [mm]", "allowed", "halvings",
        "robot time [s]", "I roll, pitch, yaw [%]",
    )  # fmt: skip
    yield from markdown(head, _search_lines(rows))


def _search_lines(rows: list[Row]) -> Iterator[list[str]]:
    groups: dict[tuple, list[Row]] = {}
    for row in rows:
        name, preset, feet, tolerance, *_ = row["case"]
        groups.setdefault((name, preset, feet, tolerance), []).append(row)
    for (name, preset, feet, tolerance), of in groups.items():
        com = 1e3 * column(of, "com")
        largest = np.abs(com).max() if tolerance == 1 else np.hypot(*com.T).max()
        allowed = ALLOWED.get((preset, tolerance), np.inf) * max(1.0, of[0]["leg_length"] / A1_LEG)
        halvings, most = max(row["halvings"] for row in of), MOST_HALVINGS.get(tolerance, np.inf)
        yield [
            name, preset, feet, f"{tolerance} mm", str(len(of)), figures(rms(com)), figures(largest, most=allowed),
            f"{allowed:.1f}" if np.isfinite(allowed) else "", figures(halvings, ".0f", most if preset == "ideal" else np.inf),
            f"{column(of, 'robot_time').mean():.0f}", figures(100 * rms(column(of, "moments")), ".0f"),
        ]  # fmt: skip


STUDY = Study(vary_effects=True, seed=FIRST_SEED)
_KEPT = re.compile(r"trial|method|status|message|payload_mass|size_.*|(true|estimated)_com_[xy]")


def effect(trial: int) -> Row:
    """Return the columns of a trial that determine the slopes, without zeros."""
    (row,) = run_trial(STUDY, trial).to_pylist()
    return {name: value for name, value in row.items() if _KEPT.fullmatch(name) and value}


def show_effects(rows: list[Row]) -> Iterator[str]:
    yield "## Effects that cost the method `paper` its accuracy"
    yield ""
    table = table_of(rows)
    planar, found = planar_errors(table), slopes(table, "paper")
    share = interval_of_share(float(np.mean(planar <= WITHIN)), len(rows))
    yield (
        f"{len(rows)} A1s with random payloads; the size of each effect is 0 to 2 times that of `realistic`. Planar error: "
        f"{1e3 * np.sqrt(np.nanmean(planar**2)):.2f} mm rms, within 5 mm {share}. RMS error = slope x size; independent "
        f"effects add in squares. Of {len(found)} effects, these slopes exceed {SIGNIFICANT:g} standard errors."
    )
    yield ""
    certain = [(source_label(one.source), *slope_numbers(one)) for one in found if one.slope > SIGNIFICANT * one.std]
    lines = [(name, f"{slope:.3g}", f"{std:.2g}", unit) for name, slope, std, unit in certain]
    yield from markdown(("effect", "slope", "standard error", "unit"), lines)


def study_again() -> Row:
    """Return the number of trials of the reproduction, whose page is written."""
    with tempfile.TemporaryDirectory() as folder:
        page = reproduction_page(reproduce(Path(folder) / "studies", TRIALS, BAYESIAN_TRIALS))
        readme, _ = save_reproduction(page, Path(folder))
        text = readme.read_text(encoding="utf-8")
    write_page("paper/README.md", re.sub(r"^\[Figure: .*\n\n?", "", text, flags=re.MULTILINE))
    return {"trials": TRIALS}


def show_study(rows: list[Row]) -> Iterator[str]:
    yield "## The paper's results reproduced"
    yield ""
    yield (
        f"[Table I, Fig. 3, the Monte Carlo rate and the effect of joint errors](paper/README.md): `equipoise lab reproduce` "
        f"with {rows[0]['trials']} trials; its page report.html has the figures."
    )


def stand(robot: RobotModel, simulation: Simulation, design: DesignModel, diagonal: str) -> Row:
    """Do one balance trial; return its result, its time [s], and the error of the controller's CoM across the line [mm]."""
    recorder = GroundTruthRecorder(simulation.ground_truth, 5)
    run = balance(simulation.platform, robot, design.model, diagonal, corrections=design.sensors, watch=recorder.watch)
    verdict = evaluate(run, true_traces(run, recorder.ground_truths))
    error = error_along(nominal_stance(robot), diagonal, design.model, simulation.truth)
    return {"balanced": verdict.balanced, "time": verdict.time_balanced, "model_error": 1e3 * error}


def displaced_balance(name: str, diagonal: str, error: float, seed: int) -> Row:
    """Balance with the truth, its CoM displaced [mm] along the normal of the support line, and known sensor errors."""
    robot = robot_called(name)
    with simulate(robot, "realistic", seed=seed) as simulation:
        design = displaced(robot, nominal_stance(robot), simulation.truth, diagonal, 1e-3 * error)
        drawn = simulation.errors
        sensors = SensorCorrections(
            drawn.drawn["joint_offset"], drawn.drawn["imu_tilt"], drawn.drawn["accelerometer_bias"]
        )
        return stand(robot, simulation, replace(design, sensors=sensors), diagonal)


def show_displaced(rows: list[Row]) -> Iterator[str]:
    yield "## Balancing on two feet with an error of the CoM"
    yield ""
    yield (
        "Runs that stood for 10 s on two feet, both diagonals together, `realistic`. Error [mm]: CoM of the controller's "
        "model minus the true one, along the horizontal normal of the support line, forward. Constant sensor errors are "
        "corrected. Success according to the simulated truth: lifted feet clear of the floor, standing feet on it and in "
        "place, tilt below 20 deg. The paper's controller tolerates 5 mm."
    )
    yield ""
    lines = []
    for name in BALANCED:
        by_error = [
            [row["balanced"] for row in rows if row["case"][0] == name and row["case"][2] == one] for one in ERRORS
        ]
        lines.append([name, *(f"{sum(of)}/{len(of)}" if of else "" for of in by_error)])
    yield from markdown(("robot", *(f"{one:+d}" if one else "0" for one in ERRORS)), lines)


def calibrated_balance(name: str, payload: str, seed: int) -> Row:
    """Balance with the model file, and after calibrations of the same robot, with the same payload."""
    robot = robot_called(name)
    designs = [model_file(robot)]
    for method in MODELS[1:]:
        with simulate(robot, "realistic", payload, seed) as simulation:
            result = calibrate(simulation.platform, robot, method_named(method)())
        designs.append(calibrated(robot, nominal_stance(robot), result))
    row: Row = {model: [] for model in MODELS}
    for model, design in zip(MODELS, designs, strict=True):
        for diagonal in DIAGONALS:
            with simulate(robot, "realistic", payload, seed) as simulation:
                row[model].append(stand(robot, simulation, design, diagonal))
    return row


def show_calibrated(rows: list[Row]) -> Iterator[str]:
    yield "## Balancing before and after a calibration"
    yield ""
    yield (
        "Runs that stood for 10 s, in brackets the 95 % interval of the share, and the rms error of the controller's CoM "
        "across the support line. Each robot is calibrated with its payload and its own sensor errors, not weighed. With "
        "`bayesian`, the estimated joint offsets and IMU mounting are corrected; with the others, sensor errors are not."
    )
    yield ""
    lines = []
    for name, payload in PAYLOADS:
        if of := [row for row in rows if row["case"][:2] == [name, payload]]:
            lines.append([name, payload, *(_stood([one for row in of for one in row[model]]) for model in MODELS)])
    yield from markdown(("robot", "payload (kg, m)", *MODELS), lines)


def _stood(trials: list[Row]) -> str:
    count, total = sum(trial["balanced"] for trial in trials), len(trials)
    interval = interval_of_share(count / total, total).partition(" ")[2]
    return f"{count}/{total} {interval}, off {rms(column(trials, 'model_error')):.1f} mm"


PAGE = Page(
    "paper",
    f"""# The paper's method, and balancing

`make bench-paper`; seeds from {FIRST_SEED:,}. Errors are estimate minus truth at the nominal stance. Bold: target missed.""",
    (
        Table("reproduction", study_again, [()], show_study, alone=True),
        Table(
            "search",
            search,
            cases_of({("unitree_a1", *of): n for of, n in A1_SEARCHES.items()})
            + cases_of({(name, *of): n for name in CATALOG for of, n in ALL_SEARCHES.items()}),
            show_searches,
        ),
        Table("effects", effect, [(trial,) for trial in range(EFFECT_TRIALS)], show_effects),
        Table(
            "balance",
            displaced_balance,
            cases_of(dict.fromkeys(product(BALANCED, DIAGONALS, ERRORS), BALANCE_SEEDS)),
            show_displaced,
        ),
        Table(
            "calibrated",
            calibrated_balance,
            cases_of(dict.fromkeys(PAYLOADS, BALANCE_SEEDS)),
            show_calibrated,
        ),
    ),
)

if __name__ == "__main__":
    main(PAGE)
