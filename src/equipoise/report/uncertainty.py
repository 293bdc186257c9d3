"""Where the uncertainty comes from; method `precise`."""

from __future__ import annotations

from equipoise.report.blocks import Block, Cell, items, table
from equipoise.result.calibration import Calibration
from equipoise.result.shown import ROWS
from equipoise.terminal.uncertainty import percent, remedies, short_label

_SHOWN = ROWS[:7]


def uncertainty_blocks(result: Calibration) -> list[Block]:
    """Percent of each variance by source, and what would make the largest less."""
    if not result.budget:
        return []
    largest = [max(float(source.shares[index]) for source in result.budget) for index in range(len(_SHOWN))]
    rows: list[list[Cell]] = []
    for source in result.budget:
        shares = zip(source.shares[: len(_SHOWN)], largest, strict=True)
        cells = [{"text": percent(share), "tone": "strong" if share == most else ""} for share, most in shares]
        rows.append([source.name, *cells, source.remedy])
    columns = ["errors of", *(f"|{short_label(label)}" for _, label, *_ in _SHOWN), "what would make them less"]
    said = (sentence.replace("+-", "\u00b1") for sentence in remedies(result))
    return [table(columns, rows, "Percent of each variance; a column adds up to 100"), items(said)]
