"""Table of a body's parameters: estimates with intervals, model values and ground truth."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from equipoise.conventions import AXES
from equipoise.figures.blocks import BAR, Cell, DataTable, number
from equipoise.result.body import Body
from equipoise.result.calibration import Calibration
from equipoise.result.legend import frame_message, verdict_message
from equipoise.result.quantity import Quantity
from equipoise.result.shown import SHOWN, called

HEADINGS = {
    "composite": "The whole robot at its stance",
    "base": "The base link with everything fixed to it",
    "stance_effective": "The paper's body: base, hips and thighs",
}


def numbers(result: Calibration, body: str = "composite") -> list[Quantity]:
    """Return the estimated quantities of a body; without intervals, also the paper's I and C."""
    found = estimated(getattr(result, body))
    return found if result.has_intervals or body != "composite" else found + list(_excitations(result))


def estimated(body: Body) -> list[Quantity]:
    """Return the estimated quantities of a body."""
    return [quantity for quantity in body if quantity.value is not None]


def _excitations(result: Calibration) -> Iterator[Quantity]:
    """Yield moments of inertia I and damping C of the paper."""
    for axis, letter in zip(AXES, "xyz", strict=True):
        if axis in result.moments:
            yield result.moments[axis]
        excitation = result.excitations.get(axis)
        if excitation is not None and excitation.damping is not None:
            yield Quantity(f"C_{letter}", "Nm s/rad", excitation.damping)


def in_shown_unit(quantity: Quantity, value: float | None, sign: str = "") -> str:
    """Return a value of a quantity, such as its half width, with the digits of its table; a dash for None.

    Args:
        value: value in the SI unit.
        sign: "+" for a sign in front of positive values.
    """
    row = SHOWN[quantity.name]
    return number(value, row.factor, sign + row.form)


def numbers_table(found: list[Quantity], title: str) -> DataTable:
    """Return a table of quantities with interval bars, without empty columns."""

    def given(attribute: str) -> bool:
        return any(getattr(one, attribute) is not None for one in found)

    columns = ["parameter", "|estimate"]
    columns += ["|95 % +-", BAR] if given("half_width") else [BAR]
    columns += ["verdict"] if given("verdict") else []
    columns += ["|truth", "|error"] if given("truth") else []
    columns += ["|model", "|change"] if given("model") else []
    return DataTable(title, columns, [_cells(one, columns) for one in found], style="numbers barred")


def _cells(found: Quantity, columns: list[str]) -> list[str | Cell]:
    clear = found.half_width is not None and found.change is not None and abs(found.change) > found.half_width
    error = in_shown_unit(found, found.error, "+") + " (!)" * found.missed
    tone = "strong" if clear else "muted" if found.half_width else ""
    by_column: Mapping[str, str | Cell] = {
        "parameter": SHOWN[found.name].label,
        "|estimate": Cell(in_shown_unit(found, found.value), "strong"),
        "|95 % +-": in_shown_unit(found, found.half_width),
        BAR: Cell(bar=found),
        "verdict": Cell(verdict=found.verdict or ""),
        "|truth": in_shown_unit(found, found.truth),
        "|error": Cell(error, "bad" if found.missed else ""),
        "|model": in_shown_unit(found, found.model),
        "|change": Cell(in_shown_unit(found, found.change, "+"), tone),
    }
    return [by_column[column] for column in columns]


def legend(result: Calibration) -> tuple[str, ...]:
    """Return the sentences below the table: frame, bodies, and the meaning of the verdicts."""
    paper = "I and C are of the body of base, hips and thighs." if result.moments and not result.has_intervals else ""
    return tuple(filter(None, (frame_message(result), paper, verdict_message(result.composite))))


def not_estimated(result: Calibration) -> list[str]:
    """Return the names of the whole robot's parameters without an estimate."""
    return [called(quantity.name) for quantity in result.composite if quantity.value is None]
