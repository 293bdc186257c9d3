"""Reproduction of the paper's claims: Table I, Fig. 3, Monte Carlo rate, and proportionality to joint errors."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from equipoise.bayesian.method import BayesianMethod
from equipoise.calibration.routine import calibrate
from equipoise.conventions import AXES, FloatArray
from equipoise.lab.study.rows import SUCCEEDED, Table, having
from equipoise.lab.study.runner import StudyProgress, run_study
from equipoise.lab.study.study import Study
from equipoise.lab.study.study_statistics import MethodSummary, planar_errors, summarize
from equipoise.paper.method import PaperMethod
from equipoise.paper.settings import ComSearchSettings
from equipoise.robot.catalog import BUILT_IN_ROBOT, load_robot
from equipoise.simulation.simulation import simulate

QUANTITIES = ("I_x", "I_y", "I_z", "p_x", "p_y")
"""Columns of Table I: moments of base, hips and thighs about their own CoM [kg m2], planar CoM of the robot [m]."""

PAPER_TRUTH = (0.116, 0.349, 0.399, -0.0093, 0.00085)
PAPER_ESTIMATE = (0.0856, 0.306, 0.363, -0.0073, 0.00089)
PAPER_ITERATIONS = 6
"""Number of iterations until the paper's search is within 5 mm."""

TRUTH = "truth"
SEED = 4


TableRow = tuple[str, str, tuple[float | None, ...]]
"""Row of the reproduced Table I: method or "truth", preset of the simulated robot, and values of QUANTITIES or None.

Unless the preset is "ideal", its leg masses differ from the model's."""


@dataclass(frozen=True, eq=False)
class Reproduction:
    """Reproduced results.

    Attributes:
        table: rows of Table I; each truth is followed by its estimates.
        summaries: summaries of the methods.
        iterations: (n trials, k) norm of the planar CoM error after each halving [m]; nan for trials that failed.
        bayesian_errors: planar CoM errors of the Bayesian method [m]; nan for trials that failed.
        joint_errors_alone: rows of successful trials whose only errors are joint offsets.
    """

    table: tuple[TableRow, ...]
    summaries: tuple[MethodSummary, ...]
    iterations: FloatArray
    bayesian_errors: FloatArray
    joint_errors_alone: Table


def reproduce(
    folder: Path,
    trials: int,
    bayesian_trials: int,
    workers: int | None = None,
    report: Callable[[str, StudyProgress | None], None] = lambda doing, progress: None,
) -> Reproduction:
    """Reproduce all results, or resume from a folder after an interruption.

    Args:
        folder: folder for the studies' rows.
        trials: number of trials of the paper's method, and of the proportionality.
        bayesian_trials: number of trials of the Bayesian method, with the first of the same robots.
        workers: number of processes; default one per core.
        report: function of the name and progress of the present study.
    """
    report("Table I", None)
    table = _table()

    def run(study: Study, count: int, name: str, doing: str) -> Table:
        return run_study(study, count, folder / name, None, workers, lambda progress: report(doing, progress))

    study = Study(BUILT_IN_ROBOT, (PaperMethod(),), seed=SEED)
    bayesian = Study(BUILT_IN_ROBOT, (BayesianMethod(),), seed=SEED)
    exact = PaperMethod(com_search=ComSearchSettings(tolerance=1e-3))
    offsets = Study(BUILT_IN_ROBOT, (exact,), only=("joint_offset",), vary_effects=True, payload="none", seed=SEED)
    rows = run(study, trials, "paper", "Monte Carlo of the paper's method")
    proportional = run(offsets, trials, "joint-zeros", "joint errors alone")
    bayesian_rows = run(bayesian, bayesian_trials, "bayesian", "Monte Carlo of the Bayesian method")
    return Reproduction(
        table,
        (*summarize(rows), *summarize(bayesian_rows)),
        _iterations(rows),
        planar_errors(bayesian_rows),
        having(proportional, "status", SUCCEEDED),
    )


def _table() -> tuple[TableRow, ...]:
    robot = load_robot(BUILT_IN_ROBOT)
    rows: list[TableRow] = []
    for noise in ("ideal", "realistic"):
        for index, method in enumerate((PaperMethod(), BayesianMethod())):
            with warnings.catch_warnings(), simulate(robot, noise, seed=SEED) as simulation:
                warnings.simplefilter("ignore")
                result = calibrate(simulation.platform, robot, method)
            if index == 0:
                effective, com = simulation.truth.stance_effective.inertia, simulation.truth.composite.com
                truth = (*(float(effective[i, i]) for i in range(3)), float(com[0]), float(com[1]))
                rows.append((TRUTH, noise, truth))
            estimates = [one.value for one in result.stance_effective.inertia.moments]
            moments = [result.excitations[axis].moment for axis in AXES] if None in estimates else estimates
            com = result.composite.com_in_base
            rows.append((method.name, noise, (*moments, com.x.value, com.y.value)))
    return tuple(rows)


def _iterations(rows: Table) -> FloatArray:
    """Return error norms after each halving. A search that ended early, on a balanced robot, keeps its last error."""
    searches = rows.select(["status", "iteration_x", "iteration_y", "true_com_x", "true_com_y"]).to_pylist()
    length = max((len(row["iteration_x"] or ()) for row in searches if row["status"] == SUCCEEDED), default=0)
    norms = np.full((rows.num_rows, length), np.nan)
    for index, row in enumerate(searches):
        if row["status"] == SUCCEEDED:
            path = np.column_stack([row["iteration_x"], row["iteration_y"]]) - [row["true_com_x"], row["true_com_y"]]
            norms[index] = np.hypot(*path[np.minimum(np.arange(length), len(path) - 1)].T)
    return norms
