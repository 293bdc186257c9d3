"""Exports and the table of formats in the terminal."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from equipoise.errors import EquipoiseError
from equipoise.exports.formats import Export, Format
from equipoise.terminal.rich_tables import show_table

_SHORT = 40  # lines that fit on a screen
_FILES = {"model": "model file", "given": "--file", "": ""}


def print_formats(known: Mapping[str, Format | EquipoiseError]) -> None:
    """All formats: what each wants, and where it goes; or why one cannot be used."""
    formats = [row for row in known.values() if isinstance(row, Format)]
    console = Console()
    rows = [[row.name, ",".join(row.holds), row.where, _FILES[row.file]] for row in formats]
    show_table("", ["--to", "writes", "for", "edits"], rows, console)
    for row in known.values():
        if isinstance(row, EquipoiseError):
            console.print(f"[yellow]warning:[/yellow] {escape(str(row))}", soft_wrap=True)
    linked = ", ".join(row.name for row in formats if row.payload)
    console.print(
        "base: the base link with all that is fixed to it or held; composite: the whole robot frozen at its stance;\n"
        "sensors: joint offsets, IMU, clock; motors: friction, armature, gain, delay. --parameters says which of them.\n"
        f"--add-payload-link, which writes what was added as a link of its own, is for {linked}.\n"
        "Next: equipoise export RUN --to FORMAT. What to check there: docs/reference/exports.md",
        soft_wrap=True,
    )


def print_exports(
    written: Mapping[str, Export], paths: Mapping[str, Path], refused: Mapping[str, EquipoiseError]
) -> None:
    """Print what each file holds and its warnings, each sentence once; then what was not written, with the reason."""
    console = Console()
    for note in dict.fromkeys(note for one in written.values() for note in one.notes):
        console.print(f"[yellow]warning:[/yellow] {escape(note)}", soft_wrap=True)
    for name, path in paths.items():
        console.print(escape(f"{name}: {written[name].contents}; saved: {path}"), soft_wrap=True, highlight=False)
    for name, error in refused.items():
        console.print(escape(f"{name}: not written: {error}"), soft_wrap=True, highlight=False)


def print_export(written: Export, path: Path) -> None:
    """Print the path of an export and its warnings; short texts of ours are shown whole."""
    console = Console()
    for note in written.notes:
        console.print(f"[yellow]warning:[/yellow] {escape(note)}", soft_wrap=True)
    lines = written.text.splitlines() if not written.format.file else []
    if 0 < len(lines) <= _SHORT:
        print(written.text, end="")
    else:
        for line in written.header[: len(written.header) - len(written.notes)]:
            console.print(escape(line), soft_wrap=True, highlight=False)
    console.print(f"saved: {escape(str(path))}", soft_wrap=True)
