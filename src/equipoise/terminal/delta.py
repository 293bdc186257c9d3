"""What the terminal shows of what was added to a robot."""

from __future__ import annotations

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from equipoise.calibration.delta import Delta
from equipoise.result.calibration import BodyEstimate
from equipoise.terminal.calibration import ROWS


def print_delta(delta: Delta) -> None:
    """The payload with intervals, and what it does to the whole robot."""
    console = Console()
    for warning in delta.warnings:
        console.print(f"[yellow]warning:[/yellow] {escape(warning)}")
    what = "taken off" if delta.removed else "added"
    title = f"{delta.robot}: what was {what}; CoM in the base frame, inertia about its own CoM"
    console.print(f"[italic]{escape(title)}[/italic]")  # wider than its table
    console.print(_payload(delta))
    if delta.payload.inertia is None:
        console.print("No mass can be told from none: nothing is said of where it is. What changed in the whole robot:")
    console.print(_change(delta))


def _payload(delta: Delta) -> Table:
    truth = {} if delta.truth is None else BodyEstimate.known(delta.truth).by_name()
    table = Table(box=box.SIMPLE_HEAD)
    for column in ("parameter", "estimate", "95 % +-", "", *(("truth", "error") if truth else ())):
        table.add_column(column, justify="left" if column in ("parameter", "") else "right")
    values = delta.payload.by_name()
    for name, label, factor, form in ROWS:
        if (value := values[name]) is None:
            continue
        interval = delta.intervals[name]
        half = (interval.upper - interval.lower) / 2
        cells = [escape(label), format(value * factor, form), format(half * factor, form), interval.verdict]
        if (true := truth.get(name)) is not None:
            outside = "" if abs(value - true) <= half else " (!)"
            cells += [format(true * factor, form), format((value - true) * factor, "+" + form) + outside]
        table.add_row(*cells)
    return table


def _change(delta: Delta) -> Table:
    title = "The whole robot at its stance, after less before"
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD)
    for column in ("parameter", "change", "95 % +-", ""):
        table.add_column(column, justify="left" if column in ("parameter", "") else "right")
    for name, label, factor, form in ROWS:
        interval = delta.change_intervals[name]
        half = (interval.upper - interval.lower) / 2
        table.add_row(
            escape(label),
            format(delta.change[name] * factor, "+" + form),
            format(half * factor, form),
            interval.verdict,
        )
    return table
