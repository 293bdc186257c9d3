"""What is on the page of one run."""

from __future__ import annotations

import numpy as np

from equipoise.figures.lift_planes import lift_planes
from equipoise.figures.plan_view import plan_view
from equipoise.report.advice import advice_blocks
from equipoise.report.blocks import Block, section, table, text
from equipoise.report.numbers import BODIES, numbers, numbers_table, tell
from equipoise.report.parts import LINKS, MOTORS, motor_sentence, motors_alone, part_blocks, part_table
from equipoise.report.plan_view import plan_view_block
from equipoise.report.progress import progress_figures
from equipoise.report.provenance import provenance_blocks
from equipoise.report.residuals import held_out_blocks, residual_figures
from equipoise.report.scene import scene
from equipoise.report.sensors import sensor_blocks
from equipoise.report.sway import sway_blocks
from equipoise.report.trials import bracket_figure, error_figure, tilt_figures, trial_table
from equipoise.report.uncertainty import uncertainty_blocks
from equipoise.result.calibration import Calibration
from equipoise.result.legend import doubt_sentence, frame_sentence, verdict_sentence
from equipoise.result.shown import ROWS
from equipoise.terminal.parts import parts_of

SCHEMA = "equipoise.report/1"


def run_contents(result: Calibration) -> Block:
    """The page as JSON values; what the result does not know is left out."""
    planes = lift_planes(result)
    closing = [one for one in (bracket_figure(result), error_figure(result)) if one is not None]
    sections = [
        section("held-out", _unseen(result), held_out_blocks(result)),
        section("trials", "Trials", [
            {"type": "figures", "figures": closing} if closing else None, progress_figures(result), tilt_figures(result),
            trial_table(result),
        ]),
        section("scene", "In space", [] if motors_alone(result) else [scene(result, planes)]),
        section("sways", "Sways", sway_blocks(result)),
        section("residuals", "Residuals", [residual_figures(result, planes)]),
        section("links", "Legs", part_blocks(result, LINKS)),
        section("motors", "Motors", part_blocks(result, MOTORS)),
        section("sensors", "Sensors", sensor_blocks(result)),
        section("uncertainty", "Uncertainty", uncertainty_blocks(result)),
        section("help", "What would help", advice_blocks(result)),
        section("bodies", "Other bodies", _other_bodies(result)),
        section("checks", "Checks", [_checks(result)]),
        section("provenance", "Provenance", provenance_blocks(result)),
    ]  # fmt: skip
    return {
        "schema": SCHEMA,
        "title": result.robot,
        "subtitle": _subtitle(result),
        "lead": _lead(result),
        "alerts": alerts(result),
        "numbers": _numbers(result),
        "legend": [] if motors_alone(result) else legend(result),
        "plan_view": plan_view_block(plan_view({result.robot: result}, planes)),
        "sections": [one for one in sections if one is not None],
    }


def _numbers(result: Calibration) -> Block:
    """Of the whole robot, or of its motors if that is all there is."""
    if motors_alone(result):
        return part_table(parts_of(result)[0])
    return numbers_table(numbers(result), _heading("composite"))


def alerts(result: Calibration) -> list[Block]:
    """What speaks against the result: failed checks, or else warnings."""
    failed = [{"name": f"Check failed: {c.name}", "message": c.message} for c in result.checks if not c.passed]
    return failed or ([] if result.checks else [{"name": "Warning", "message": warning} for warning in result.warnings])


def _unseen(result: Calibration) -> str:
    walked = result.held_out is not None and all(lift.kind == "step" for lift in result.held_out.lifts)
    return "Unseen steps" if walked else "Unseen lifts"


def _subtitle(result: Calibration) -> str:
    lifts = sum(trial.kind == "lift" for trial in result.trials)
    time = sum(trial.duration for trial in result.trials)
    passed = sum(check.passed for check in result.checks)
    parts = [f"method {result.method}", f"{lifts} lifts in {time:.0f} s of robot time" if lifts else f"{time:.0f} s"]
    parts += [f"{passed} of {len(result.checks)} checks passed"] if result.checks else []
    parts += [str(result.provenance["platform"])] if "platform" in result.provenance else []
    parts += [str(result.provenance["time"])[:16].replace("T", " ")] if "time" in result.provenance else []
    return " \u00b7 ".join(parts)


def _lead(result: Calibration) -> str:
    """The change against the model file, in a sentence or two."""
    said = [doubt_sentence(result)] if not result.trustworthy else []
    mass = result.composite.mass
    if mass.value is not None and mass.change is not None:
        half = "" if mass.half is None else f" \u00b1 {mass.half:.2f}"
        more = "more" if mass.change > 0 else "less"
        against = f"{abs(mass.change):.2f} kg {more} than its model file says"
        if mass.half is not None and abs(mass.change) <= mass.half:
            against = "as its model file says, within the interval"
        said.append(f"It weighs {mass.value:.2f}{half} kg, {against}.")
    shifts = [1000 * one.change for one in result.composite.com_in_base if one.change is not None]
    if shifts:
        names = ("forward", "left", "up")[: len(shifts)]
        along = ", ".join(f"{tell(shift, '+.1f')} mm {name}" for shift, name in zip(shifts, names, strict=True))
        said.append(f"Its centre of mass is {np.linalg.norm(shifts):.1f} mm from where the file has it ({along}).")
    if result.motors:
        said.append(motor_sentence(result))
    missing = [label for one, (_, label, *_) in zip(result.composite, ROWS, strict=True) if one.value is None]
    if missing and not motors_alone(result):
        names = ", ".join(label.split(" [")[0] for label in missing)
        said.append(f"The method {result.method} does not find the whole robot's {names}.")
    if result.assumptions:
        said.append(f"Assumed: {'; '.join(result.assumptions)}.")
    return " ".join(said)


def legend(result: Calibration) -> list[str]:
    """What stands under the numbers."""
    return [said for said in (frame_sentence(result), verdict_sentence(result.composite)) if said]


def _other_bodies(result: Calibration) -> list[Block]:
    tables = [
        numbers_table(shown, _heading(body))
        for body in BODIES
        if body != "composite" and (shown := numbers(result, body))
    ]
    return [*tables, text(frame_sentence(result))] if tables else []


def _heading(body: str) -> str:
    return BODIES[body][0].upper() + BODIES[body][1:]


def _checks(result: Calibration) -> Block | None:
    if not result.checks:
        return None
    rows = [[{"verdict": "passed" if check.passed else "failed"}, check.name, check.message] for check in result.checks]
    return table(["", "check", "what was looked at"], rows, "What the result asks itself")
