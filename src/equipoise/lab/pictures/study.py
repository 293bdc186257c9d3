"""Pictures of a Monte Carlo study: how often the CoM is how near, honest intervals, and what costs accuracy."""

# pyright: reportUnknownMemberType=false
# Matplotlib's own stubs leave **kwargs without a type, which makes every method that takes them partially unknown.

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from equipoise.conventions import FloatArray
from equipoise.lab.study.rows import SUCCEEDED, Table, column, having, texts
from equipoise.lab.study.statistics import LEVELS, WITHIN, MethodSummary, Slope, planar_errors
from equipoise.lab.study.summary import rate_text, slope_numbers, source_label, source_unit
from equipoise.pictures.figure import BLACK, BLUE, GREEN, GREY, LIGHT_GREY, PURPLE, SMALL, TEXT, VERMILLION, new_figure

_PALETTE = (BLUE, VERMILLION, GREEN, PURPLE)
_BINS = 6  # of size, with as many trials each


def draw_study(rows: Table, summaries: Sequence[MethodSummary], title: str) -> Figure:
    """Planar CoM errors of all methods, and the coverage of their intervals where there are some."""
    covered = [summary for summary in summaries if any(error.coverage for error in summary.errors)]
    figure = new_figure(11 if covered else 7, 4.6)
    axes = figure.subplots(1, 2 if covered else 1, squeeze=False)[0]
    _draw_distribution(axes[0], rows, summaries)
    if covered:
        _draw_coverage(axes[1], covered[0])
    figure.suptitle(title, fontsize=TEXT + 1, x=0.01, ha="left", fontweight="bold")
    figure.tight_layout(rect=(0, 0, 1, 0.97))
    return figure


def _draw_distribution(axes: Axes, rows: Table, summaries: Sequence[MethodSummary]) -> None:
    """How many calibrations were at most so far off; those that failed never are."""
    largest, colours = 1000 * WITHIN * 1.4, _colours(rows)
    for summary in summaries:
        errors = 1000 * planar_errors(having(rows, "method", summary.method))
        found = np.sort(errors[np.isfinite(errors)])
        if not found.size:
            continue
        largest = max(largest, float(np.quantile(found, 0.98)))
        share = 100 * np.arange(1, len(found) + 1) / summary.trials
        label = f"{summary.method}: {rate_text(summary.within)} within 5 mm"
        axes.step(np.concatenate([[0], found]), np.concatenate([[0], share]), where="post", lw=2,
                  color=colours[summary.method], label=label)  # fmt: skip
    axes.axvline(1000 * WITHIN, color=GREY, ls="--", lw=1)
    axes.annotate(
        "the paper's 5 mm", (1000 * WITHIN, 4), (4, 0), textcoords="offset points", fontsize=SMALL, color=GREY
    )
    axes.set(
        xlim=(0, largest), ylim=(0, 101), xlabel="planar CoM error [mm]", ylabel="calibrations at most so far off [%]"
    )
    if axes.lines[:-1]:  # the last is the 5 mm
        axes.legend(loc="lower right", fontsize=SMALL, frameon=False, bbox_to_anchor=(1, 0.1))
    tidy(axes)


def _colours(rows: Table) -> dict[str, str]:
    """By method, in the order in which they appear."""
    return dict(zip(dict.fromkeys(texts(rows, "method")), cycle(_PALETTE), strict=False))


def _draw_coverage(axes: Axes, summary: MethodSummary) -> None:
    errors = [error for error in summary.errors if error.coverage]
    for index, (level, colour) in enumerate(zip(LEVELS, (BLUE, GREEN, VERMILLION), strict=True)):
        axes.axhline(level, color=colour, lw=1, ls="--")
        positions = np.arange(len(errors)) + 0.18 * (index - 1)
        rates = np.array([100 * error.coverage[level].value for error in errors])
        intervals = 100 * np.array([error.coverage[level].interval for error in errors])
        axes.errorbar(positions, rates, np.abs(intervals.T - rates), fmt="o", ms=4, color=colour, lw=1,
                      label=f"{level} % interval")  # fmt: skip
    names = [error.quantity.replace("_", " ").replace("com", "CoM") for error in errors]
    axes.set_xticks(range(len(errors)), names, rotation=45, ha="right", fontsize=SMALL)
    axes.set(ylim=(0, 104), ylabel="truth inside [%]")
    axes.set_title(f"{summary.method}: does an interval hold the truth as often as it says?", fontsize=TEXT, loc="left")
    axes.legend(loc="lower right", fontsize=SMALL, frameon=False)
    tidy(axes)


def draw_slopes(rows: Table, slopes: Sequence[Slope], method: str) -> Figure:
    """The planar CoM error against the size of each source, with the line that the slope says."""
    chosen = having(having(rows, "method", method), "status", SUCCEEDED)
    of_method = [slope for slope in slopes if slope.method == method]
    columns = min(4, len(of_method))
    lines = -(-len(of_method) // columns)
    figure = new_figure(2.9 * columns, 2.5 * lines + 0.5)
    grid = figure.subplots(lines, columns, squeeze=False, sharey=True)
    errors = 1000 * planar_errors(chosen)
    for axes, slope in zip(grid.flat, of_method, strict=False):
        unit, factor = source_unit(slope.source)
        size = factor * column(chosen, slope.source)
        steepness, deviation, per_unit = slope_numbers(slope)
        # What the others cost on average stays: the line is the root of its square and this source's.
        others = float(np.sqrt(max(0.0, float(np.mean(errors**2) - steepness**2 * np.mean(size**2)))))
        draw_line_in_squares(axes, size, errors, others, steepness, _colours(rows)[method])
        axes.set_title(f"{source_label(slope.source)}\n{steepness:.2g} ± {deviation:.2g} {per_unit}", fontsize=SMALL)
        axes.set_xlabel(unit, fontsize=SMALL)
        axes.set_ylim(0, float(np.quantile(errors, 0.995)))
    for axes in grid.flat[len(of_method) :]:
        axes.set_visible(False)
    for axes in grid[:, 0]:
        axes.set_ylabel("planar CoM error [mm]", fontsize=SMALL)
    figure.suptitle(
        f"{method}: each trial (grey), RMS by size (dots), and what the slope says (line)",
        fontsize=TEXT, x=0.01, ha="left", fontweight="bold",
    )  # fmt: skip
    figure.tight_layout(rect=(0, 0, 1, 0.98))
    return figure


def draw_line_in_squares(
    axes: Axes, size: FloatArray, errors: FloatArray, floor: float, slope: float, colour: str, line: str | None = None
) -> None:
    """Each trial's error, their RMS by size, and root of (floor squared + (slope x size) squared), all in one unit each.

    Args:
        line: what the line is called in a legend; None: there will be none.
    """
    axes.plot(size, errors, ".", ms=3, color=LIGHT_GREY, rasterized=True, label="one robot")
    parts = np.array_split(np.argsort(size), _BINS)
    axes.plot([size[part].mean() for part in parts], [np.sqrt(np.mean(errors[part] ** 2)) for part in parts], "o", ms=5,
              color=colour, label="RMS of a sixth of them")  # fmt: skip
    sizes = np.arange(51) / 50 * float(size.max())
    axes.plot(sizes, np.hypot(floor, slope * sizes), color=BLACK, lw=1.2, label=line)
    axes.set(xlim=(0, None), ylim=(0, None))
    tidy(axes)


def tidy(axes: Axes) -> None:
    """Light grid, no frame on the right and on top."""
    axes.tick_params(labelsize=SMALL)
    axes.grid(color=LIGHT_GREY, lw=0.5)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
