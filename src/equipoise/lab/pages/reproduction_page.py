"""Page of the reproduced paper's results: tables and figures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.figures.blocks import INK, SERIES, Block, DataTable, Figure, PageContents, axes, level, line, points
from equipoise.lab.pages.markdown import markdown
from equipoise.lab.pages.study_page import line_in_squares
from equipoise.lab.study.reproduction import (
    PAPER_ESTIMATE,
    PAPER_ITERATIONS,
    PAPER_TRUTH,
    QUANTITIES,
    TRUTH,
    Reproduction,
)
from equipoise.lab.study.rows import Table, column
from equipoise.lab.study.study_statistics import WITHIN, lines_in_squares, planar_errors
from equipoise.lab.study.summary import rate_text
from equipoise.report.page import REPORT, save_page
from equipoise.user_file import write_file

_BAND = (5, 95)  # percentiles


def save_reproduction(page: PageContents, folder: Path) -> list[Path]:
    """Write README.md and report.html; raises OutputError if they cannot be written."""
    write_file(folder / "README.md", markdown(page, REPORT))
    return [folder / "README.md", save_page(page, folder / REPORT)]


def _iteration_statistics(done: Reproduction) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return median, band [m] and share within 5 mm after each halving. A failed trial has an infinite error."""
    norms = np.where(np.isnan(done.iterations), np.inf, done.iterations)
    lower, median, upper = (np.quantile(norms, q / 100, axis=0, method="nearest") for q in (_BAND[0], 50, _BAND[1]))
    return median, lower, upper, np.mean(norms <= WITHIN, axis=0)


def reproduction_page(done: Reproduction) -> PageContents:
    """Return tables and figures."""
    rows = done.joint_errors_alone
    by_foot, by_joint = _proportion(rows, "foot_error_rms"), _proportion(rows, "joint_zero_rms")
    (floor, per_foot_error), (_, per_joint_error) = by_foot, by_joint
    sections: dict[str, list[Block]] = {
        "Table I": [_TABLE, _table(done)],
        "Fig. 3: error of the CoM by iteration of the search": [
            f"{len(done.iterations)} robots with random payloads and the preset `realistic`, method `paper`. An iteration "
            "halves the brackets on both diagonals once.",
            _iterations(done),
            _iteration_table(done),
        ],
        "Monte Carlo: calibrations within 5 mm": [_MONTE_CARLO, _methods(done)],
        "Error against joint and end-effector error": [
            f"{rows.num_rows} robots without a payload, with joint offsets as the only error, whose size is "
            "drawn from 0 to 10 mrad. "
            f"The RMS planar CoM error grows by {per_joint_error:.2f} mm per mrad of joint error (rms over "
            f"joints), which is {per_foot_error:.2f} mm per mm of planar foot error (rms over feet). Without "
            f"joint errors it is {1000 * floor:.2f} mm; the two add in squares. Tolerance of the search: 1 mm.",
            _proportional(rows, "joint_zero_rms", by_joint, "Joint error", "mrad", "joint error, rms over joints"),
            _proportional(rows, "foot_error_rms", by_foot, "Foot error", "mm", "planar foot error, rms over feet"),
        ],
    }
    lead = "`equipoise lab reproduce`, in simulation, on the built-in Unitree A1. Everything is seeded."
    return PageContents("Reproduction of the paper's results", "", lead, [], sections)


_TABLE = (
    "Moments of inertia of base, hips and thighs about their own CoM [kg m2], planar CoM of the whole robot in the base "
    "frame [mm]; in brackets the error against the truth above. The paper does not give its robot's stance, so "
    "the truths differ. `paper` is our implementation of the paper's method; `bayesian` estimates the same body with "
    "all other parameters."
)
_MONTE_CARLO = (
    "The paper's simulated calibrations are consistently within 5 mm. Our simulation also has joint offsets of 5 mrad and an "
    "IMU tilt of 5 mrad. Two level support lines cannot distinguish these from a different CoM."
)


def _table(done: Reproduction) -> DataTable:
    rows = [
        ["the paper: simulated", "", *_cells(PAPER_TRUTH, None)],
        ["the paper: estimated", "", *_cells(PAPER_ESTIMATE, PAPER_TRUTH)],
    ]
    truth: Sequence[float | None] | None = None
    for method, preset, values in done.table:
        truth = values if method == TRUTH else truth
        rows.append([method, preset, *_cells(values, None if method == TRUTH else truth)])
    return DataTable("", ["", "noise", "|I_x", "|I_y", "|I_z", "|p_x", "|p_y"], rows)


