"""What the terminal shows of repeated calibrations."""

from __future__ import annotations

from collections.abc import Sequence

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from equipoise.calibration.repeatability import Repeated
from equipoise.result.shown import ROWS
from equipoise.terminal.calibration import number

_TOO_MUCH = 2.0  # of spread over deviation, with a handful of repetitions


def print_repeatability(robot: str, repeated: Sequence[Repeated], count: int) -> None:
    """Spread against what the intervals allow."""
    console = Console()
    table = Table(title=f"{robot}: {count} calibrations", title_justify="left", box=box.SIMPLE_HEAD)
    for column in ("parameter", "mean", "spread (sd)", "reported sd", "spread / sd"):
        table.add_column(column, justify="left" if column == "parameter" else "right")
    by_name = {one.quantity.name: one for one in repeated}
    for name, label, factor, form in ROWS:
        if (one := by_name.get(name)) is None:
            continue
        finer = f".{int(form[1]) + 1}f"
        mean, deviation = number(one.quantity.value, factor, form), number(one.quantity.deviation, factor, finer)
        ratio = "-" if one.ratio is None else f"{one.ratio:.2f}"
        table.add_row(escape(label), mean, format(one.spread * factor, finer), deviation, ratio)
    console.print(table)
    worst = [one for one in repeated if one.ratio is not None and one.ratio > _TOO_MUCH]
    if worst:
        names = ", ".join(one.quantity.name for one in worst)
        console.print(f"{names}: they differ by more than they say that they may; something changes between the runs.")
    else:
        console.print(
            "Intervals also cover what is the same in each run (joint zeros, a scale's error), which repeating does not show."
        )
