"""Tables in the terminal."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from equipoise.figures.blocks import BAR, LONG, Block, DataTable

_WIDE = 5  # with more columns, units are on a separate line
_UNLIMITED = 1000


def print_table(console: Console, table: DataTable, without: Collection[str] = ()) -> None:
    """Print a table without its columns of bars. Nothing is cut: a wide table has narrow gaps, or exceeds the terminal.

    Args:
        without: heads of further columns to omit.
    """
    chosen = [index for index, head in enumerate(table.columns) if head not in {BAR, *without}]
    between = "\n[" if len(chosen) > _WIDE else " ["
    drawn = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), show_header=any(table.columns))
    widths = {index: max((len(str(row[index])) for row in table.rows), default=0) for index in chosen}
    one_is_long = any(width > LONG for width in widths.values())  # and wraps in place of the others
    for index, width in widths.items():
        head = table.columns[index]
        words, right = escape(head.removeprefix("|").replace(" [", between)), head.startswith("|")
        least = width if right or (one_is_long and width <= LONG) else None
        drawn.add_column(
            words, justify="right" if right else "left", no_wrap=least is not None, min_width=least, overflow="fold"
        )
    for row in table.rows:
        drawn.add_row(*(escape(str(row[index])) for index in chosen))
    if table.title:
        console.print(f"[italic]{escape(table.title)}[/italic]")
    if _least_width(console, drawn) > console.width:
        drawn.padding = 0
    if (width := _least_width(console, drawn)) > console.width:
        drawn.width = width
    console.print(drawn, crop=False)


def _least_width(console: Console, drawn: Table) -> int:
    return console.measure(drawn, options=console.options.update(width=_UNLIMITED)).minimum


def show_table(
    title: str, columns: Sequence[str], rows: Sequence[Sequence[str]], console: Console | None = None
) -> None:
    """Print a table of strings."""
    print_table(console or Console(), DataTable(title, columns, rows))


def print_wrapped(console: Console, text: str, **style: Any) -> None:
    """Print markup, wrapped between words at a terminal and on one line elsewhere."""
    console.print(text, soft_wrap=not console.is_terminal, **style)


def print_saved(console: Console, files: Sequence[Path]) -> None:
    """Print the paths of the written files, if any."""
    if files:
        console.print("saved: " + escape(", ".join(map(str, files))), soft_wrap=True)


def print_block(console: Console, block: Block) -> None:
    """Print a paragraph, a list or a table; figures are not printed."""
    if isinstance(block, DataTable):
        print_table(console, block)
    elif isinstance(block, str):
        console.print(escape(block))
    elif isinstance(block, tuple):
        for item in block:
            console.print(escape(f"  {item}"), soft_wrap=True)
