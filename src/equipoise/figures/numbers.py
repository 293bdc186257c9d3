"""Table of a body's parameters: estimates with intervals, model values and ground truth."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from equipoise.conventions import AXES
from equipoise.figures.blocks import BAR, Cell, DataTable, number
from equipoise.result.body import Body
from equipoise.result.calibration import Calibration
from equipoise.result.legend import frame_message, verdict_message
from equipoise.result.quantity import Quantity
from equipoise.result.shown import ROWS, called

HEADINGS = {
    "composite": "The whole robot at its stance",
    "base": "The base link with everything fixed to it",
    "stance_effective": "The paper's body: base, hips and thighs",
}


@dataclass(frozen=True)
class Number:
    """Estimated quantity in displayed units.

    Attributes:
        label: name and unit.
        form: format specification.
        quantity: the quantity in those units.
    """

    label: str
    form: str
    quantity: Quantity

    @property
    def value(self) -> float:
        """Estimate, in the displayed unit."""
        return self.quantity.value or 0.0

    @property
    def half_width(self) -> str:
        """Formatted half width of the 95 % interval; a dash without one."""
        return number(self.quantity.half_width, 1, self.form)

    def __str__(self) -> str:
        return number(self.value, 1, self.form)


def numbers(result: Calibration, body: str = "composite") -> list[Number]:
    """Return the estimated quantities of a body; without intervals, also the paper's I and C."""
    shown = numbers_of(getattr(result, body))
    return shown if result.has_intervals or body != "composite" else shown + list(_excitations(result))


def numbers_of(body: Body) -> list[Number]:
    """Return the estimated quantities of a body."""
    return [
        Number(label, form, _scaled(quantity, factor))
        for quantity, (_, label, factor, form) in zip(body, ROWS, strict=True)
        if quantity.value is not None
    ]


def _scaled(quantity: Quantity, factor: float) -> Quantity:
    values = {name: getattr(quantity, name) for name in ("value", "std", "model", "truth")}
    return replace(quantity, **{name: None if value is None else value * factor for name, value in values.items()})


def _excitations(result: Calibration) -> Iterator[Number]:
    """Yield moments of inertia I and damping C of the paper."""
    for axis, letter in zip(AXES, "xyz", strict=True):
        if axis in result.moments:
            yield Number(f"I_{letter} ({axis}) [kg m2]", ".4f", result.moments[axis])
        excitation = result.excitations.get(axis)
        if excitation is not None and excitation.damping is not None:
            yield Number(
                f"C_{letter} ({axis}) [Nm s/rad]", ".3f", Quantity(f"C_{letter}", "Nm s/rad", excitation.damping)
            )


def numbers_table(shown: list[Number], title: str) -> DataTable:
    """Return a table of quantities with interval bars, without empty columns."""
    found = [one.quantity for one in shown]
    present = {
        "|95 % +-": any(one.half_width is not None for one in found),
        "verdict": any(one.verdict for one in found),
        "|truth": any(one.truth is not None for one in found),
        "|error": any(one.truth is not None for one in found),
        "|model": any(one.model is not None for one in found),
        "|change": any(one.model is not None for one in found),
    }
    columns = [
        name for name in ("parameter", "|estimate", "|95 % +-", BAR, *list(present)[1:]) if present.get(name, True)
    ]
    return DataTable(title, columns, [_cells(one, columns) for one in shown], style="numbers barred")


def _cells(one: Number, columns: list[str]) -> list[str | Cell]:
    found, form = one.quantity, one.form
    clear = found.half_width is not None and found.change is not None and abs(found.change) > found.half_width
    error = number(found.error, 1, "+" + form) + " (!)" * found.missed
    by_column: Mapping[str, str | Cell] = {
        "parameter": one.label,
        "|estimate": Cell(str(one), "strong"),
        "|95 % +-": one.half_width,
        BAR: Cell(bar=found),
        "verdict": Cell(verdict=found.verdict or ""),
        "|truth": number(found.truth, 1, form),
        "|error": Cell(error, "bad" if found.missed else ""),
        "|model": number(found.model, 1, form),
        "|change": Cell(
            number(found.change, 1, "+" + form), "strong" if clear else "muted" if found.half_width else ""
        ),
    }
    return [by_column[column] for column in columns]


def legend(result: Calibration) -> tuple[str, ...]:
    """Return the sentences below the table: frame, bodies, and the meaning of the verdicts."""
    paper = "I and C are of the body of base, hips and thighs." if result.moments and not result.has_intervals else ""
    return tuple(filter(None, (frame_message(result), paper, verdict_message(result.composite))))


def not_estimated(result: Calibration) -> list[str]:
    """Return the names of the whole robot's parameters without an estimate."""
    return [called(quantity.name) for quantity in result.composite if quantity.value is None]
