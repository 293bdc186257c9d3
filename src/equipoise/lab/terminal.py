"""Results of the lab's verbs in the terminal."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from equipoise.figures.blocks import PageContents
from equipoise.lab.balance.balance_report import BalanceReport
from equipoise.lab.pages.balance_page import balance_table, messages, title
from equipoise.lab.pages.validation_page import validation_table
from equipoise.lab.replay.validation import Validation
from equipoise.terminal.rich_tables import print_block, print_saved, print_table

if TYPE_CHECKING:  # it needs pyarrow
    from equipoise.lab.study.runner import StudyProgress

_PLAIN_INTERVAL = 10.0  # [s] between lines without a terminal


class StudyLine:
    """Progress of a study: a live line in a terminal, else a plain line at intervals."""

    def __init__(self, quiet: bool) -> None:
        self._console = Console(stderr=True)
        self._quiet = quiet
        self._printed, self._study = time.monotonic(), ""
        self._live = Progress(
            TextColumn("trials"),
            BarColumn(bar_width=30),
            MofNCompleteColumn(),
            TextColumn("{task.description}"),
            console=self._console,
            transient=True,
            disable=quiet or not self._console.is_terminal,
        )
        self._task = self._live.add_task("starting workers", total=None)

    def update(self, progress: StudyProgress) -> None:
        """Show the progress."""
        failed = f", {progress.failed} failed" if progress.failed else ""
        text = f"{progress.rate:.2f} a second, about {_duration(progress.remaining)} left{failed}"
        self._live.update(self._task, description=text, completed=progress.done, total=progress.total)
        due = time.monotonic() - self._printed > _PLAIN_INTERVAL or progress.done == progress.total
        if due and not self._quiet and not self._console.is_terminal:
            self._printed = time.monotonic()
            print(f"[{progress.done}/{progress.total}] {text}", file=sys.stderr, flush=True)

    def update_study(self, study: str, progress: StudyProgress | None) -> None:
        """Show the progress of one of several studies."""
        if study != self._study:
            self._study = study
            self._live.reset(self._task, total=None, description="starting")
            if not self._quiet:
                self._console.print(study, highlight=False)
        if progress is not None:
            self.update(progress)

    def __enter__(self) -> StudyLine:
        self._live.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._live.stop()


def print_study(page: PageContents, files: Sequence[Path]) -> None:
    """Print rates, errors and the effect of each error source."""
    console = Console()
    for heading, blocks in page.sections.items():
        console.print(f"[bold]{escape(heading)}[/bold]")
        for block in blocks:
            print_block(console, block)
    print_saved(console, files)


def print_balance(report: BalanceReport, files: Sequence[Path]) -> None:
    """Print a column for each diagonal, and the verdicts."""
    console = Console()
    print_table(console, replace(balance_table(report), title=title(report)))
    for message in messages(report):
        console.print(escape(message))
    print_saved(console, files)


def print_validation(validation: Validation, files: Sequence[Path]) -> None:
    """Print a row for each replayed body, and the conclusion.

    Args:
        files: paths of the files that were written.
    """
    console = Console()
    print_table(console, validation_table(validation))
    console.print(escape(f"{validation.message}."))
    print_saved(console, files)


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
