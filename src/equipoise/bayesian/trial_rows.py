"""Rows of a result, one for each trial of a Bayesian run."""

from __future__ import annotations

from equipoise.bayesian.planning.candidates import describe
from equipoise.estimator.equations.equation import MotionSamples
from equipoise.estimator.equations.stance_motion import StanceMotions
from equipoise.estimator.equations.tilt import TiltEquation
from equipoise.estimator.problem import Posterior
from equipoise.recording.trials import (
    CommandedLift,
    DesignedLift,
    ExcitationTrial,
    LiftTrial,
    PostureTrial,
    RecordedTrial,
    SteppingTrial,
)
from equipoise.result.calibration import Trial


def trial_row(motion: MotionSamples, posterior: Posterior) -> Trial:
    """Return the row of a motion, with its largest normalized residual and the reason if it was left out."""
    fitted = *posterior.residuals_of(TiltEquation), *posterior.residuals_of(StanceMotions)
    residuals = [residual for residual in fitted if residual.motion == motion.index]
    used = [residual.normalized_residual for residual in residuals if residual.used]
    worst = max(used or [residual.normalized_residual for residual in residuals], default=None)
    trial = motion.trial
    note = motion.left_out
    if residuals and not used:
        note = "left out: it does not fit the others"
    return Trial(
        "motion" if trial is None else trial.kind, _about(trial), None,
        trial.lift_height if isinstance(trial, CommandedLift) else None,
        None, None, motion.duration, worst, note,
    )  # fmt: skip


def _about(trial: RecordedTrial | None) -> str:
    """Return a short description of a trial."""
    if trial is None:
        return ""
    words = [trial.diagonal] if isinstance(trial, LiftTrial) else []
    if isinstance(trial, SteppingTrial):
        words.append(f"{len(trial.steps)} steps")
    if isinstance(trial, DesignedLift) and trial.meanwhile != "passive":
        words.append(trial.meanwhile)
    if trial.found_at is not None:
        words.append(f"at {trial.found_at:.1f} s")
    if isinstance(trial, DesignedLift | PostureTrial) and trial.posture is not None:
        words.append(describe(trial.posture))
    if isinstance(trial, ExcitationTrial):
        words.append(trial.about)
    return ", ".join(words)
