"""The precise method: 3-D CoM, mass and the whole inertia, with the sensors calibrated on the way."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Sequence

from equipoise.calibration.settings import CalibrationSettings
from equipoise.experiments.planted import PlantedRobot
from equipoise.experiments.progress import Progress
from equipoise.paper.method import estimate_sways
from equipoise.precise.checks import judge
from equipoise.precise.measurements.evidence import MotionReading, read_evidence
from equipoise.precise.plan import describe
from equipoise.precise.posterior import Posterior, estimate_posterior
from equipoise.precise.posterior_evidence import PosteriorEvidence
from equipoise.precise.routine import PreciseRoutine, plan_ahead
from equipoise.precise.screening import screen
from equipoise.precise.sensor_findings import sensor_findings
from equipoise.recording.recording import Recording
from equipoise.recording.trials import CommandedLift, DesignedLift, LiftTrial, PostureTrial, RecordedTrial, SwayTrial
from equipoise.result.body import Body
from equipoise.result.calibration import Calibration, SwayEstimate, Trial, model_facts
from equipoise.robot.inertial import nominal_inertia
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance

_PAPER_BIAS = (
    "the paper's I leaves out the shanks and takes legs to have no mass, and joint friction in the motor torques adds to I "
    "and to C; compare with stance_effective"
)


def check(robot: RobotModel, stance: Stance, settings: CalibrationSettings) -> None:
    """Refuse settings that do not fit a robot, before anything moves.

    Raises:
        SettingsError: the budget is too small.
        ReachError: no lift is within reach.
    """
    plan_ahead(robot, stance, settings.precise)


def run(
    planted: PlantedRobot,
    stance: Stance,
    settings: CalibrationSettings,
    recordings: Sequence[Recording],
    report: Callable[[Progress], None] | None = None,
) -> None:
    """Search, planned trials, sway; recordings go where `planted.keep` takes them."""
    PreciseRoutine(planted, planted.robot, stance, settings.precise, recordings, report).run()


def estimate(
    robot: RobotModel,
    recordings: Sequence[Recording],
    settings: CalibrationSettings,
    stance: Stance,
    lifts_needed: bool = True,
) -> Calibration:
    """What the recordings of a run of this method say.

    Args:
        lifts_needed: whether recordings without a usable lift are refused; else joint torques tell what they can.

    Raises:
        RecordingError: they hold nothing that can be used, or sensors that cannot be believed.
    """
    timings: dict[str, float] = {}
    with _Timed(timings, "screen the sensors"):
        screen(robot, recordings)
    with _Timed(timings, "read the recordings"):
        evidence = read_evidence(robot, stance, recordings)
    with _Timed(timings, "estimate"):
        precise = settings.precise
        posterior = estimate_posterior(
            robot, stance, evidence, precise.priors, precise.scale, lifts_needed=lifts_needed
        )
    with _Timed(timings, "check"):
        checks = tuple(sorted(judge(robot, evidence, posterior), key=lambda check: check.passed))
        findings = tuple(sensor_findings(posterior))
    with _Timed(timings, "the paper's I and C"):
        sways, fits, _ = estimate_sways(robot, recordings, posterior.robot_body.com, stance, settings.sway)
        sways = {axis: _explained(sway) for axis, sway in sways.items()}
    nominal = nominal_inertia(robot, stance.joint_position)
    return Calibration(
        **model_facts(robot, stance.joint_position),
        method=settings.method,
        composite=Body.known(
            posterior.robot_body, posterior.robot_covariance, posterior.prior_deviation, nominal.composite
        ),
        base=Body.known(posterior.base_body, posterior.base_covariance, posterior.base_prior_deviation, nominal.base),
        stance_effective=Body.known(
            posterior.stance_effective_body,
            posterior.stance_effective_covariance,
            posterior.prior_deviation,
            nominal.stance_effective,
        ),
        sensors=findings,
        checks=checks,
        sways=sways,
        support_lines={},
        trials=tuple(_trial(motion, posterior) for motion in evidence.motions),
        settings=dataclasses.asdict(settings),
        warnings=tuple(f"{check.name}: {check.message}" for check in checks if not check.passed),
        evidence=PosteriorEvidence(stance.feet_in_base, tuple(recordings), fits, evidence.motions, posterior),
        timings=timings,
    )


def _trial(motion: MotionReading, posterior: Posterior) -> Trial:
    misfits = {misfit.motion: misfit for misfit in (*posterior.lifts, *posterior.moves)}
    misfit = misfits.get(motion.index)
    trial = motion.trial
    note = motion.left_out
    if misfit is not None and not misfit.used:
        note = "left out: it does not fit the others"
    return Trial(
        "motion" if trial is None else trial.kind, _about(trial), None,
        trial.lift_height if isinstance(trial, CommandedLift) else None,
        None, None, motion.duration, None if misfit is None else misfit.chi, note,
    )  # fmt: skip


def _about(trial: RecordedTrial | None) -> str:
    """What a trial is about, in words."""
    if trial is None:
        return ""
    words = [trial.diagonal] if isinstance(trial, LiftTrial) else []
    if isinstance(trial, DesignedLift) and trial.turn is not None:
        words.append(trial.turn)
    if trial.found_at is not None:
        words.append(f"at {trial.found_at:.1f} s")
    if isinstance(trial, DesignedLift | PostureTrial) and trial.posture is not None:
        words.append(describe(trial.posture))
    if isinstance(trial, SwayTrial):
        words.append(trial.about)
    return ", ".join(words)


def _explained(sway: SwayEstimate) -> SwayEstimate:
    if sway.moment is None:
        return sway
    return dataclasses.replace(sway, note="; ".join(note for note in (sway.note, _PAPER_BIAS) if note))


class _Timed:
    """Measures a stage."""

    def __init__(self, timings: dict[str, float], stage: str) -> None:
        self._timings, self._stage = timings, stage

    def __enter__(self) -> None:
        self._start = time.perf_counter()

    def __exit__(self, *exception: object) -> None:
        self._timings[self._stage] = time.perf_counter() - self._start
