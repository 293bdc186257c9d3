"""What the terminal shows of lifts that were played again."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from equipoise.lab.replay.validation import Validation


def print_validation(found: Validation, files: Sequence[Path]) -> None:
    """A row for each body that was played, and the answer.

    Args:
        files: paths of the files that were written.
    """
    console, table = Console(), Table(box=box.SIMPLE_HEAD)
    for column in ("body", "tilt off, rms [mm]", "times this run's", "joints off, at most [mrad]"):
        table.add_column(escape(column), justify="left" if column == "body" else "right")
    for body in found.bodies:
        table.add_row(
            escape(body), f"{1000 * found.error(body):.2f}", f"{found.ratio(body):.1f}",
            f"{1000 * found.joint_errors[body]:.1f}",
        )  # fmt: skip
    console.print(table)
    console.print(escape(f"{found.sentence}."))
    if files:
        console.print("saved: " + escape(", ".join(map(str, files))), soft_wrap=True)
