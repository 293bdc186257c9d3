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


def print_formats(available: Mapping[str, Format | EquipoiseError]) -> None:
    """Print the table of formats, and a warning for each that cannot be used."""
    formats = [row for row in available.values() if isinstance(row, Format)]
    console = Console()
    rows = [[row.name, ",".join(row.holds), row.where, _FILES[row.file]] for row in formats]
    show_table("", ["--to", "writes", "for", "edits"], rows, console)
    for row in available.values():
        if isinstance(row, EquipoiseError):
            console.print(f"[yellow]warning:[/yellow] {escape(str(row))}", soft_wrap=True)
    linked = ", ".join(row.name for row in formats if row.payload)
    console.print(
        "base: base link with the links that are fixed or locked to it; composite: the whole robot frozen at its stance;\n"
        "sensors: joint offsets, IMU, clock; motors: friction, armature, gain, delay. Select with --parameters.\n"
        f"--add-payload-link writes the payload as a separate link; formats: {linked}.\n"
        "Next: equipoise export RUN --to FORMAT. Checks for each format: docs/reference/exports.md",
        soft_wrap=True,
    )


def print_exports(
    written: Mapping[str, Export], paths: Mapping[str, Path], refused: Mapping[str, EquipoiseError]
) -> None:
    """Print warnings, each once, the contents and path of each file, and the reason for each format not written."""
    console = Console()
    for note in dict.fromkeys(note for one in written.values() for note in one.notes):
        console.print(f"[yellow]warning:[/yellow] {escape(note)}", soft_wrap=True)
    for name, path in paths.items():
        console.print(escape(f"{name}: {written[name].contents}; saved: {path}"), soft_wrap=True, highlight=False)
    for name, error in refused.items():
        console.print(escape(f"{name}: not written: {error}"), soft_wrap=True, highlight=False)


def print_export(written: Export, path: Path) -> None:
    """Print the path of an export and its warnings; short generated texts are printed in full."""
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
