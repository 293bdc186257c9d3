"""A row of a result for each trial of a run of the precise method."""

from __future__ import annotations

from equipoise.estimator.equations.equation import MotionSamples
from equipoise.estimator.equations.planted_moves import PlantedMoves
from equipoise.estimator.equations.tilt import TiltEquation
from equipoise.estimator.problem import Posterior
from equipoise.precise.planning.candidates import describe
from equipoise.recording.trials import (
    CommandedLift,
    DesignedLift,
    LiftTrial,
    PostureTrial,
    RecordedTrial,
    SteppingTrial,
    SwayTrial,
)
from equipoise.result.calibration import Trial


def trial_row(motion: MotionSamples, posterior: Posterior) -> Trial:
    """Return what is said of a motion: what it was, how well it fits, and why it was left out."""
    fitted = *posterior.misfits_of(TiltEquation), *posterior.misfits_of(PlantedMoves)
    misfits = [misfit for misfit in fitted if misfit.motion == motion.index]
    used = [misfit.normalised_residual for misfit in misfits if misfit.used]
    worst = max(used or [misfit.normalised_residual for misfit in misfits], default=None)
    trial = motion.trial
    note = motion.left_out
    if misfits and not used:
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
    if isinstance(trial, SwayTrial):
        words.append(trial.about)
    return ", ".join(words)
