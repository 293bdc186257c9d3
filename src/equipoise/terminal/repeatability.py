"""Repeated calibrations in the terminal."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console

from equipoise.calibration.repeatability import Repeated
from equipoise.figures.blocks import number
from equipoise.result.shown import ROWS
from equipoise.terminal.tables import show_table

_TOO_MUCH = 2.0  # of spread over deviation, with a handful of repetitions


def print_repeatability(robot: str, repeated: Sequence[Repeated], count: int) -> None:
    """Spread against what the intervals allow."""
    console = Console()
    by_name = {one.quantity.name: one for one in repeated}
    rows: list[list[str]] = []
    for name, label, factor, form in ROWS:
        if (one := by_name.get(name)) is not None:
            finer = f".{int(form[1]) + 1}f"
            mean, deviation = number(one.quantity.value, factor, form), number(one.quantity.deviation, factor, finer)
            rows.append([label, mean, number(one.spread, factor, finer), deviation, number(one.ratio, 1, ".2f")])
    heads = ["parameter", "|mean", "|spread (sd)", "|reported sd", "|spread / sd"]
    show_table(f"{robot}: {count} calibrations", heads, rows)
    worst = [one for one in repeated if one.ratio is not None and one.ratio > _TOO_MUCH]
    if worst:
        names = ", ".join(one.quantity.name for one in worst)
        console.print(f"{names}: they differ by more than they say that they may; something changes between the runs.")
    else:
        console.print(
            "Intervals also cover what is the same in each run (joint zeros, a scale's error), which repeating does not show."
        )
