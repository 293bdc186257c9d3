"""Report that compares runs of one robot or of several robots."""

from __future__ import annotations

import numpy as np

from equipoise.errors import SettingsError
from equipoise.figures.blocks import Cell, DataTable, PageContents, number
from equipoise.figures.numbers import Number, legend, numbers
from equipoise.figures.plan_view import plan_figures, plan_view
from equipoise.report.contents import alerts
from equipoise.report.provenance import facts
from equipoise.result.calibration import Calibration

_SHARED = (
    "The interval of a difference assumes independent errors of the two runs. Runs of one robot share the errors of joint "
    "offsets, IMU mounting and scale, which cancel: the true interval is narrower."
)


def comparison_contents(results: dict[str, Calibration]) -> PageContents:
    """Return the contents of the comparison page.

    Raises:
        SettingsError: fewer than two runs, or a run that shares no parameter with the others.
    """
    if len(results) < 2:
        raise SettingsError(f"{len(results)} runs cannot be compared; give at least two")
    shown = {name: {one.label: one for one in numbers(result)} for name, result in results.items()}
    _require_shared_parameters(shown, results)
    robots = list(dict.fromkeys(result.robot for result in results.values()))
    labels = list(dict.fromkeys(label for of_run in shown.values() for label in of_run))
    first, *others = results
    sections = {
        "Differences": [_SHARED, *(_differences(labels, shown, first, name) for name in others)],
        "Provenance": [_provenance(results)],
    }
    messages = dict.fromkeys(message for result in results.values() for message in legend(result))
    return PageContents(
        f"{len(results)} runs compared",
        " \u00b7 ".join(robots),
        "" if len(robots) == 1 else f"The runs are of {len(robots)} different robots; the drawing shows the first one.",
        [_side_by_side(labels, shown), *messages, *plan_figures(plan_view(results))],
        sections,
        [(f"{name}: {kind.lower()}", message) for name, result in results.items() for kind, message in alerts(result)],
    )


def _require_shared_parameters(shown: dict[str, dict[str, Number]], results: dict[str, Calibration]) -> None:
    for name, of_run in sorted(shown.items(), key=lambda run: len(run[1])):  # a run of motors has none
        others = [other for one, other in shown.items() if one != name]
        if not any(of_run.keys() & other.keys() for other in others):
            raise SettingsError(
                f"{name!r} (method {results[name].method}) has no mass, CoM or inertia in common with the other runs: leave "
                "it out. 'equipoise report RUN' writes the page of one run"
            )


def _side_by_side(labels: list[str], shown: dict[str, dict[str, Number]]) -> DataTable:
    rows = [[label, *(_cell(of_run.get(label)) for of_run in shown.values())] for label in labels]
    heads = ["parameter", *(f"|{name}" for name in shown)]
    return DataTable("Estimates of each run with 95 % intervals", heads, rows, style="numbers")


def _cell(one: Number | None) -> Cell:
    if one is None:
        return Cell("-")
    half = "" if one.quantity.half_width is None else f" +- {one.half_width}"
    return Cell(f"{one}{half}", verdict=one.quantity.verdict or "")


def _differences(labels: list[str], shown: dict[str, dict[str, Number]], first: str, other: str) -> DataTable:
    rows: list[list[str | Cell]] = []
    for label in labels:
        a, b = shown[first].get(label), shown[other].get(label)
        if a is None or b is None:
            continue
        difference, form = b.value - a.value, a.form
        one, two = a.quantity.half_width, b.quantity.half_width
        half = None if one is None or two is None else float(np.hypot(one, two))
        differs = half is not None and abs(difference) > half
        finding = "" if half is None else "differs" if differs else "within the interval"
        cell = Cell(number(difference, 1, "+" + form), "strong" if differs else "")
        rows.append([label, cell, "" if half is None else number(half, 1, form), finding])
    return DataTable(f"{other} minus {first}", ["parameter", "|difference", "|95 % +-", ""], rows)


def _provenance(results: dict[str, Calibration]) -> DataTable:
    """Return a table of the provenance of all runs, with differences in bold."""
    by_run = {name: facts(result) for name, result in results.items()}
    rows: list[list[str | Cell]] = []
    for fact in dict.fromkeys(fact for of_run in by_run.values() for fact in of_run):
        values = [of_run.get(fact, "-") for of_run in by_run.values()]
        tone = "strong" if len(set(values)) > 1 else ""
        rows.append([fact, *(Cell(value, tone) for value in values)])
    return DataTable("Provenance of the runs; differences are bold", ["fact", *by_run], rows)
