"""Payload measurement by a run of half a minute or a log, against a prior run or the model file."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

from equipoise.calibration.payload_change import PayloadChange, find_payload_change_from_file, find_payload_change_since
from equipoise.errors import NotEstimatedError
from equipoise.estimator.posterior_evidence import PosteriorEvidence
from equipoise.estimator.prior_runs.prior_run import PriorRun
from equipoise.json_form import to_json
from equipoise.result.calibration import Calibration
from equipoise.result.requirements import verdicts
from equipoise.result.statistics import NORMAL_95
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import nominal_stance

SCHEMA = "equipoise.payload/1"
Answer = Literal["nothing", "unsure", "moved", "added", "removed"]
# Negligible for a controller: a hundredth of the robot's mass, and a millimetre of its CoM on an A1.
_SMALL_MASS, _SMALL_SHIFT = 0.01, 1e-3


@dataclass(frozen=True, eq=False)
class PayloadMeasurement:
    """Result of a payload measurement.

    Attributes:
        change: payload added since the prior run, or removed.
        result: result of the run itself.
        answer: "nothing" for a negligible change; "unsure" if a significant change is not excluded; "moved" for a CoM
            that moved without a significant mass; "added" or "removed" for a mass.
        message: answer in one line.
    """

    change: PayloadChange
    result: Calibration
    answer: Answer
    message: str

    @property
    def verdicts(self) -> dict[str, bool]:
        """Requirements that are met, by name."""
        found = verdicts(self.change.payload, self.result.checks)
        # Half a minute does not identify a payload's inertia; "nothing" is an identified answer.
        required = [one for one in ("mass", "com_x", "com_y") if self.answer != "nothing"]
        return {**found, "identified": all(found[name] for name in required)}

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            **self.change.to_dict(),
            "schema": SCHEMA,
            "answer": self.answer,
            "message": self.message,
            "robot_time": _robot_time(self.result),
            "checks": to_json(self.result.checks),
            "mass_comparison": to_json(self.result.mass_comparison),
            "verdicts": self.verdicts,
        }


def measure_payload(robot: RobotModel, prior_run: PriorRun | None, result: Calibration) -> PayloadMeasurement:
    """Compare a run or a log with its prior run, or with the model file.

    Args:
        prior_run: prior run; None to compare with the model file.
        result: result of `calibrate`, `estimate` or `estimate_log` by a method with this prior run.

    Raises:
        NotEstimatedError: the result is not that of such a method, or comes from a file.
        SettingsError: the prior run is of another robot.
    """
    if not isinstance(result.evidence, PosteriorEvidence):
        raise NotEstimatedError(
            "a payload measurement needs the result of a run or a log that is estimated in this process; this result has no "
            "evidence"
        )
    if prior_run is None:
        change = find_payload_change_from_file(robot, result.evidence)
        reference = "relative to the model file, whose errors count as payload (usual priors)"
    else:
        change, reference = find_payload_change_since(robot, prior_run, result.evidence), f"since {prior_run.name}"
    answer = _answer(robot, change)
    message = _message(robot, reference, change, answer, _robot_time(result))
    masses = result.mass_comparison
    doubt = f"Doubtful: {masses.message}. " if masses is not None and masses.disagrees else ""
    return PayloadMeasurement(change, result, answer, doubt + message)


def _answer(robot: RobotModel, change: PayloadChange) -> Answer:
    mass, shift = change.change.mass, [change.change.com_in_base.x, change.change.com_in_base.y]
    limit = _SMALL_SHIFT * nominal_stance(robot).scale.length
    changes = (mass, *shift)
    significant = [abs(one.value or 0.0) > (one.half_width or 0.0) for one in changes]
    heavy = significant[0] and abs(mass.value or 0.0) > _SMALL_MASS * robot.mass
    shifted = any(significant[1:]) and math.hypot(*(one.value or 0.0 for one in shift)) > limit
    if not heavy and not shifted:
        excluded = (clear or one.verdict == "no change" for clear, one in zip(significant, changes, strict=True))
        return "nothing" if all(excluded) else "unsure"
    if not significant[0]:
        return "moved"
    return "removed" if change.removed else "added"


def _message(robot: RobotModel, reference: str, change: PayloadChange, answer: Answer, time: float) -> str:
    payload, whole = change.payload, change.change
    more = f"{whole.mass.value or 0.0:+.3f} +- {whole.mass.half_width or 0.0:.3f} kg"
    x, y = (
        f"{1000 * (one.value or 0.0):+.1f} +- {1000 * (one.half_width or 0.0):.1f}" for one in [*whole.com_in_base][:2]
    )
    since = f"{reference}; {time:.0f} s of robot time"
    if answer == "nothing":
        return f"{robot.name}: too small to matter: {more}, CoM x {x} mm, y {y} mm {since}"
    if answer == "unsure":
        remedy = "use a scale (--mass KG) or more robot time"
        return f"{robot.name}: cannot tell whether anything changed: {more}, CoM x {x} mm, y {y} mm {since}; {remedy}"
    if answer == "moved" or payload.com_in_base.x.value is None:
        return f"{robot.name}: the centre of mass moved: CoM x {x} mm, y {y} mm, {more} {since}"
    com = " ".join(f"{1000 * one:.0f}" for one in payload.com_in_base.values)
    half_widths = " ".join(f"{NORMAL_95 * 1000 * one:.0f}" for one in payload.com_in_base.stds)
    action = "removed" if answer == "removed" else "added"
    mass = f"{payload.mass.value or 0.0:.3f} +- {payload.mass.half_width or 0.0:.3f} kg"
    return f"{robot.name}: {mass} {action} at x y z = {com} +- {half_widths} mm in the base frame {since}"


def _robot_time(result: Calibration) -> float:
    return sum(trial.duration for trial in result.trials)
