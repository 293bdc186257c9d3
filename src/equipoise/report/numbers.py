"""The numbers: what was found with its interval, beside the model file and the truth; the same for every body."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from equipoise.conventions import AXES
from equipoise.report.blocks import Block, Cell, table
from equipoise.result.calibration import Calibration
from equipoise.result.quantity import Quantity
from equipoise.result.shown import ROWS

BODIES = {
    "composite": "the whole robot at its stance",
    "base": "the base link with all that is fixed to it",
    "stance_effective": "the paper's body: base, hips and thighs",
}
_MARGIN = 0.08  # of a bar's width, kept free at either end


@dataclass(frozen=True)
class Number:
    """One quantity in the units that people see.

    Attributes:
        label: with the unit.
        form: of the numbers.
        quantity: with a value, in those units.
    """

    label: str
    form: str
    quantity: Quantity

    @property
    def value(self) -> float:
        """Estimate."""
        return self.quantity.value or 0.0


def numbers(result: Calibration, body: str = "composite") -> list[Number]:
    """All that is known of a body, and of the paper's I and C if that is all there is."""
    shown = [
        Number(label, form, _scaled(quantity, factor))
        for quantity, (_, label, factor, form) in zip(getattr(result, body), ROWS, strict=True)
        if quantity.value is not None
    ]
    return shown if result.has_intervals or body != "composite" else shown + list(_sways(result))


def _scaled(quantity: Quantity, factor: float) -> Quantity:
    """In units of which so many make the SI unit."""
    numbers = {name: getattr(quantity, name) for name in ("value", "deviation", "model", "truth")}
    return replace(quantity, **{name: None if value is None else value * factor for name, value in numbers.items()})


def _sways(result: Calibration) -> Iterator[Number]:
    """The paper's I, which is meant to be of its own body, and C."""
    for axis, letter in zip(AXES, "xyz", strict=True):
        if axis in result.moments:
            yield Number(f"I_{letter} ({axis}) [kg m2]", ".4f", result.moments[axis])
        sway = result.sways.get(axis)
        if sway is not None and sway.damping is not None:
            yield Number(f"C_{letter} ({axis}) [Nm s/rad]", ".3f", Quantity(f"C_{letter}", "Nm s/rad", sway.damping))


def numbers_table(shown: list[Number], caption: str) -> Block:
    """With a bar for each interval; columns that would be empty are left out."""
    columns = ["", "|estimate"]
    columns += ["95 %"] if any(one.quantity.half is not None for one in shown) else []
    columns += ["interval"]
    columns += ["verdict"] if any(one.quantity.verdict for one in shown) else []
    columns += ["|truth", "|error"] if any(one.quantity.truth is not None for one in shown) else []
    columns += ["|model", "|change"]
    return table(columns, [_cells(one, columns) for one in shown], caption, kind="numbers barred")


def _cells(one: Number, columns: list[str]) -> list[Cell]:
    half, error, change = one.quantity.half, one.quantity.error, one.quantity.change
    outside = one.quantity.missed
    clear = half is not None and change is not None and abs(change) > half
    by_column: Mapping[str, Cell] = {
        "": one.label,
        "|estimate": {"text": tell(one.value, one.form), "tone": "strong"},
        "95 %": "" if half is None else f"\u00b1 {half:{one.form}}",
        "verdict": {"verdict": one.quantity.verdict or ""},
        "|truth": tell(one.quantity.truth, one.form),
        "|error": {"text": tell(error, "+" + one.form) + (" (!)" if outside else ""), "tone": "bad" if outside else ""},
        "|model": tell(one.quantity.model, one.form),
        "|change": {"text": tell(change, "+" + one.form), "tone": "strong" if clear else "muted" if half else ""},
    }
    return [by_column.get(column, {"bar": bar(one)}) for column in columns]


def bar(one: Number) -> Block:
    """Where interval, estimate and marks lie between the ends of a bar, from 0 to 1."""
    found = one.quantity
    marks = {"model": found.model, "truth": found.truth}
    values = [value for value in (found.value, found.lower, found.upper, *marks.values()) if value is not None]
    low, high = min(values), max(values)
    span = (high - low) or 1.0

    def place(value: float | None) -> float | None:
        return None if value is None else round(_MARGIN + (1 - 2 * _MARGIN) * (value - low) / span, 4)

    places = {name: place(value) for name, value in marks.items() if value is not None}
    lower, upper, value = place(found.lower), place(found.upper), place(found.value)
    return {"low": lower, "high": upper, "value": value, "marks": places}


def tell(value: float | None, form: str) -> str:
    """A number, with a true minus sign and without a minus zero; a dash if it is not known."""
    if value is None:
        return "\u2013"
    said = format(value, form)
    if not any(digit in said for digit in "123456789"):
        said = said.replace("-", "+" if form.startswith("+") else "")
    return said.replace("-", "\u2212")
