"""Contents of the report of one run."""

from __future__ import annotations

from collections.abc import Sequence

from equipoise.figures.blocks import Block, Cell, DataTable, PageContents
from equipoise.figures.numbers import HEADINGS, legend, not_estimated, numbers, numbers_table
from equipoise.figures.parts import motors_alone, parts_of
from equipoise.figures.plan_view import plan_figures, plan_view
from equipoise.figures.uncertainty_budget import remedies, uncertainty_table
from equipoise.report.differences import action_blocks
from equipoise.report.excitation_figures import excitation_blocks
from equipoise.report.part_figures import LINKS, MOTORS, motor_message, part_blocks
from equipoise.report.provenance import provenance_blocks
from equipoise.report.residuals import held_out_blocks, residual_figures
from equipoise.report.sensor_figures import sensor_blocks
from equipoise.report.trial_figures import search_figures, trial_table
from equipoise.result.calibration import Calibration
from equipoise.result.legend import checks_message, frame_message, lifts_message


def run_contents(result: Calibration, run: str = "RUN") -> PageContents:
    """Return the page, without sections that have no data.

    Args:
        run: path of the run, for commands.
    """
    alone = motors_alone(result)
    uncertainty = [uncertainty_table(result), remedies(result)] if result.uncertainty_budget else []
    sections: dict[str, Sequence[Block]] = {
        _held_out_title(result): held_out_blocks(result),
        "Trials": [*search_figures(result), *trial_table(result)],
        "Excitations": excitation_blocks(result),
        "Residuals": residual_figures(result),
        "Legs": part_blocks(result, LINKS),
        "Motors": part_blocks(result, MOTORS),
        "Sensors": sensor_blocks(result),
        "Uncertainty": uncertainty,
        "Other bodies": _other_bodies(result),
        "Checks": _checks(result),
        "Provenance": provenance_blocks(result),
    }
    first: list[Block] = (
        [parts_of(result)[0].table()] if alone else [numbers_table(numbers(result), HEADINGS["composite"])]
    )
    words = () if alone else legend(result)
    first = [*first, *words, *plan_figures(plan_view({result.robot: result}))]
    subtitle, lead, actions = _subtitle(result), _lead(result), action_blocks(result, run)
    below = {title: blocks for title, blocks in sections.items() if blocks}
    return PageContents(result.robot, subtitle, lead, first, below, alerts(result), actions)


def alerts(result: Calibration) -> list[tuple[str, str]]:
    """Return failed checks, or warnings where there are no checks."""
    failed = [(f"Check failed: {check.name}", check.message) for check in result.checks if not check.passed]
    return failed or ([] if result.checks else [("Warning", warning) for warning in result.warnings])


def _held_out_title(result: Calibration) -> str:
    walked = result.held_out is not None and all(lift.kind == "step" for lift in result.held_out.lifts)
    return "Held-out steps" if walked else "Held-out lifts"


def _subtitle(result: Calibration) -> str:
    lifts = any(trial.kind == "lift" for trial in result.trials)
    time = sum(trial.duration for trial in result.trials)
    parts = [
        f"method {result.method}",
        f"{lifts_message(result)} in {time:.0f} s of robot time" if lifts else f"{time:.0f} s",
    ]
    parts += [checks_message(result)] if result.checks else []
    parts += [str(result.provenance["platform"])] if "platform" in result.provenance else []
    parts += [str(result.provenance["time"])[:16].replace("T", " ")] if "time" in result.provenance else []
    return " \u00b7 ".join(parts)


def _lead(result: Calibration) -> str:
    """Return the ranges of motor parameters, missing parameters and assumptions, in a few sentences."""
    messages = [motor_message(result)] if result.motors else []
    if (missing := not_estimated(result)) and not motors_alone(result):
        names = ", ".join(missing)
        messages.append(f"`{result.method}` does not estimate these parameters of the whole robot: {names}.")
    if result.assumptions:
        messages.append(f"Assumed: {'; '.join(result.assumptions)}.")
    return " ".join(messages)


def _other_bodies(result: Calibration) -> list[Block]:
    tables = [numbers_table(shown, HEADINGS[body]) for body in list(HEADINGS)[1:] if (shown := numbers(result, body))]
    return [*tables, frame_message(result)] if tables else []


def _checks(result: Calibration) -> list[DataTable]:
    rows = [
        [Cell(verdict="passed" if check.passed else "failed"), check.name, check.message] for check in result.checks
    ]
    return [DataTable("Checks of the result", ["", "check", "finding"], rows)] if rows else []
