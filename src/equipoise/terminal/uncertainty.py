"""Where the uncertainty comes from, for people."""

from __future__ import annotations

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from equipoise.result.calibration import Calibration
from equipoise.result.shown import ROWS

_SHOWN = 7  # parameters: mass, CoM, moments


def print_budget(result: Calibration) -> None:
    """Percent of each variance by source, and what would make the largest less; a word where there is no budget."""
    console = Console()
    if not result.budget:
        console.print(f"The method {result.method} does not say where its uncertainty comes from.")
        return
    table = Table(
        title="Where the uncertainty comes from: percent of each variance", title_justify="left", box=box.SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
    )  # fmt: skip
    table.add_column("")
    for _, label, *_ in ROWS[:_SHOWN]:
        table.add_column(escape(short_label(label)), justify="right")
    for source in result.budget:
        table.add_row(escape(source.name), *(percent(share) for share in source.shares[:_SHOWN]))
    console.print(table)
    for line in remedies(result):
        console.print(escape(line))


def short_label(label: str) -> str:
    """Without the unit, and CoM x as x."""
    return label.split(" [", maxsplit=1)[0].removeprefix("CoM ")


def percent(share: float) -> str:
    """A share in whole percent; a point for next to nothing."""
    return f"{100 * share:.0f}" if share >= 0.005 else "."


def remedies(result: Calibration) -> list[str]:
    """For mass, CoM and moments what errs most, by how much, and what would make that less."""
    said: list[str] = []
    for index, ((_, label, factor, form), quantity) in enumerate(zip(ROWS[:_SHOWN], result.composite, strict=False)):
        if quantity.half is not None:
            source = max(result.budget, key=lambda one, of=index: float(one.shares[of]))
            whole, part = quantity.half * factor, quantity.half * factor * float(source.shares[index]) ** 0.5
            said.append(f"{label}: +- {whole:{form}}, most by {source.name}, +- {part:{form}}: {source.remedy}")
    return said
