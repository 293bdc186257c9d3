"""Report that compares runs of one robot or of several robots."""

from __future__ import annotations

import numpy as np

from equipoise.errors import SettingsError
from equipoise.figures.blocks import Cell, DataTable, PageContents
from equipoise.figures.numbers import in_shown_unit, legend, numbers
from equipoise.figures.plan_view import plan_figures, plan_view
from equipoise.report.contents import alerts
from equipoise.report.provenance import facts
from equipoise.result.calibration import Calibration
from equipoise.result.quantity import Quantity
from equipoise.result.shown import SHOWN

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
    shown = {name: {one.name: one for one in numbers(result)} for name, result in results.items()}
    _require_shared_parameters(shown, results)
    robots = list(dict.fromkeys(result.robot for result in results.values()))
    parameters = list(dict.fromkeys(parameter for of_run in shown.values() for parameter in of_run))
    first, *others = results
    sections = {
        "Differences": [_SHARED, *(_differences(parameters, shown, first, name) for name in others)],
        "Provenance": [_provenance(results)],
    }
    messages = dict.fromkeys(message for result in results.values() for message in legend(result))
    return PageContents(
        f"{len(results)} runs compared",
        " \u00b7 ".join(robots),
        "" if len(robots) == 1 else f"The runs are of {len(robots)} different robots; the drawing shows the first one.",
        [_side_by_side(parameters, shown), *messages, *plan_figures(plan_view(results))],
        sections,
        [(f"{name}: {kind.lower()}", message) for name, result in results.items() for kind, message in alerts(result)],
    )


def _require_shared_parameters(shown: dict[str, dict[str, Quantity]], results: dict[str, Calibration]) -> None:
    for name, of_run in sorted(shown.items(), key=lambda run: len(run[1])):  # a run of motors has none
        others = [other for one, other in shown.items() if one != name]
        if not any(of_run.keys() & other.keys() for other in others):
            raise SettingsError(
                f"{name!r} (method {results[name].method}) has no mass, CoM or inertia in common with the other runs: leave "
                "it out. 'equipoise report RUN' writes the page of one run"
            )


def _side_by_side(parameters: list[str], shown: dict[str, dict[str, Quantity]]) -> DataTable:
    rows = [[SHOWN[one].label, *(_cell(of_run.get(one)) for of_run in shown.values())] for one in parameters]
    heads = ["parameter", *(f"|{name}" for name in shown)]
    return DataTable("Estimates of each run with 95 % intervals", heads, rows, style="numbers")


def _cell(one: Quantity | None) -> Cell:
    if one is None:
        return Cell("-")
    half = "" if one.half_width is None else f" +- {in_shown_unit(one, one.half_width)}"
    return Cell(in_shown_unit(one, one.value) + half, verdict=one.verdict or "")


def _differences(parameters: list[str], shown: dict[str, dict[str, Quantity]], first: str, other: str) -> DataTable:
    rows: list[list[str | Cell]] = []
    for parameter in parameters:
        a, b = shown[first].get(parameter), shown[other].get(parameter)
        if a is None or b is None or a.value is None or b.value is None:
            continue
        difference, one, two = b.value - a.value, a.half_width, b.half_width
        half = None if one is None or two is None else float(np.hypot(one, two))
        differs = half is not None and abs(difference) > half
        finding = "" if half is None else "differs" if differs else "within the interval"
        cell = Cell(in_shown_unit(a, difference, "+"), "strong" if differs else "")
        rows.append([SHOWN[parameter].label, cell, "" if half is None else in_shown_unit(a, half), finding])
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
