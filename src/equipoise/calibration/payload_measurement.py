"""Payload measurement: one answer from a run of half a minute, against a prior run."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

from equipoise.calibration.payload_change import PayloadChange, find_payload_change_since
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
# No controller notices less: a hundredth of the robot's mass, and a millimetre of its CoM on an A1.
_SMALL_MASS, _SMALL_SHIFT = 0.01, 1e-3


@dataclass(frozen=True, eq=False)
class PayloadMeasurement:
    """Result of a payload measurement.

    Attributes:
        change: what was added since the earlier run, or taken off.
        result: result of the run itself.
        answer: "nothing" that matters; "unsure" whether anything that does; the CoM "moved", by no mass that can be told from
            none; or something was "added" or "removed".
        message: answer in one line.
    """

    change: PayloadChange
    result: Calibration
    answer: Answer
    message: str

    @property
    def verdicts(self) -> dict[str, bool]:
        """Requirements that are met: of the payload; without one, of its mass being zero."""
        found = verdicts(self.change.payload, self.result.checks)
        # Of a payload's inertia nobody asks half a minute; that nothing is there is told.
        told = [one for one in ("mass", "com_x", "com_y") if self.answer != "nothing"]
        return {**found, "identified": all(found[name] for name in told)}

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
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


def measure_payload(robot: RobotModel, known: PriorRun, result: Calibration) -> PayloadMeasurement:
    """Compare a run with its prior run.

    Args:
        result: result of `calibrate` or `estimate` by a method that knows the earlier run.

    Raises:
        NotEstimatedError: the result is not that of such a method, or comes from a file.
        SettingsError: the earlier run is of another robot.
    """
    if not isinstance(result.evidence, PosteriorEvidence):
        raise NotEstimatedError(
            "what is on a robot is told by a run with --prior-run, estimated here; this result is none"
        )
    change = find_payload_change_since(robot, known, result.evidence)
    answer = _answer(robot, change)
    message = _message(robot, known, change, answer, _robot_time(result))
    masses = result.mass_comparison
    doubt = f"Doubtful: {masses.message}. " if masses is not None and masses.disagrees else ""
    return PayloadMeasurement(change, result, answer, doubt + message)


def _answer(robot: RobotModel, change: PayloadChange) -> Answer:
    mass, shift = change.change.mass, [change.change.com_in_base.x, change.change.com_in_base.y]
    limit = _SMALL_SHIFT * nominal_stance(robot).scale.length
    changes = (mass, *shift)
    sure = [abs(one.value or 0.0) > (one.half_width or 0.0) for one in changes]
    heavy = sure[0] and abs(mass.value or 0.0) > _SMALL_MASS * robot.mass
    shifted = any(sure[1:]) and math.hypot(*(one.value or 0.0 for one in shift)) > limit
    if not heavy and not shifted:
        told = (known or one.verdict == "no change" for known, one in zip(sure, changes, strict=True))
        return "nothing" if all(told) else "unsure"
    if not sure[0]:
        return "moved"
    return "removed" if change.removed else "added"


def _message(robot: RobotModel, known: PriorRun, change: PayloadChange, answer: Answer, time: float) -> str:
    payload, whole = change.payload, change.change
    more = f"{whole.mass.value or 0.0:+.3f} +- {whole.mass.half_width or 0.0:.3f} kg"
    x, y = (
        f"{1000 * (one.value or 0.0):+.1f} +- {1000 * (one.half_width or 0.0):.1f}" for one in [*whole.com_in_base][:2]
    )
    since = f"since {known.name}; {time:.0f} s of robot time"
    if answer == "nothing":
        return f"{robot.name}: too small to matter: {more}, CoM x {x} mm, y {y} mm {since}"
    if answer == "unsure":
        remedy = "a scale (--mass KG) or a longer --duration tells more"
        return f"{robot.name}: cannot tell whether anything changed: {more}, CoM x {x} mm, y {y} mm {since}; {remedy}"
    if answer == "moved" or payload.com_in_base.x.value is None:
        return f"{robot.name}: its centre of mass moved: CoM x {x} mm, y {y} mm, {more} {since}"
    place = " ".join(f"{1000 * one:.0f}" for one in payload.com_in_base.values)
    off = " ".join(f"{NORMAL_95 * 1000 * one:.0f}" for one in payload.com_in_base.stds)
    what = "taken off" if answer == "removed" else "added"
    mass = f"{payload.mass.value or 0.0:.3f} +- {payload.mass.half_width or 0.0:.3f} kg"
    return f"{robot.name}: {mass} {what} at x y z = {place} +- {off} mm in the base frame {since}"


def _robot_time(result: Calibration) -> float:
    return sum(trial.duration for trial in result.trials)
