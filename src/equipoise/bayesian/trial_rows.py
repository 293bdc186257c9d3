"""A row of a result for each trial of a run of the Bayesian method."""

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
    """Return what is said of a motion: what it was, how well it fits, and why it was left out."""
    fitted = *posterior.residuals_of(TiltEquation), *posterior.residuals_of(StanceMotions)
    normalized_residuals = [
        normalized_residual for normalized_residual in fitted if normalized_residual.motion == motion.index
    ]
    used = [
        normalized_residual.normalized_residual
        for normalized_residual in normalized_residuals
        if normalized_residual.used
    ]
    worst = max(
        used or [normalized_residual.normalized_residual for normalized_residual in normalized_residuals], default=None
    )
    trial = motion.trial
    note = motion.left_out
    if normalized_residuals and not used:
        note = "left out: it does not fit the others"
    return Trial(
        "motion" if trial is None else trial.kind, _about(trial), None,
        trial.lift_height if isinstance(trial, CommandedLift) else None,
        None, None, motion.duration, worst, note,
    )  # fmt: skip


def _about(trial: RecordedTrial | None) -> str:
    """What a trial is about, in words."""
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
