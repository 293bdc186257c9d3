"""The reproduced paper as Markdown, CSV and figures."""

# pyright: reportUnknownMemberType=false
# Matplotlib's own stubs leave **kwargs without a type, which makes every method that takes them partially unknown.

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from equipoise.conventions import FloatArray
from equipoise.lab.pictures.study import draw_line_in_squares, tidy
from equipoise.lab.study.reproduction import (
    PAPER_ESTIMATE,
    PAPER_ITERATIONS,
    PAPER_TRUTH,
    QUANTITIES,
    TRUTH,
    Proportion,
    Reproduction,
)
from equipoise.lab.study.statistics import WITHIN
from equipoise.lab.study.summary import rate_text
from equipoise.pictures.figure import BLACK, BLUE, GREY, SMALL, TEXT, VERMILLION, new_figure
from equipoise.pictures.files import save_figures
from equipoise.user_file import write_file

_BAND = (5, 95)  # percentiles


def save_reproduction(done: Reproduction, folder: str | Path) -> list[Path]:
    """Write README.md, the tables as CSV, and the figures as PNG.

    Raises:
        OutputError: they cannot be written.
    """
    folder = Path(folder)
    figures = save_figures(
        {"figure3.png": draw_iterations(done), "proportional.png": draw_proportion(done.proportion)}, folder
    )
    texts = {
        "README.md": markdown(done),
        "table1.csv": _csv(("method", "noise", *QUANTITIES), _table_cells(done)),
        "figure3.csv": _csv(("iteration", "median_mm", "p5_mm", "p95_mm", "share_within_5_mm"), _iteration_cells(done)),
        "proportional.csv": _csv(
            ("foot_error_rms_mm", "joint_zero_rms_mrad", "com_error_mm"),
            (
                [f"{1000 * value:.5g}" for value in row]
                for row in zip(
                    done.proportion.foot_error, done.proportion.joint_error, done.proportion.com_error, strict=True
                )
            ),
        ),
    }
    for name, text in texts.items():
        write_file(folder / name, text)
    return [*(folder / name for name in texts), *figures]


