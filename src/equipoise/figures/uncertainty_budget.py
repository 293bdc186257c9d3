"""Uncertainty budget: shares of the variances by source, and remedies for the largest sources."""

from __future__ import annotations

from equipoise.figures.blocks import Cell, DataTable
from equipoise.result.calibration import Calibration
from equipoise.result.shown import ROWS

REMEDY = "remedy"
_SHOWN = ROWS[:7]  # mass, CoM, moments


def uncertainty_table(result: Calibration) -> DataTable:
    """Return the table of variance shares [%] by source, with the largest of each column in bold."""
    largest = [max(float(source.shares[index]) for source in result.uncertainty_budget) for index in range(len(_SHOWN))]
    rows: list[list[str | Cell]] = []
    for source in result.uncertainty_budget:
        shares = zip(source.shares, largest, strict=False)
        cells = [Cell(_percent(share), "strong" if share == most else "") for share, most in shares]
        rows.append([source.name, *cells, source.remedy])
    heads = ["source", *(f"|{row.words.removeprefix('CoM ')}" for row in _SHOWN), REMEDY]
    return DataTable("Uncertainty budget: share of each variance [%]", heads, rows, style="shares")


def _percent(share: float) -> str:
    return f"{100 * share:.0f}" if share >= 0.005 else "."


def remedies(result: Calibration) -> tuple[str, ...]:
    """Return the largest source of uncertainty of each parameter, with its contribution and remedy."""
    lines: list[str] = []
    for index, (row, quantity) in enumerate(zip(_SHOWN, result.composite, strict=False)):
        if quantity.half_width is not None:
            source = max(result.uncertainty_budget, key=lambda one, of=index: float(one.shares[of]))
            whole = quantity.half_width * row.factor
            part = whole * float(source.shares[index]) ** 0.5
            halves = f"+- {whole:{row.form}}; largest source: {source.name}, +- {part:{row.form}}"
            lines.append(f"{row.label}: {halves}: {source.remedy}")
    return tuple(lines)