def _cells(values: Sequence[float | None], truth: Sequence[float | None] | None) -> list[str]:
    cells: list[str] = []
    for index, value in enumerate(values):
        true = None if truth is None else truth[index]
        if value is None:
            cells.append("-")
        elif QUANTITIES[index].startswith("I"):
            cells.append(f"{value:.4f}" + (f" ({value / true - 1:+.0%})" if true else ""))
        else:
            cells.append(f"{1000 * value:.2f}" + (f" ({1000 * (value - true):+.2f})" if true else ""))
    return cells


def _iteration_table(done: Reproduction) -> DataTable:
    rows = [
        [str(count), f"{1000 * median:.1f} mm", f"{1000 * lower:.1f} to {1000 * upper:.1f} mm", f"{share:.0%}"]
        for count, (median, lower, upper, share) in enumerate(zip(*_iteration_statistics(done), strict=True), 1)
    ]
    return DataTable("", ["|iteration", "|median", f"|{_BAND[0]} to {_BAND[1]} %", "|within 5 mm"], rows)


def _methods(done: Reproduction) -> DataTable:
    rows: list[list[str]] = []
    for summary in done.summaries:
        error = summary.error("planar CoM")
        sizes = ["", ""] if error is None else [f"{error.rms:.2f} mm", f"{error.percentile_95:.2f} mm"]
        failed = str(sum(summary.failures.values()))
        rows.append([summary.method, str(summary.trials), rate_text(summary.within_5_mm), *sizes, failed])
    heads = ["method", "|trials", "|within 5 mm (95 % interval)", "|RMS", "|95th percentile", "|failed"]
    return DataTable("", heads, rows)


def _iterations(done: Reproduction) -> Figure:
    """Return Fig. 3 of the paper, over many trials."""
    median, lower, upper, share = _iteration_statistics(done)
    count = range(1, len(median) + 1)
    low, middle, high = (1000 * curve for curve in (lower, median, upper))
    labels = [f"{part:.0%}" for part in share]
    data = [
        line(count, low, "", 1, showlegend=False, line={"width": 0}),
        line(count, high, f"{_BAND[0]} to {_BAND[1]} % of {len(done.iterations)} trials", 1, fill="tonexty",
             fillcolor=f"{SERIES[1]}30", line={"width": 0}),
        line(count, middle, "median of the paper's method", 1, mode="lines+markers+text", text=labels,
             textposition="top right", line={"dash": "solid"}),
        points([PAPER_ITERATIONS], [1000 * WITHIN], "the paper: 5 mm in about six iterations",
               {"symbol": "diamond", "size": 10, "color": INK}),
    ]  # fmt: skip
    shapes = [level(1000 * WITHIN)]
    errors = done.bayesian_errors
    if np.isfinite(errors).any():
        value = 1000 * float(np.nanmedian(errors))
        shapes.append(level(value, f"median of the Bayesian method: {value:.1f} mm", SERIES[0], "solid"))
    layout = axes("iteration of the bisection search", "norm of the planar CoM error [mm]", shapes=shapes)
    layout["xaxis"] |= {"dtick": 1, "range": [0.8, max(PAPER_ITERATIONS, len(median)) + 0.4]}
    caption = "Labels: share of trials within 5 mm at each iteration."
    return Figure("Fig. 3: CoM error by iteration", caption, data, layout, height=440)


def _proportion(rows: Table, size: str) -> tuple[float, float]:
    """Return the CoM error without joint errors [m], and the slope of the error over a column of sizes."""
    floor, slopes = lines_in_squares(column(rows, size)[:, None], planar_errors(rows))
    return floor, float(slopes[0])


def _proportional(rows: Table, size: str, proportion: tuple[float, float], title: str, unit: str, label: str) -> Figure:
    floor, slope = proportion
    data = line_in_squares(1000 * column(rows, size), 1000 * planar_errors(rows), 1000 * floor, slope)
    caption = f"{slope:.2f} mm per {unit}. Method paper, joint offsets only."
    return Figure(title, caption, data, axes(f"{label} [{unit}]", "planar CoM error [mm]"))
