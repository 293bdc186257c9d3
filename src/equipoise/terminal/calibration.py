"""What people see in the terminal: progress and tables."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeRemainingColumn
from rich.table import Column, Table

from equipoise.calibration.run_folder import HEADER, RESULT
from equipoise.conventions import AXES
from equipoise.experiments.progress import Progress as RoutineProgress
from equipoise.method.rehearsal import Forecast
from equipoise.result.calibration import Calibration
from equipoise.result.legend import checks_sentence, doubt_sentence, frame_sentence, verdict_sentence
from equipoise.result.quantity import Quantity
from equipoise.result.shown import ROWS
from equipoise.result.statistics import NORMAL_95
from equipoise.robot.audit import Audit
from equipoise.robot.model import DIAGONALS
from equipoise.terminal.parts import parts_of, parts_of_legs, print_parts
from equipoise.user_file import typed


class TrialProgress:
    """The current trial, its bracket and the expected end: a live line in a terminal, plain lines elsewhere."""

    def __init__(self, quiet: bool) -> None:
        self._console = Console(stderr=True)
        self._quiet = quiet
        self._live = Progress(
            SpinnerColumn(),
            BarColumn(bar_width=14),
            MofNCompleteColumn(),
            TextColumn("about"),
            TimeRemainingColumn(compact=True),
            TextColumn("left:"),
            TextColumn("{task.description}", table_column=Column(ratio=1, no_wrap=True, overflow="ellipsis")),
            expand=True,
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


def print_calibration(
    result: Calibration, files: Sequence[Path], verbose: bool = False, kept: Path | None = None
) -> None:
    """What was found, beside the truth where that is known; what speaks against it comes first.

    Args:
        files: paths of the files that were written.
        kept: run folder or JSON file that holds this very result, if one does.
    """
    console = Console()
    for check in result.checks:
        if not check.passed:
            console.print(f"[red]check failed:[/red] {escape(f'{check.name}: {check.message}')}")
    if result.has_intervals:
        _print_precise(console, result)
    elif not result.motors or result.composite.com_in_base.x.value is not None:
        _print_paper(console, result)
    for parts in parts_of(result):
        print_parts(console, result.robot, parts)
    for assumption in result.assumptions:
        console.print(escape(f"assumed: {assumption}"))
    for warning in () if result.checks else result.warnings:
        console.print(f"[yellow]warning:[/yellow] {escape(warning)}")
    if verbose:
        for stage, seconds in result.timings.items():
            console.print(f"{stage}: {seconds:.2f} s")
    if files:
        console.print("saved: " + escape(", ".join(str(file) for file in files)), soft_wrap=True)
    for line in _next_steps(result, files, kept):
        console.print(escape(line), soft_wrap=True)


def _next_steps(result: Calibration, files: Sequence[Path], kept: Path | None) -> list[str]:
    """What to do with files that were saved; one that is doubtful, or not wholly estimated, is not exported."""
    said = [f"see {file}" for file in files if file.suffix == ".html"]
    if kept is None:
        return said
    if result.trustworthy and all(quantity.value is not None for quantity in result.base):
        alone = kept.is_file() and not (kept.parent / HEADER).exists()
        model = f" --file {typed(result.robot_model.source.path)}" if alone and result.robot_model is not None else ""
        said.append(f"export with: equipoise export {typed(kept)} --to {result.model['format']}{model}")
    return [*said, *([f"estimate again: equipoise estimate {typed(kept)}"] if (kept / RESULT) in files else [])]


def _print_precise(console: Console, result: Calibration) -> None:
    title = f"{result.robot}: method {result.method}; the whole robot at its stance"
    if doubt := doubt_sentence(result):
        console.print(f"[red]{escape(doubt)}[/red]")
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    columns = ["parameter", "estimate", "95 % +-", "", *(["truth", "error"] if result.truth else []), "model"]
    for column in columns:
        table.add_column(column, justify="left" if column in ("parameter", "") else "right", no_wrap=True)
    for quantity, (_, label, factor, form) in zip(result.composite, ROWS, strict=True):
        table.add_row(
            escape(label),
            *estimate_cells(quantity, factor, form, bool(result.truth)),
            number(quantity.model, factor, form),
        )
    console.print(table)
    for sentence in filter(None, (frame_sentence(result), verdict_sentence(result.composite))):
        console.print(escape(sentence))
    base_link = escape(repr(result.model["base_link"]))
    base = result.base
    if base.mass.value is not None and np.isfinite(base.com_in_base.values).all():
        com = " ".join(f"{1000 * value:.2f}" for value in base.com_in_base.values)
        console.print(
            f"Base link {base_link} with all that is fixed to it: {base.mass.value:.3f} kg, CoM {com} mm; its inertia, "
            "covariances and the paper's stance-effective body are in the JSON form."
        )
    if result.held_out is not None:
        console.print(f"Held out: {result.held_out.sentence()}.")
    notable = [finding.sentence for finding in result.sensors if finding.notable]
    if notable:
        console.print("Worth fixing: " + escape("; ".join(notable)) + ".")
    lifts = [trial for trial in result.trials if trial.kind == "lift"]
    time = sum(trial.duration for trial in result.trials)
    walked = not lifts and any(trial.kind in ("walk", "crawl") for trial in result.trials)
    done, told = "Steps" if walked else f"{len(lifts)} lifts", checks_sentence(result)
    console.print(f"{done} in {len(result.trials)} motions, {time:.0f} s of robot time; {told}.")


def estimate_cells(quantity: Quantity, factor: float, form: str, with_truth: bool) -> list[str]:
    """Estimate, half the interval and verdict; truth and error too, marked where the truth is outside."""
    cells = [number(quantity.value, factor, form), number(quantity.half, factor, form), quantity.verdict or ""]
    if with_truth:
        outside = " (!)" if quantity.missed else ""
        cells += [number(quantity.truth, factor, form), number(quantity.error, factor, "+" + form) + outside]
    return cells


def _print_paper(console: Console, result: Calibration) -> None:
    feet = f", {result.feet} feet" if result.feet else ""
    table = Table(title=f"{result.robot}: method {result.method}{feet}", title_justify="left", box=box.SIMPLE_HEAD)
    for column in ("parameter", "estimate", "truth", "error"):
        table.add_column(column, justify="left" if column == "parameter" else "right")
    mass, com = result.composite.mass, result.composite.com_in_base
    if mass.value is not None:
        error = "-" if mass.truth is None else f"{mass.value / mass.truth - 1:+.1%}"
        table.add_row(escape("mass [kg]"), f"{mass.value:.3f}", number(mass.truth, 1, ".3f"), error)
    for axis, one in (("x", com.x), ("y", com.y)):
        table.add_row(
            escape(f"CoM {axis} in base [mm]"),
            number(one.value, 1000, ".2f"),
            number(one.truth, 1000, ".2f"),
            "-" if one.error is None else f"{one.error * 1000:+.2f} mm",
        )
    for quantity, (_, label, factor, form) in [*zip(result.composite, ROWS, strict=True)][3:]:
        if quantity.value is not None:
            error = number(quantity.error, factor, "+" + form)
            table.add_row(
                escape(label), number(quantity.value, factor, form), number(quantity.truth, factor, form), error
            )
    errors = result.moment_errors()
    for index, axis in enumerate(AXES):
        sway = result.sways.get(axis)
        if sway is None:
            continue
        name = f"I_{'xyz'[index]} ({axis}) [kg m2]"
        effective = result.stance_effective.inertia.moments[index].truth
        composite = result.composite.inertia.moments[index].truth
        error = errors.get(axis)
        table.add_row(
            escape(f"{name} of base, hips, thighs"),
            number(sway.moment, 1, ".4f"),
            number(effective, 1, ".4f"),
            "-" if error is None else f"{error['against_stance_effective']:+.1%}",
        )
        table.add_row(
            f"{' ' * len(name)} of the whole robot",
            "",
            number(composite, 1, ".4f"),
            "-" if error is None else f"{error['against_composite']:+.1%}",
        )
        table.add_row(escape(f"C_{'xyz'[index]} ({axis}) [Nm s/rad]"), number(sway.damping, 1, ".3f"), "", "")
    console.print(table)
    console.print(escape(frame_sentence(result)))
    lifts = [trial for trial in result.trials if trial.kind == "lift"]
    time = sum(trial.duration for trial in result.trials)
    missing = ["mass"] if mass.value is None else []
    missing += ["CoM height"] if com.z.value is None else []
    if result.composite.inertia.Ixy.value is None:
        missing.append("products of inertia" if result.moments else "inertia")
    told = f" Not estimated by this method: {', '.join(missing)}." if missing else ""
    console.print(
        f"{len(lifts)} lifts and {len(result.trials) - len(lifts)} other motions, {time:.0f} s of robot time.{told}"
    )


_REASONS = 4


def print_plan(robot: str, plan: Forecast) -> None:
    """What would be done, and how accurate it would be."""
    console = Console()
    table = Table(title=f"{robot}: {plan.robot_time:.0f} s of robot time", title_justify="left", box=box.SIMPLE_HEAD)
    for column in ("posture", *DIAGONALS):
        table.add_column(column)
    for posture, lifts in plan.trials():
        table.add_row(posture, *(lifts[diagonal] or "-" for diagonal in DIAGONALS))
    console.print(table)
    console.print("[italic]Predicted, for ordinary sensors and a scale[/italic]")  # wider than its table
    accuracy = Table(box=box.SIMPLE_HEAD)
    columns = [plan.deviation] if plan.without is None else [plan.deviation, plan.without]
    for column in ("parameter", "model", "95 % +-", "nothing known")[: 2 + len(columns)]:
        accuracy.add_column(column, justify="left" if column == "parameter" else "right")
    for (_, label, factor, form), value, *deviations in zip(ROWS, plan.body, *columns, strict=True):
        cells = (format(NORMAL_95 * deviation * factor, form) for deviation in deviations)
        accuracy.add_row(escape(label), format(value * factor, form), *cells)
    console.print(accuracy)
    if plan.links:
        print_parts(console, robot, parts_of_legs(plan.links), "the model file's, predicted 95 % +-")
    console.print(
        "Lifts: passive, or with the body turning to and fro about an axis, or with the two lifted feet swinging. Postures "
        "without lifts are moves over planted feet, from which joint zeros follow."
    )
    for reason in plan.left_out[:_REASONS]:
        console.print(f"left out: {escape(reason)}")
    if len(plan.left_out) > _REASONS:
        console.print(f"and {len(plan.left_out) - _REASONS} more postures and lifts that this robot cannot do")


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
    console.print(escape(f"{result.imu.sentence}."))
    colours = {"error": "red", "warning": "yellow", "note": "cyan"}
    for finding in result.findings:
        about = f"{finding.body}: " if finding.body else ""
        console.print(f"[{colours[finding.severity]}]{finding.severity}:[/] {escape(about + finding.text)}")
    if not any(finding.severity != "note" for finding in result.findings):
        console.print("Nothing speaks against these inertias.")


def number(value: float | None, factor: float, form: str) -> str:
    """A value times a factor, or a dash if it is not known."""
    return "-" if value is None else format(value * factor, form)
