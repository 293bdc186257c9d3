"""Two runs compared, and a calibration that was repeated, in the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape

from equipoise.calibration.repeatability import Repeated
from equipoise.figures.blocks import number
from equipoise.figures.numbers import numbers_of, numbers_table
from equipoise.result.legend import verdict_message
from equipoise.result.shown import ROWS
from equipoise.terminal.rich_tables import print_table, show_table

if TYPE_CHECKING:
    from equipoise.calibration.payload_change import PayloadChange

_NONE = "Nothing that matters was added or taken off. What changed in the whole robot:"
_UNSURE = (
    "It cannot be told whether anything was added or taken off; a scale that weighs both times tells more (--mass-before, "
    "--mass-after). What changed in the whole robot:"
)
_CHANGES = {
    "no change": "no change: zero, and surely so",
    "not identified": "not identified: a change cannot be told from none",
}
_TOO_MUCH = 2.0  # of spread over deviation, with a handful of repetitions


def print_payload_change(delta: PayloadChange) -> None:
    """The payload with intervals, and what it does to the whole robot."""
    console = Console()
    for warning in delta.warnings:
        console.print(f"[yellow]warning:[/yellow] {escape(warning)}")
    what = "taken off" if delta.removed else "added"
    title = f"{delta.robot}: what was {what}; CoM in the base frame, inertia about its own CoM"
    print_table(console, numbers_table(numbers_of(delta.payload), title), without=["|model", "|change"])
    if delta.payload.com_in_base.x.value is None:
        console.print(_NONE if delta.payload.mass.verdict == "no change" else _UNSURE)
    rows = [
        [label, number(one.value, factor, "+" + form), number(one.half_width, factor, form), one.verdict or ""]
        for one, (_, label, factor, form) in zip(delta.change, ROWS, strict=True)
    ]
    show_table("The whole robot at its stance, after less before", ["parameter", "|change", "|95 % +-", ""], rows)
    said = verdict_message(delta.change, _CHANGES)
    console.print(f"CoM from the origin of the base link, inertia about the CoM. {said}")


def print_repeatability(robot: str, repeated: Sequence[Repeated], count: int) -> None:
    """Spread against what the intervals allow."""
    console = Console()
    by_name = {one.quantity.name: one for one in repeated}
    rows: list[list[str]] = []
    for name, label, factor, form in ROWS:
        if (one := by_name.get(name)) is not None:
            finer = f".{int(form[1]) + 1}f"
            mean, std = number(one.quantity.value, factor, form), number(one.quantity.std, factor, finer)
            rows.append([label, mean, number(one.spread, factor, finer), std, number(one.ratio, 1, ".2f")])
    heads = ["parameter", "|mean", "|spread (sd)", "|reported sd", "|spread / sd"]
    show_table(f"{robot}: {count} calibrations", heads, rows)
    worst = [one for one in repeated if one.ratio is not None and one.ratio > _TOO_MUCH]
    if worst:
        names = ", ".join(one.quantity.name for one in worst)
        console.print(f"{names}: they differ by more than they say that they may; something changes between the runs.")
    else:
        console.print(
            "Intervals also cover what is the same in each run (joint offsets, a scale's error), which repeating does "
            "not show."
        )
