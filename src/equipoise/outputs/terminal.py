"""What people see in the terminal: progress and tables."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeRemainingColumn
from rich.table import Table

from equipoise.calibration import Progress as RoutineProgress
from equipoise.estimation.paper import AXES
from equipoise.result import Calibration
from equipoise.robot.audit import Audit
from equipoise.robot.catalog import CatalogRow


class TrialProgress:
    """The current trial, its bracket and the expected end: a live line in a terminal, plain lines elsewhere."""

    def __init__(self, quiet: bool) -> None:
        self._console = Console(stderr=True)
        self._quiet = quiet
        self._live = Progress(
            SpinnerColumn(),
            TextColumn("{task.description}"),
            BarColumn(bar_width=20),
            MofNCompleteColumn(),
            TextColumn("about"),
            TimeRemainingColumn(compact=True),
            TextColumn("left"),
            console=self._console,
            transient=True,
            disable=quiet or not self._console.is_terminal,
        )
        self._task = self._live.add_task("standing up", total=None)

    def update(self, progress: RoutineProgress) -> None:
        """Show what is being done."""
        self._live.update(self._task, description=progress.doing, completed=progress.done, total=progress.expected)
        if not self._quiet and not self._console.is_terminal:
            print(f"[{progress.done + 1}/{progress.expected}] {progress.doing}", file=sys.stderr, flush=True)

    def __enter__(self) -> TrialProgress:
        self._live.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._live.stop()


def print_calibration(result: Calibration, files: Sequence[Path]) -> None:
    """The closing table: parameter, estimate, truth, error."""
    console = Console()
    truth = result.truth
    table = Table(title=f"{result.robot}: method {result.method}, {result.feet} feet", title_justify="left")
    for column, justify in (("parameter", "left"), ("estimate", "right"), ("truth", "right"), ("error", "right")):
        table.add_column(column, justify=justify)  # pyright: ignore[reportArgumentType]
    for index, axis in enumerate("xy"):
        value = result.composite.com_in_base[index]
        true = None if truth is None else float(truth.composite.com[index])
        table.add_row(
            f"CoM {axis} in base [mm]",
            _number(value, 1000, ".2f"),
            _number(true, 1000, ".2f"),
            "-" if value is None or true is None else f"{(value - true) * 1000:+.2f} mm",
        )
    errors = result.moment_errors()
    for index, axis in enumerate(AXES):
        sway = result.sways[axis]
        name = f"I_{'xyz'[index]} ({axis}) [kg m2]"
        effective = None if truth is None else float(truth.stance_effective.inertia[index, index])
        composite = None if truth is None else float(truth.composite.inertia[index, index])
        error = errors.get(axis)
        table.add_row(
            f"{name} vs base+hips+thighs",
            _number(sway.moment, 1, ".4f"),
            _number(effective, 1, ".4f"),
            "-" if error is None else f"{error['against_stance_effective']:+.1%}",
        )
        table.add_row(
            f"{' ' * len(name)} vs whole robot",
            "",
            _number(composite, 1, ".4f"),
            "-" if error is None else f"{error['against_composite']:+.1%}",
        )
        table.add_row(f"C_{'xyz'[index]} ({axis}) [Nm s/rad]", _number(sway.damping, 1, ".3f"), "", "")
    console.print(table)
    lifts = [trial for trial in result.trials if trial.kind == "lift"]
    time = sum(trial.duration for trial in result.trials)
    console.print(
        f"{len(lifts)} lifts and {len(result.trials) - len(lifts)} sways, {time:.0f} s of robot time. "
        "Not estimated by this method: mass, CoM height, products of inertia."
    )
    for warning in result.warnings:
        console.print(f"[yellow]warning:[/yellow] {escape(warning)}")
    if files:
        console.print("saved: " + escape(", ".join(str(file) for file in files)), soft_wrap=True)
        console.print(f"estimate again: equipoise estimate {escape(str(files[0].parent))}", soft_wrap=True)


def print_robots(rows: Sequence[CatalogRow]) -> None:
    """The catalogue."""
    table = Table()
    for column, justify in (("name", "left"), ("mass [kg]", "right"), ("legs", "left"), ("leg [m]", "right")):
        table.add_column(column, justify=justify)  # pyright: ignore[reportArgumentType]
    table.add_column("source")
    table.add_column("what")
    for row in rows:
        what = row.note if row.install is None else f"{row.note}; not installed: {row.install}"
        table.add_row(
            row.name, _number(row.mass, 1, ".3f"), row.legs or "-", _number(row.leg_length, 1, ".3f"), row.source,
            escape(what),
        )  # fmt: skip
    console = Console()
    console.print(table)
    console.print("Any URDF or MJCF file works too, by its path; and robot_descriptions:NAME where that package is.")


def print_audit(result: Audit) -> None:
    """The audit."""
    raise NotImplementedError


def _number(value: float | None, factor: float, form: str) -> str:
    return "-" if value is None else format(value * factor, form)
