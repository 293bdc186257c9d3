"""A balancing robot in the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from equipoise.lab.balance.report import BalanceReport
from equipoise.lab.pages.balance import balance_table, sentences, title
from equipoise.terminal.tables import print_table


def print_balance(report: BalanceReport, files: Sequence[Path]) -> None:
    """Print a column for each diagonal, and the verdicts."""
    console = Console()
    print_table(console, replace(balance_table(report), title=title(report)))
    for sentence in sentences(report):
        console.print(escape(sentence))
    console.print("saved: " + escape(", ".join(map(str, files))), soft_wrap=True)