def _csv(head: Iterable[str], rows: Iterable[Sequence[str]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(rows)
    return text.getvalue()


def _table_cells(done: Reproduction) -> list[list[str]]:
    rows = [("the paper: simulated", "", PAPER_TRUTH), ("the paper: estimated", "", PAPER_ESTIMATE)]
    rows += [(row.method, row.noise, row.values) for row in done.table]
    return [[name, noise, *("" if v is None else f"{v:.5g}" for v in values)] for name, noise, values in rows]


def _iteration_cells(done: Reproduction) -> list[list[str]]:
    median, lower, upper, share = _iteration_statistics(done)
    return [
        [str(index + 1), *(f"{1000 * curve[index]:.3f}" for curve in (median, lower, upper)), f"{share[index]:.4f}"]
        for index in range(len(median))
    ]


def _iteration_statistics(done: Reproduction) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Median, band [m] and share within 5 mm after each halving. A trial that failed counts as infinitely far off."""
    norms = np.where(np.isnan(done.iterations), np.inf, done.iterations)
    lower, median, upper = (np.quantile(norms, q / 100, axis=0, method="nearest") for q in (_BAND[0], 50, _BAND[1]))
    return median, lower, upper, np.mean(norms <= WITHIN, axis=0)


def markdown(done: Reproduction) -> str:
    """All of it on one page."""
    proportion = done.proportion
    median, lower, upper, share = _iteration_statistics(done)
    lines = [
        "# The paper's results, made again",
        "",
        "`equipoise lab reproduce`, in simulation, on the built-in Unitree A1. Everything is seeded.",
        "",
        "## Table I",
        "",
        "Moments of inertia of base, hips and thighs about their own CoM [kg m2], planar CoM of the whole robot in the base "
        "frame [mm]; in brackets the error against the truth above. The paper's robot stands in a stance that the "
        "paper does not give, so that its truth differs from ours. `paper` is the paper's method as we read it; `precise` "
        "estimates the same body with the rest.",
        "",
        "| | noise | I_x | I_y | I_z | p_x | p_y |",
        "|---|---|---|---|---|---|---|",
        _line("the paper: simulated", "", PAPER_TRUTH, None),
        _line("the paper: estimated", "", PAPER_ESTIMATE, PAPER_TRUTH),
    ]
    truth: Sequence[float | None] | None = None
    for row in done.table:
        truth = row.values if row.method == TRUTH else truth
        lines.append(_line(row.method, row.noise, row.values, None if row.method == TRUTH else truth))
    lines += [
        "",
        "## Fig. 3: error of the CoM by iteration of the search",
        "",
        f"{len(done.iterations)} robots with random payloads and the preset `realistic`, method `paper`. An iteration halves "
        "the brackets on both diagonals once.",
        "",
        "![Fig. 3](figure3.png)",
        "",
        f"| iteration | median | {_BAND[0]} to {_BAND[1]} % | within 5 mm |",
        "|---|---|---|---|",
        *(
            f"| {i + 1} | {1000 * median[i]:.1f} mm | {1000 * lower[i]:.1f} to {1000 * upper[i]:.1f} mm | {share[i]:.0%} |"
            for i in range(len(median))
        ),
        "",
        "## Monte Carlo: within 5 mm?",
        "",
        "The paper's simulation does so consistently. Joint zeros of 5 mrad and an IMU tilted by 5 mrad, which two level "
        "support lines cannot tell from a CoM that is elsewhere, are in ours.",
        "",
        "| method | trials | within 5 mm (95 % interval) | RMS | 95th percentile | failed |",
        "|---|---|---|---|---|---|",
    ]
    for summary in done.summaries:
        error = summary.error("planar CoM")
        cells = [summary.method, str(summary.trials), rate_text(summary.within)]
        cells += ["", ""] if error is None else [f"{error.rms:.2f} mm", f"{error.percentile_95:.2f} mm"]
        lines.append("| " + " | ".join([*cells, str(sum(summary.failures.values()))]) + " |")
    lines += [
        "",
        "## The error is proportional to joint and end-effector error",
        "",
        f"{len(proportion.com_error)} robots without a payload, wrong in nothing but their joint zeros, whose size is drawn "
        "from 0 to 10 mrad. "
        f"The RMS planar CoM error grows by {proportion.per_joint_error:.2f} mm per mrad of joint error (rms over joints), "
        f"which is {proportion.per_foot_error:.2f} mm per mm of planar foot error (rms over feet). Without joint errors "
        f"{1000 * proportion.floor:.2f} mm are left; they add in squares. Tolerance of the search: 1 mm.",
        "",
        "![proportional](proportional.png)",
    ]
    return "\n".join(lines) + "\n"


def _line(name: str, noise: str, values: Sequence[float | None], truth: Sequence[float | None] | None) -> str:
    cells: list[str] = []
    for index, value in enumerate(values):
        true = None if truth is None else truth[index]
        if value is None:
            cells.append("-")
        elif QUANTITIES[index].startswith("I"):
            cells.append(f"{value:.4f}" + (f" ({value / true - 1:+.0%})" if true else ""))
        else:
            cells.append(f"{1000 * value:.2f}" + (f" ({1000 * (value - true):+.2f})" if true else ""))
    return f"| {name} | {noise} | " + " | ".join(cells) + " |"


def draw_iterations(done: Reproduction) -> Figure:
    """Fig. 3 of the paper, over many trials."""
    median, lower, upper, share = _iteration_statistics(done)
    iterations = np.arange(1, len(median) + 1)
    figure = new_figure(7.5, 4.6)
    axes = figure.subplots()
    axes.fill_between(iterations, 1000 * lower, 1000 * upper, color=VERMILLION, alpha=0.18, lw=0,
                      label=f"{_BAND[0]} to {_BAND[1]} % of {len(done.iterations)} trials")  # fmt: skip
    axes.plot(iterations, 1000 * median, "o-", color=VERMILLION, lw=2, label="median of the paper's method")
    found = done.precise_errors
    if np.isfinite(found).any():
        value = 1000 * float(np.nanmedian(found))
        axes.axhline(value, color=BLUE, lw=1.5, label=f"median of the precise method: {value:.1f} mm")
    axes.axhline(1000 * WITHIN, color=GREY, ls="--", lw=1)
    axes.plot([PAPER_ITERATIONS], [1000 * WITHIN], marker="D", ms=8, color=BLACK, ls="none",
              label="the paper: 5 mm in about six iterations")  # fmt: skip
    for x, y, part in zip(iterations, 1000 * median, share, strict=True):
        axes.annotate(f"{part:.0%}", (x, y), (6, 7), textcoords="offset points", fontsize=SMALL, color=VERMILLION)
    axes.set(xlabel="iteration of the bisection search", ylabel="norm of the planar CoM error [mm]", ylim=(-0.5, None),
             xlim=(0.8, max(PAPER_ITERATIONS, len(median)) + 0.4))  # fmt: skip
    axes.set_xticks(range(1, max(PAPER_ITERATIONS, len(median)) + 1))
    axes.set_title("CoM error by iteration; the share of trials within 5 mm at each", fontsize=TEXT, loc="left")
    axes.legend(fontsize=SMALL, frameon=False)
    tidy(axes)
    figure.tight_layout()
    return figure


def draw_proportion(proportion: Proportion) -> Figure:
    """CoM error against joint error and against foot error, each with its line."""
    figure = new_figure(9.5, 4.2)
    panels = (
        (proportion.joint_error, proportion.per_joint_error, "joint error, rms over joints [mrad]", "mm per mrad"),
        (proportion.foot_error, proportion.per_foot_error, "planar foot error, rms over feet [mm]", "mm per mm"),
    )
    for axes, (size, slope, label, unit) in zip(figure.subplots(1, 2, sharey=True), panels, strict=True):
        floor = 1000 * proportion.floor
        draw_line_in_squares(
            axes, 1000 * size, 1000 * proportion.com_error, floor, slope, VERMILLION,
            f"{slope:.2f} {unit}, above {floor:.1f} mm",
        )  # fmt: skip
        axes.set_xlabel(label)
        axes.legend(fontsize=SMALL, frameon=False)
    figure.axes[0].set_ylabel("planar CoM error [mm]")
    figure.suptitle("Method paper, joint zeros alone wrong", fontsize=TEXT, x=0.01, ha="left", fontweight="bold")
    figure.tight_layout(rect=(0, 0, 1, 0.98))
    return figure
