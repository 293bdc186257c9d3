"""Page of a Monte Carlo study: distribution of the CoM error, coverage of intervals, effect of each error source."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.figures.blocks import (
    INK,
    MUTED,
    SERIES,
    Block,
    DataTable,
    Figure,
    PageContents,
    Trace,
    axes,
    level,
    line,
    plain,
    points,
    short,
    upright,
)
from equipoise.lab.study.rows import SUCCEEDED, Table, column, having, texts
from equipoise.lab.study.study import Study
from equipoise.lab.study.study_statistics import LEVELS, WITHIN, MethodSummary, Slope, planar_errors
from equipoise.lab.study.summary import (
    rate_text,
    slope_numbers,
    source_label,
    source_unit,
)

_BINS = 6  # of source size, with equal numbers of trials


def method_blocks(summary: MethodSummary) -> list[Block]:
    """Return rate, failures and a table of errors of a method."""
    times = {"robot time": f"{summary.robot_time:.0f} s", "CPU time": f"{summary.cpu_time:.2f} s"}
    medians = ", ".join(f"{name} {time}" for name, time in times.items() if "nan" not in time)
    failures = ", ".join(f"{count} {kind}" for kind, count in summary.failures.items()) or "none"
    text = (
        f"{summary.method}: {summary.trials} trials, within 5 mm {rate_text(summary.within_5_mm)}, "
        f"failed: {failures}{f'; medians: {medians}' if medians else ''}"
    )
    reasons = tuple(f"{kind}, the first in {reason}" for kind, reason in summary.reasons.items())
    blocks: list[Block] = [text, *([reasons] if reasons else [])]
    if not summary.errors:
        return blocks
    levels = [level for level in LEVELS if any(error.coverage for error in summary.errors)]
    rows: list[list[str]] = []
    for error in summary.errors:
        largest = f"{error.percentile_95:.2f}" if np.isfinite(error.percentile_95) else "more than 5 % failed"
        covered = [rate_text(error.coverage[one]) if one in error.coverage else "" for one in levels]
        numbers = [str(error.count), f"{error.bias:+.2f}", f"{error.rms:.2f}", largest]
        rows.append([error.quantity, error.unit, *numbers, *covered])
    heads = ["quantity", "unit", "|n", "|bias", "|RMS", "|95th percentile"]
    heads += [f"in the {one} % interval" for one in levels]
    failed = sum(summary.failures.values())
    note = f"Bias and RMS exclude failed calibrations; the 95th percentile counts the {failed} failed ones as larger."
    return [*blocks, DataTable("", heads, rows), *([note] if failed else [])]


def _slope_table(slopes: Sequence[Slope]) -> DataTable:
    """Return the slope of the RMS error for each source."""
    rows: list[list[str]] = []
    for slope in slopes:
        value, std, unit = slope_numbers(slope)
        rows.append([source_label(slope.source), f"{value:.3g}", f"{std:.2g}", unit])
    title = "RMS planar error = slope x size of the source; independent sources add in squares."
    return DataTable(title, ["source", "|slope", "|standard error", "unit"], rows)


def study_page(study: Study, rows: Table, summaries: Sequence[MethodSummary], slopes: Sequence[Slope]) -> PageContents:
    """Return the page of a study."""
    sections: dict[str, Sequence[Block]] = {}
    for summary in summaries:
        covered = [_coverage(summary)] if any(error.coverage for error in summary.errors) else []
        sections[summary.method] = [*method_blocks(summary), *covered]
    for method in dict.fromkeys(slope.method for slope in slopes):
        found = [slope for slope in slopes if slope.method == method]
        sections[f"{method}: planar error by source"] = [_slope_table(found), *(_slope(rows, slope) for slope in found)]
    title = f"Monte Carlo study of {study.robot}"
    return PageContents(title, "", _conditions(study, summaries), [_distribution(rows, summaries)], sections)


def _conditions(study: Study, summaries: Sequence[MethodSummary]) -> str:
    payload = study.payload if study.payload in ("random", "none") else f"`{study.payload}`"
    noise = [study.preset]
    noise += [f"with {name}" if size is None else f"with {name} {size:g}" for name, size in study.effects.items()]
    noise += [f"without {name}" for name in study.disabled_effects]
    noise += ["contacts of the model file"] if study.contact_model == "file" else []
    noise += [f"only {', '.join(study.only)}"] if study.only else []
    noise += ["each source's size times a random factor from 0 to 2"] if study.vary_effects else []
    parts = [f"{max((s.trials for s in summaries), default=0)} trials", f"noise {', '.join(noise)}"]
    parts += [f"payload {payload}", f"seed {study.seed}"]
    return f"{'; '.join(parts)}. Errors are estimate minus truth, of the whole robot at its nominal stance."


def _distribution(rows: Table, summaries: Sequence[MethodSummary]) -> Figure:
    """Return the share of calibrations within each error, with failures outside."""
    largest, data = 1000 * WITHIN * 1.4, list[Trace]()
    methods = list(dict.fromkeys(texts(rows, "method")))
    for summary in summaries:
        errors = 1000 * planar_errors(having(rows, "method", summary.method))
        finite = np.sort(errors[np.isfinite(errors)])
        if finite.size:
            largest = max(largest, float(np.quantile(finite, 0.98)))
            share = 100 * np.arange(len(finite) + 1) / summary.trials
            label = f"{summary.method}: {rate_text(summary.within_5_mm)} within 5 mm"
            series = methods.index(summary.method)
            data.append(line([0, *finite], share, plain(label), series, line={"shape": "hv"}))
    layout = axes(
        "planar CoM error [mm]", "calibrations within it [%]", shapes=[upright(1000 * WITHIN, "the paper's 5 mm")]
    )
    layout["xaxis"]["range"], layout["yaxis"]["range"], layout["showlegend"] = [0, largest], [0, 101], True
    caption = "Cumulative share of calibrations by planar CoM error; failed ones count as outside."
    return Figure("Distribution of the CoM error", caption, data, layout, height=400)


def _coverage(summary: MethodSummary) -> Figure:
    errors = [error for error in summary.errors if error.coverage]
    names = [error.quantity.replace("_", " ").replace("com", "CoM") for error in errors]
    data: list[Trace] = []
    for series, one in enumerate(LEVELS):
        rates = [100 * error.coverage[one].value for error in errors]
        lower, upper = 100 * np.array([error.coverage[one].interval for error in errors]).T
        interval = {"type": "data", "array": short(upper - rates), "arrayminus": short(rates - lower), "thickness": 1}
        places = np.arange(len(errors)) + 0.18 * (series - 1)
        marker = {"color": SERIES[series], "symbol": ("circle", "diamond", "square")[series]}
        data.append(points(places, short(rates), f"{one} % interval", marker, error_y=interval))
    layout = axes("", "truth inside [%]", shapes=[level(one, "", SERIES[k]) for k, one in enumerate(LEVELS)])
    layout["xaxis"] |= {"tickvals": list(range(len(names))), "ticktext": names}
    layout["yaxis"]["range"] = [0, 104]
    return Figure(f"{summary.method}: truth inside the intervals", "Dashed: the nominal rates.", data, layout)


def _slope(rows: Table, slope: Slope) -> Figure:
    """Return the planar CoM error against the size of a source, with the line of its slope."""
    chosen = having(having(rows, "method", slope.method), "status", SUCCEEDED)
    unit, factor = source_unit(slope.source)
    size, errors = factor * column(chosen, slope.source), 1000 * planar_errors(chosen)
    steepness, std, per_unit = slope_numbers(slope)
    # The line is the root sum of squares of this source's share and the mean share of the others.
    others = float(np.sqrt(max(0.0, float(np.mean(errors**2) - steepness**2 * np.mean(size**2)))))
    caption = f"{slope.method}: {steepness:.2g} +- {std:.2g} {per_unit}."
    layout = axes(f"{source_label(slope.source)} [{unit}]", "planar CoM error [mm]")
    layout["yaxis"]["range"] = [0, float(np.quantile(errors, 0.995))]
    return Figure(source_label(slope.source), caption, line_in_squares(size, errors, others, steepness), layout)


def line_in_squares(size: FloatArray, errors: FloatArray, floor: float, slope: float) -> list[Trace]:
    """Return each trial's error, their RMS by size, and root of (floor squared + (slope x size) squared)."""
    parts = np.array_split(np.argsort(size), _BINS)
    sizes = np.linspace(0, float(size.max()), 51)
    rms = [float(np.sqrt(np.mean(errors[part] ** 2))) for part in parts]
    means = [float(size[part].mean()) for part in parts]
    label = f"root of ({floor:.1f}\u00b2 + ({slope:.2f} x size)\u00b2)"
    return [
        points(size, short(errors), "one robot", {"color": MUTED, "size": 3, "opacity": 0.5}),
        points(means, short(rms), "RMS of a sixth of them", {"color": SERIES[1], "size": 8}),
        line(sizes, np.hypot(floor, slope * sizes), label, 0, line={"color": INK, "width": 1.2}),
    ]
