"""What the terminal shows of what was added to a robot."""

from __future__ import annotations

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from equipoise.calibration.delta import Delta
from equipoise.result.legend import verdict_sentence
from equipoise.result.shown import ROWS
from equipoise.terminal.calibration import estimate_cells, number


def print_delta(delta: Delta) -> None:
    """The payload with intervals, and what it does to the whole robot."""
    console = Console()
    for warning in delta.warnings:
        console.print(f"[yellow]warning:[/yellow] {escape(warning)}")
    what = "taken off" if delta.removed else "added"
    title = f"{delta.robot}: what was {what}; CoM in the base frame, inertia about its own CoM"
    console.print(f"[italic]{escape(title)}[/italic]")  # wider than its table
    console.print(_payload(delta))
    if delta.payload.com_in_base.x.value is None:
        console.print(_NONE if delta.payload.mass.verdict == "no change" else _UNSURE)
    console.print(_change(delta))
    said = verdict_sentence(delta.change, _CHANGES)
    console.print(f"CoM from the origin of the base link, inertia about the CoM. {said}")


_NONE = "Nothing that matters was added or taken off. What changed in the whole robot:"
_UNSURE = (
    "It cannot be told whether anything was added or taken off; a scale that weighs both times tells more (--mass-before, "
    "--mass-after). What changed in the whole robot:"
)
_CHANGES = {
    "no change": "no change: zero, and surely so",
    "not identified": "not identified: a change cannot be told from none",
}


def _payload(delta: Delta) -> Table:
    known = delta.payload.truth is not None
    table = Table(box=box.SIMPLE_HEAD)
    for column in ("parameter", "estimate", "95 % +-", "", *(("truth", "error") if known else ())):
        table.add_column(column, justify="left" if column in ("parameter", "") else "right")
    for quantity, (_, label, factor, form) in zip(delta.payload, ROWS, strict=True):
        if quantity.value is not None:
            table.add_row(escape(label), *estimate_cells(quantity, factor, form, known))
    return table


def _change(delta: Delta) -> Table:
    title = "The whole robot at its stance, after less before"
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD)
    for column in ("parameter", "change", "95 % +-", ""):
        table.add_column(column, justify="left" if column in ("parameter", "") else "right")
    for quantity, (_, label, factor, form) in zip(delta.change, ROWS, strict=True):
        change, half = number(quantity.value, factor, "+" + form), number(quantity.half, factor, form)
        table.add_row(escape(label), change, half, quantity.verdict)
    return table
