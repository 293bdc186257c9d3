"""What people see in the terminal: progress and tables."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from rich import box
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
    title = f"{result.robot}: method {result.method}, {result.feet} feet"
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD)
    for column in ("parameter", "estimate", "truth", "error"):
        table.add_column(column, justify="left" if column == "parameter" else "right")
    for index, axis in enumerate("xy"):
        value = result.composite.com_in_base[index]
        true = None if truth is None else float(truth.composite.com[index])
        table.add_row(
            escape(f"CoM {axis} in base [mm]"),
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
            escape(f"{name} of base, hips, thighs"),
            _number(sway.moment, 1, ".4f"),
            _number(effective, 1, ".4f"),
            "-" if error is None else f"{error['against_stance_effective']:+.1%}",
        )
        table.add_row(
            f"{' ' * len(name)} of the whole robot",
            "",
            _number(composite, 1, ".4f"),
            "-" if error is None else f"{error['against_composite']:+.1%}",
        )
        table.add_row(escape(f"C_{'xyz'[index]} ({axis}) [Nm s/rad]"), _number(sway.damping, 1, ".3f"), "", "")
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
    table = Table(box=box.SIMPLE_HEAD)
    for column in ("name", "mass [kg]", "legs", "leg [m]", "source", "what"):
        table.add_column(escape(column), justify="right" if "[" in column else "left", no_wrap=column != "what")
    for row in rows:
        what = row.note if row.install is None else "not installed"
        mass, leg = _number(row.mass, 1, ".3f"), _number(row.leg_length, 1, ".3f")
        table.add_row(row.name, mass, row.legs or "-", leg, row.source, escape(what))
    console = Console()
    console.print(table)
    for install in dict.fromkeys(row.install for row in rows if row.install is not None):
        console.print(f"To install {', '.join(row.name for row in rows if row.install == install)}: {escape(install)}")
    console.print("Any URDF or MJCF file works too, by its path; so does robot_descriptions:NAME with that package.")


def print_audit(result: Audit) -> None:
    """What the model file says, and what speaks against it."""
    console = Console()
    table = Table(title=f"{result.robot}: {result.mass:.3f} kg", title_justify="left", box=box.SIMPLE_HEAD)
    for column in ("body", "mass [kg]", "CoM in link [mm]", "principal moments [kg m2]", "gyration [mm]"):
        table.add_column(escape(column), justify="left" if column == "body" else "right")
    for body in result.bodies:
        table.add_row(
            escape(body.name),
            f"{body.mass:.3f}",
            " ".join(f"{value * 1000:.1f}" for value in body.com_in_link),
            " ".join(f"{value:.3g}" for value in body.principal_moments),
            f"{body.radius_of_gyration * 1000:.0f}",
        )
    console.print(table)
    if result.composite is not None and result.stance is not None:
        x, y, z = result.composite.com * 1000
        console.print(
            f"Whole robot at the stance (hips {result.stance.hip_height:.3f} m high): "
            f"CoM {x:.1f} {y:.1f} {z:.1f} mm in base, "
            f"Ixx Iyy Izz {' '.join(f'{value:.4g}' for value in result.composite.inertia.diagonal())} kg m2."
        )
    if result.ratio_sentence is not None:
        console.print(escape(f"A single-rigid-body controller wants the composite: {result.ratio_sentence}."))
    colours = {"error": "red", "warning": "yellow", "note": "cyan"}
    for finding in result.findings:
        about = f"{finding.body}: " if finding.body else ""
        console.print(f"[{colours[finding.severity]}]{finding.severity}:[/] {escape(about + finding.text)}")
    if not any(finding.severity != "note" for finding in result.findings):
        console.print("Nothing speaks against these inertias.")


def _number(value: float | None, factor: float, form: str) -> str:
    return "-" if value is None else format(value * factor, form)
