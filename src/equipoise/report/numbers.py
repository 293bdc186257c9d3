"""The numbers: what was found with its interval, beside the model file and the truth; the same for every body."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from equipoise.conventions import AXES
from equipoise.report.blocks import Block, Cell, table
from equipoise.result.calibration import BodyEstimate, Calibration, Interval
from equipoise.terminal.calibration import ROWS

BODIES = {
    "composite": "the whole robot at its stance",
    "base": "the base link with all that is fixed to it",
    "stance_effective": "the paper's body: base, hips and thighs",
}
_MARGIN = 0.08  # of a bar's width, kept free at either end


@dataclass(frozen=True)
class Number:
    """One parameter, in the units that people see.

    Attributes:
        label: with the unit.
        form: of the numbers.
        value, lower, upper: estimate and 95 % interval; None: not estimated, or without one.
        verdict: of the interval.
        truth, model: in simulation, and by the model file.
    """

    label: str
    form: str
    value: float
    lower: float | None = None
    upper: float | None = None
    verdict: str | None = None
    truth: float | None = None
    model: float | None = None

    @property
    def half(self) -> float | None:
        """Half the interval."""
        return None if self.lower is None or self.upper is None else (self.upper - self.lower) / 2

    @property
    def change(self) -> float | None:
        """Estimate less the model's value."""
        return None if self.model is None else self.value - self.model

    @property
    def error(self) -> float | None:
        """Estimate less truth."""
        return None if self.truth is None else self.value - self.truth


def numbers(result: Calibration, body: str = "composite") -> list[Number]:
    """All that is known of a body, and of the paper's I and C if that is all there is."""
    estimate: BodyEstimate = getattr(result, body)
    found = estimate.by_name()
    truth = {} if result.truth is None else BodyEstimate.known(getattr(result.truth, body)).by_name()
    model = BodyEstimate.known(getattr(result.nominal, body)).by_name()
    intervals: Mapping[str, Interval] = result.uncertainty[body].intervals if body in result.uncertainty else {}
    shown = [
        _number(label, form, factor, value, intervals.get(name), truth.get(name), model.get(name))
        for name, label, factor, form in ROWS
        if (value := found[name]) is not None
    ]
    return shown if result.uncertainty or body != "composite" else shown + list(_sways(result))


def _number(
    label: str, form: str, factor: float, value: float, interval: Interval | None, truth: float | None,
    model: float | None,
) -> Number:  # fmt: skip
    def scaled(number: float | None) -> float | None:
        return None if number is None else number * factor

    lower, upper, verdict = (None, None, None)
    if interval is not None:
        lower, upper, verdict = scaled(interval.lower), scaled(interval.upper), interval.verdict
    return Number(label, form, value * factor, lower, upper, verdict, scaled(truth), scaled(model))


def _sways(result: Calibration) -> Iterator[Number]:
    """The paper's I, which is meant to be of its own body, and C."""
    for index, (axis, letter) in enumerate(zip(AXES, "xyz", strict=True)):
        sway = result.sways.get(axis)
        if sway is not None and sway.moment is not None:
            truth = None if result.truth is None else float(result.truth.stance_effective.inertia[index, index])
            model = float(result.nominal.stance_effective.inertia[index, index])
            yield Number(f"I_{letter} ({axis}) [kg m2]", ".4f", sway.moment, truth=truth, model=model)
        if sway is not None and sway.damping is not None:
            yield Number(f"C_{letter} ({axis}) [Nm s/rad]", ".3f", sway.damping)


def numbers_table(shown: list[Number], caption: str) -> Block:
    """With a bar for each interval; columns that would be empty are left out."""
    columns = ["", "|estimate"]
    columns += ["95 %"] if any(one.half is not None for one in shown) else []
    columns += ["interval"]
    columns += ["verdict"] if any(one.verdict for one in shown) else []
    columns += ["|truth", "|error"] if any(one.truth is not None for one in shown) else []
    columns += ["|model", "|change"]
    return table(columns, [_cells(one, columns) for one in shown], caption, kind="numbers")


def _cells(one: Number, columns: list[str]) -> list[Cell]:
    half, error, change = one.half, one.error, one.change
    outside = half is not None and error is not None and abs(error) > half
    clear = half is not None and change is not None and abs(change) > half
    by_column: Mapping[str, Cell] = {
        "": one.label,
        "|estimate": {"text": tell(one.value, one.form), "tone": "strong"},
        "95 %": "" if half is None else f"\u00b1 {half:{one.form}}",
        "verdict": {"verdict": one.verdict or ""},
        "|truth": tell(one.truth, one.form),
        "|error": {"text": tell(error, "+" + one.form) + (" (!)" if outside else ""), "tone": "bad" if outside else ""},
        "|model": tell(one.model, one.form),
        "|change": {"text": tell(change, "+" + one.form), "tone": "strong" if clear else "muted" if half else ""},
    }
    return [by_column.get(column, {"bar": bar(one)}) for column in columns]


def bar(one: Number) -> Block:
    """Where interval, estimate and marks lie between the ends of a bar, from 0 to 1."""
    marks = {"model": one.model, "truth": one.truth}
    values = [value for value in (one.value, one.lower, one.upper, *marks.values()) if value is not None]
    low, high = min(values), max(values)
    span = (high - low) or 1.0

    def place(value: float | None) -> float | None:
        return None if value is None else round(_MARGIN + (1 - 2 * _MARGIN) * (value - low) / span, 4)

    places = {name: place(value) for name, value in marks.items() if value is not None}
    lower, upper, value = place(one.lower), place(one.upper), place(one.value)
    return {"low": lower, "high": upper, "value": value, "marks": places}


def tell(value: float | None, form: str) -> str:
    """A number, with a true minus sign and without a minus zero; a dash if it is not known."""
    if value is None:
        return "\u2013"
    said = format(value, form)
    if not any(digit in said for digit in "123456789"):
        said = said.replace("-", "+" if form.startswith("+") else "")
    return said.replace("-", "\u2212")
