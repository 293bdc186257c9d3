"""Progress, results, plans and audits in the terminal."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeRemainingColumn
from rich.table import Column

from equipoise.calibration.run_header import HEADER, RESULT
from equipoise.experiments.progress import Progress as RoutineProgress
from equipoise.figures.blocks import number
from equipoise.figures.numbers import legend, not_estimated, numbers, numbers_table
from equipoise.figures.parts import Parts, motors_alone, parts_of, parts_of_legs
from equipoise.figures.uncertainty_budget import REMEDY, remedies, uncertainty_table
from equipoise.method.rehearsal import Forecast
from equipoise.result.calibration import Calibration
from equipoise.result.legend import checks_message, doubt_message, left_out_message, lifts_message
from equipoise.result.shown import ROWS
from equipoise.result.statistics import NORMAL_95
from equipoise.robot.audit import Audit
from equipoise.robot.model import DIAGONALS
from equipoise.terminal.rich_tables import print_saved, print_table, show_table
from equipoise.user_file import typed


class TrialProgress:
    """Progress of a run: current trial and remaining time, as a live line in a terminal, else as plain lines."""

    def __init__(self, quiet: bool) -> None:
        self._console = Console(stderr=True)
        self._quiet = quiet
        left = (TextColumn("about"), TimeRemainingColumn(compact=True), TextColumn("left:"))
        motion = TextColumn("{task.description}", table_column=Column(ratio=1, no_wrap=True, overflow="ellipsis"))
        columns = (SpinnerColumn(), BarColumn(bar_width=14), *left, motion)
        silent = quiet or not self._console.is_terminal
        self._live = Progress(*columns, expand=True, console=self._console, transient=True, disable=silent)
        self._task = self._live.add_task("standing up", total=None)

    def update(self, progress: RoutineProgress) -> None:
        """Show the current motion."""
        self._live.update(self._task, description=progress.doing, completed=progress.done, total=progress.expected)
        if not self._quiet and not self._console.is_terminal:
            count = f"{progress.done + 1} of about {progress.expected}"  # the plan changes with the first lifts
            print(f"[{count}] {progress.doing}", file=sys.stderr, flush=True)

    def __enter__(self) -> TrialProgress:
        self._live.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._live.stop()


def print_calibration(
    result: Calibration, files: Sequence[Path], verbose: bool = False, kept: Path | None = None
) -> None:
    """Print failed checks, estimates, ground truth if available, findings and next commands.

    Args:
        files: paths of the files that were written.
        kept: run folder or JSON file that contains this result, if any.
    """
    console = Console()
    for check in result.checks:
        if not check.passed:
            console.print(f"[red]check failed:[/red] {escape(f'{check.name}: {check.message}')}")
    alone = motors_alone(result)
    if not alone:
        _print_numbers(console, result)
    for parts in parts_of(result):
        _print_parts(console, f"{result.robot}: {parts.kind}, 95 % +-", parts)
        if parts.has_truth:
            print_table(console, parts.table(f"{result.robot}: {parts.kind}, ground truth", truth=True))
    if alone:
        time = sum(trial.duration for trial in result.trials)
        console.print(f"{time:.0f} s of robot time; the method {result.method} has no checks.")
    for assumption in result.assumptions:
        console.print(escape(f"assumed: {assumption}"))
    for warning in () if result.checks else result.warnings:
        console.print(f"[yellow]warning:[/yellow] {escape(warning)}")
    if verbose:
        for stage, seconds in result.timings.items():
            console.print(f"{stage}: {seconds:.2f} s")
    print_saved(console, files)
    for line in _next_steps(result, files, kept):
        console.print(escape(line), soft_wrap=True)


def _next_steps(result: Calibration, files: Sequence[Path], kept: Path | None) -> list[str]:
    """Return the next commands, without export for a doubtful or incomplete result."""
    steps = [f"see {file}" for file in files if file.suffix == ".html"]
    if kept is None:
        return steps
    missing = [quantity.name for quantity in result.base if quantity.verdict == "not identified"]
    if missing:
        scale = "calibrate longer (--duration), or estimate again with a scale (--mass KG --out FILE)"
        steps.append(f"not identified, and refused by export: base {', '.join(missing)}; {scale}")
    elif result.trustworthy and all(quantity.value is not None for quantity in result.base):
        alone = kept.is_file() and not (kept.parent / HEADER).exists()
        model = f" --file {typed(result.robot_model.source.path)}" if alone and result.robot_model is not None else ""
        steps.append(f"export with: equipoise export {typed(kept)} --to {result.model['format']}{model}")
    elif result.motors:
        steps.append(f"export with: equipoise export {typed(kept)} --to toml")
    return [*steps, *([f"estimate again: equipoise estimate {typed(kept)}"] if (kept / RESULT) in files else [])]


def _print_numbers(console: Console, result: Calibration) -> None:
    if doubt := doubt_message(result):
        console.print(f"[red]{escape(doubt)}[/red]")
    feet = f", {result.feet} feet" if result.feet else ""
    title = f"{result.robot}: method {result.method}{feet}; the whole robot at its stance"
    print_table(console, numbers_table(numbers(result), title), without=["|change"])
    for message in (*legend(result), *_remarks(result)):
        console.print(escape(message))


def _remarks(result: Calibration) -> Iterator[str]:
    """Yield the remarks under the table of numbers."""
    base = result.base
    if base.mass.value is not None and np.isfinite(base.com_in_base.values).all():
        com = " ".join(f"{1000 * value:.2f}" for value in base.com_in_base.values)
        yield (
            f"Base link {result.model['base_link']!r} with its fixed links: {base.mass.value:.3f} kg, CoM {com} mm; its "
            "inertia, covariances and the paper's stance-effective body are in the JSON form."
        )
    if result.held_out is not None:
        yield f"Held-out prediction: {result.held_out.message()}."
    if significant := [finding.message for finding in result.sensors if finding.significant]:
        yield "Sensor errors to correct: " + "; ".join(significant) + "."
    kinds = {trial.kind for trial in result.trials}
    time = sum(trial.duration for trial in result.trials)
    what = "Steps" if "lift" not in kinds and kinds & {"walk", "crawl"} else lifts_message(result)
    checks = f"; {checks_message(result)}" if result.has_intervals else ""
    yield f"{what} in {len(result.trials)} motions, {time:.0f} s of robot time{checks}."
    if left_out := left_out_message(result):
        yield left_out
    if missing := not_estimated(result):
        yield f"Not estimated by this method: {', '.join(missing)}."


def _print_parts(console: Console, title: str, parts: Parts) -> None:
    print_table(console, parts.table(title))
    console.print(f"{parts.remark} {parts.legend}".rstrip())


def print_budget(result: Calibration) -> None:
    """Print the shares of each variance by source, and remedies."""
    console = Console()
    if not result.uncertainty_budget:
        console.print(f"The method {result.method} has no uncertainty budget.")
        return
    print_table(console, uncertainty_table(result), without=[REMEDY])
    for line in remedies(result):
        console.print(escape(line))


_REASONS = 4  # shown for postures that are left out


def print_plan(robot: str, plan: Forecast) -> None:
    """Print the planned motions and the predicted accuracy."""
    console = Console()
    trials = [[posture, *(lifts[diagonal] or "-" for diagonal in DIAGONALS)] for posture, lifts in plan.trials()]
    show_table(f"{robot}: about {plan.robot_time:.0f} s of robot time", ["posture", *DIAGONALS], trials)
    columns = [plan.std] if plan.std_without_prior_run is None else [plan.std, plan.std_without_prior_run]
    rows = [
        [row.label, *(number(value, row.factor, row.form) for value in (model, *(NORMAL_95 * one for one in stds)))]
        for row, model, *stds in zip(ROWS, plan.body, *columns, strict=True)
    ]
    heads = ("parameter", "|model", "|95 % +-", "|without prior run")[: 2 + len(columns)]
    show_table("Predicted accuracy, with realistic sensors and a scale", heads, rows)
    if plan.links:
        _print_parts(console, f"{robot}: links of the model file, predicted 95 % +-", parts_of_legs(plan.links))
    console.print(
        "Lifts: passive, with the body oscillating about an axis, or with the two lifted feet swinging. Postures without "
        "lifts are stance motions, which determine the joint offsets."
    )
    for reason in plan.left_out[:_REASONS]:
        console.print(f"left out: {escape(reason)}")
    if len(plan.left_out) > _REASONS:
        console.print(f"and {len(plan.left_out) - _REASONS} more postures and lifts that are not feasible")


def print_audit(result: Audit) -> None:
    """Print the bodies of a model file and the audit's findings."""
    console = Console()
    rows: list[list[str]] = []
    for body in result.bodies:
        com = " ".join(f"{value * 1000:.1f}" for value in body.com_in_link)
        moments = " ".join(f"{value:.3g}" for value in body.principal_moments)
        rows.append([body.name, f"{body.mass:.3f}", com, moments, f"{body.radius_of_gyration * 1000:.0f}"])
    heads = ["body", "|mass [kg]", "|CoM in link [mm]", "|principal moments [kg m2]", "|gyration [mm]"]
    show_table(f"{result.robot}: {result.mass:.3f} kg", heads, rows)
    if result.composite is not None and result.stance is not None:
        x, y, z = result.composite.com * 1000
        console.print(
            f"Whole robot at the stance (hips {result.stance.hip_height:.3f} m high): "
            f"CoM {x:.1f} {y:.1f} {z:.1f} mm in base, "
            f"Ixx Iyy Izz {' '.join(f'{value:.4g}' for value in result.composite.inertia.diagonal())} kg m2."
        )
    if result.ratio_message is not None:
        console.print(escape(f"A single-rigid-body controller needs the composite: {result.ratio_message}."))
    console.print(escape(result.imu.line))
    colours = {"error": "red", "warning": "yellow", "note": "cyan"}
    for finding in result.findings:
        about = f"{finding.body}: " if finding.body else ""
        console.print(f"[{colours[finding.severity]}]{finding.severity}:[/] {escape(about + finding.text)}")
    if not any(finding.severity != "note" for finding in result.findings):
        console.print("No error or warning was found in these inertias.")
