"""Exports and the table of formats in the terminal."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from equipoise.errors import EquipoiseError
from equipoise.exports.acceptance import ParameterNote
from equipoise.exports.formats import Export, Format
from equipoise.terminal.rich_tables import print_wrapped, show_table

_SHORT = 40  # lines that fit on a screen
_FILES = {"model": "model file", "given": "--file", "": ""}


def print_formats(
    available: Mapping[str, Format | EquipoiseError], of_run: Mapping[str, Export | EquipoiseError]
) -> None:
    """Print the table of formats, and a warning for each that cannot be used.

    Args:
        of_run: a run in each format, or the reason why it cannot be written; empty without a run.
    """
    formats = [row for row in available.values() if isinstance(row, Format)]
    refused = {row.name: one for row in formats if isinstance(one := of_run.get(row.name), EquipoiseError)}
    console = Console()
    shown = [one.format for one in of_run.values() if isinstance(one, Export)] if of_run else formats
    rows = [[row.name, _held(row), row.where, _FILES[row.file]] for row in shown]
    show_table("", ["--to", "writes", "for", "edits"], rows, console)
    _print_refused(console, refused)
    _print_warnings(console, [str(row) for row in available.values() if isinstance(row, EquipoiseError)])
    linked = ", ".join(row.name for row in formats if row.payload)
    print_wrapped(
        console,
        "base: base link with the links that are fixed or locked to it; composite: the whole robot frozen at its stance;\n"
        "sensors: joint offsets, IMU, clock; motors: friction, armature, gain, delay;\n"
        "legs: masses and first moments of their links. Select with --parameters.\n"
        f"--add-payload-link writes the payload as a separate link; formats: {linked}.\n"
        "Next: equipoise export RUN --to FORMAT. Checks for each format: docs/reference/exports.md",
    )


def print_exports(
    written: Mapping[str, Export], paths: Mapping[str, Path], refused: Mapping[str, EquipoiseError], relative: bool
) -> None:
    """Print warnings, a table of the files, and the formats that were not written by reason; each sentence once.

    Args:
        relative: true for files of the difference from another model.
    """
    console = Console()
    _print_warnings(console, merged(note for one in written.values() for note in one.notes))
    for sentence in dict.fromkeys(one.contents for one in written.values() if relative):
        print_wrapped(console, escape(sentence), highlight=False)
    rows = [
        [name, f"{path.name}: {'difference of the base' if relative else _held(written[name].format)}"]
        for name, path in paths.items()
    ]
    show_table("", ["--to", "file and contents"], rows, console)
    console.print(f"saved in {escape(str(next(iter(paths.values())).parent))}", soft_wrap=True)
    _print_refused(console, refused)


def _print_refused(console: Console, refused: Mapping[str, EquipoiseError]) -> None:
    reasons: dict[str, list[str]] = {}
    for name, error in refused.items():
        reasons.setdefault(str(error), []).append(name)
    for reason, names in reasons.items():
        print_wrapped(console, escape(f"{', '.join(names)}: not written: {reason}"), highlight=False)


def merged(notes: Iterable[str]) -> list[str]:
    """Return notes of several files, each once, and those that list parameters as one list of a kind."""
    found: dict[str, dict[str, None]] = {}
    for note in notes:
        kind, names = (note.kind, note.names) if isinstance(note, ParameterNote) else (note, ())
        found.setdefault(kind, {}).update(dict.fromkeys(names))
    return [ParameterNote(kind, names) if names else kind for kind, names in found.items()]


def _held(row: Format) -> str:
    """Return the bodies of a format, with what it cannot hold of them, and its other parts."""
    lacking = dict(lack.split(maxsplit=1) for lack in row.lacks)
    return ", ".join(f"{word} without {lacking[word]}" if word in lacking else word for word in row.holds)


def print_export(written: Export, path: Path) -> None:
    """Print the path of an export and its warnings; short generated texts are printed in full."""
    console = Console()
    _print_warnings(console, written.notes)
    lines = written.text.splitlines() if not written.format.file else []
    if 0 < len(lines) <= _SHORT:
        print(written.text, end="")
    else:
        for line in written.header[: len(written.header) - len(written.notes)]:
            print_wrapped(console, escape(line), highlight=False)
    console.print(f"saved: {escape(str(path))}", soft_wrap=True)


def _print_warnings(console: Console, notes: Iterable[str]) -> None:
    for note in notes:
        print_wrapped(console, f"[yellow]warning:[/yellow] {escape(note)}")
