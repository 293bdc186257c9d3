"""What is on the page that compares runs: of one robot or of several."""

from __future__ import annotations

import numpy as np

from equipoise.errors import SettingsError
from equipoise.figures.plan_view import plan_view
from equipoise.report.blocks import SERIES, Block, Cell, axes, figure, plain, section, short, table, text
from equipoise.report.contents import SCHEMA, alerts, legend
from equipoise.report.numbers import Number, numbers, tell
from equipoise.report.plan_view import plan_view_block
from equipoise.report.provenance import facts
from equipoise.result.calibration import Calibration

_SYMBOLS = ("circle", "diamond", "square", "triangle-up")
_SHARED = (
    "Combined intervals take the runs' errors to be independent. Runs of one robot share joint zeros, IMU mounting and a "
    "scale's error, which cancel: a difference is surer than said here."
)


def comparison_contents(results: dict[str, Calibration]) -> Block:
    """The page as JSON values.

    Raises:
        SettingsError: fewer than two runs.
    """
    if len(results) < 2:
        raise SettingsError(f"{len(results)} runs cannot be compared; give at least two")
    shown = {name: {one.label: one for one in numbers(result)} for name, result in results.items()}
    robots = list(dict.fromkeys(result.robot for result in results.values()))
    labels = list(dict.fromkeys(label for table_of in shown.values() for label in table_of))
    first = next(iter(results))
    common = [label for label in labels if sum(label in table_of for table_of in shown.values()) > 1]
    differences = [_differences(labels, shown, first, name) for name in list(results)[1:]]
    sections = [
        section(
            "overlay", "Parameters", [{"type": "figures", "figures": [_overlay(label, shown) for label in common]}]
        ),
        section("differences", "Differences", [text(_SHARED), *differences]),
        section("provenance", "Provenance", [_provenance(results)]),
    ]
    return {
        "schema": SCHEMA,
        "title": f"{len(results)} runs compared",
        "subtitle": " \u00b7 ".join(robots),
        "lead": "" if len(robots) == 1 else f"These are {len(robots)} different robots; the first one is drawn.",
        "alerts": [
            {"name": f"{name}: {alert['name'].lower()}", "message": alert["message"]}
            for name, result in results.items() for alert in alerts(result)
        ],
        "numbers": _side_by_side(labels, shown),
        "legend": list(dict.fromkeys(sentence for result in results.values() for sentence in legend(result))),
        "plan_view": plan_view_block(plan_view(results)),
        "sections": [one for one in sections if one is not None],
    }  # fmt: skip


def _side_by_side(labels: list[str], shown: dict[str, dict[str, Number]]) -> Block:
    rows: list[list[Cell]] = [[label, *(_told(table_of.get(label)) for table_of in shown.values())] for label in labels]
    return table(
        ["", *(f"|{name}" for name in shown)], rows, "What each run found, with 95 % intervals", kind="numbers"
    )


def _told(one: Number | None) -> Cell:
    if one is None:
        return "\u2013"
    half = "" if one.quantity.half is None else f" \u00b1 {one.quantity.half:{one.form}}"
    return {"text": tell(one.value, one.form) + half, "verdict": one.quantity.verdict}


def _overlay(label: str, shown: dict[str, dict[str, Number]]) -> Block:
    """One parameter of all runs, intervals beside each other, with truths and models."""
    data: list[Block] = []
    names = [name for name in shown if label in shown[name]]
    for name in names:
        one, series = shown[name][label], list(shown).index(name)
        data.append({
            "type": "scatter", "mode": "markers", "x": short([one.value], 6), "y": [plain(name)], "showlegend": False,
            "error_x": {"type": "data", "array": short([one.quantity.half or 0.0]), "width": 6, "thickness": 2},
            "marker": {"color": SERIES[series % 4], "symbol": _SYMBOLS[series % 4], "size": 9},
            "hovertemplate": f"%{{x:{one.form}}}<extra></extra>",
        })  # fmt: skip
    for kind, symbol, colour in (("model", "line-ns-open", "--muted"), ("truth", "x-thin-open", "--ink")):
        there = [(name, value) for name in names if (value := getattr(shown[name][label].quantity, kind)) is not None]
        if there:
            data.append({
                "type": "scatter", "mode": "markers", "name": kind, "x": short([value for _, value in there], 6),
                "y": [plain(name) for name, _ in there], "hovertemplate": f"{kind}: %{{x}}<extra></extra>",
                "marker": {"symbol": symbol, "color": colour, "size": 12, "line": {"width": 2, "color": colour}},
            })  # fmt: skip
    layout = axes(label, "")
    layout["yaxis"] = {"type": "category", "autorange": "reversed", "automargin": True}
    caption = "; ".join(f"{name}: {tell(shown[name][label].value, shown[name][label].form)}" for name in names)
    return figure(label, caption, data, layout, height=150 + 34 * len(names))


def _differences(labels: list[str], shown: dict[str, dict[str, Number]], first: str, other: str) -> Block:
    rows: list[list[Cell]] = []
    for label in labels:
        a, b = shown[first].get(label), shown[other].get(label)
        if a is None or b is None:
            continue
        difference, form = b.value - a.value, a.form
        one, two = a.quantity.half, b.quantity.half
        half = None if one is None or two is None else float(np.hypot(one, two))
        differs = half is not None and abs(difference) > half
        said = "" if half is None else "differs" if differs else "within the interval"
        cell: Cell = {"text": tell(difference, "+" + form), "tone": "strong" if differs else ""}
        rows.append([label, cell, "" if half is None else f"\u00b1 {half:{form}}", said])
    return table(["", "|difference", "95 %", ""], rows, f"{other} less {first}")


def _provenance(results: dict[str, Calibration]) -> Block:
    """Facts side by side; those that differ stand out."""
    by_run = {name: facts(result) for name, result in results.items()}
    names = list(dict.fromkeys(fact for of_run in by_run.values() for fact in of_run))
    rows: list[list[Cell]] = []
    for fact in names:
        values = [of_run.get(fact, "\u2013") for of_run in by_run.values()]
        tone = "strong" if len(set(values)) > 1 else ""
        rows.append([fact, *({"text": value, "tone": tone} for value in values)])
    return table(["", *by_run], rows, "Where the runs come from; what differs is bold")
