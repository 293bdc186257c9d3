"""Replayed lifts in the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from equipoise.lab.pages.validation import validation_table
from equipoise.lab.replay.validation import Validation
from equipoise.terminal.tables import print_table


def print_validation(found: Validation, files: Sequence[Path]) -> None:
    """Print a row for each body that was replayed, and the answer.

    Args:
        files: paths of the files that were written.
    """
    console = Console()
    print_table(console, validation_table(found))
    console.print(escape(f"{found.sentence}."))
    if files:
        console.print("saved: " + escape(", ".join(map(str, files))), soft_wrap=True)
