"""The precise method: 3-D CoM, mass and the whole inertia, with the sensors calibrated on the way."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Mapping, Sequence

from equipoise.calibration.settings import CalibrationSettings
from equipoise.experiments.planted import PlantedRobot
from equipoise.experiments.posture import BodyPosture
from equipoise.experiments.progress import Progress
from equipoise.paper.method import estimate_sways
from equipoise.precise.checks import judge
from equipoise.precise.measurements.evidence import Motion, read_evidence
from equipoise.precise.plan import describe
from equipoise.precise.posterior import Posterior, estimate_posterior
from equipoise.precise.posterior_evidence import PosteriorEvidence
from equipoise.precise.routine import PreciseRoutine, plan_ahead
from equipoise.precise.screening import screen
from equipoise.precise.sensor_findings import sensor_findings
from equipoise.recording.recording import Recording
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
        findings = tuple(sensor_findings(robot, posterior))
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


def _trial(motion: Motion, posterior: Posterior) -> Trial:
    misfits = {misfit.motion: misfit for misfit in (*posterior.lifts, *posterior.moves)}
    misfit = misfits.get(motion.index)
    about: Mapping[str, object] = motion.about
    kind = str(about.get("kind", "motion"))
    place = {name: about[name] for name in BodyPosture.__dataclass_fields__ if name in about} or about.get("posture")
    what = describe(BodyPosture(**place)) if isinstance(place, dict) else str(about.get("axis", ""))  # pyright: ignore
    words = [str(about[key]) for key in ("diagonal", "turn", "at") if about.get(key)]
    note = motion.left_out
    if misfit is not None and not misfit.used:
        note = "left out: it does not fit the others"
    return Trial(
        kind, ", ".join([*words, what] if what else words), None, about.get("lift_height") if kind == "lift" else None,  # pyright: ignore
        None, None, motion.duration, None if misfit is None else misfit.chi, note,
    )  # fmt: skip


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
