"""The precise method: 3-D CoM, mass and the whole inertia, with the sensors calibrated on the way."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, ClassVar, Literal

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import ReachError, RecordingError, SettingsError
from equipoise.experiments.dip import dip
from equipoise.experiments.planted import PlantedRobot
from equipoise.experiments.posture import feet_in_posture
from equipoise.experiments.progress import Progress
from equipoise.experiments.sway import SwaySettings
from equipoise.method.method import Method
from equipoise.method.rehearsal import Course, RehearsedPosture, held_posture, sway_postures
from equipoise.precise.budget import budget_of
from equipoise.precise.checks import HELD_OUT_CHECK, half_difference, judge
from equipoise.precise.findings.contradicted import assumed_imu_position, estimate_uncontradicted, not_believed
from equipoise.precise.findings.held_out import held_out, predict_held_out
from equipoise.precise.findings.link_findings import link_findings
from equipoise.precise.findings.sensor_findings import sensor_findings
from equipoise.precise.findings.torque_mass import assumed_mass, compare_at_rest, compare_estimate
from equipoise.precise.findings.witness import SwayWitness
from equipoise.precise.known.changes import Change, check_of_changes, estimate_after
from equipoise.precise.known.known_run import SCALE_GAIN, SCALE_NOISE, KnownRun
from equipoise.precise.known.short_plan import forecast_after
from equipoise.precise.known.short_routine import ShortRoutine
from equipoise.precise.lift_design import lift_feet, lift_settings
from equipoise.precise.measurements.evidence import MotionReading, RunEvidence, read_evidence
from equipoise.precise.measurements.leg_swing import LegSwing, SwingEvidence
from equipoise.precise.measurements.scale_reading import check_mass, check_mass_of
from equipoise.precise.plan import Durations, Goals, Plan
from equipoise.precise.planning.candidates import describe
from equipoise.precise.posterior import Posterior, body_jacobian, estimate_posterior
from equipoise.precise.posterior_evidence import PosteriorEvidence
from equipoise.precise.reading import PreciseReading
from equipoise.precise.routine import PreciseRoutine, plan_ahead
from equipoise.precise.screening import screen
from equipoise.precise.sway import sway_time
from equipoise.precise.unknowns import Priors
from equipoise.recording.recording import Recording
from equipoise.recording.trials import (
    CommandedLift,
    DesignedLift,
    LiftTrial,
    PostureTrial,
    RecordedTrial,
    SteppingTrial,
    SwayTrial,
)
from equipoise.result.body import Body
from equipoise.result.calibration import Calibration, Evidence, Trial, model_facts
from equipoise.result.findings import Check
from equipoise.result.held_out import FOUND, MODEL, HeldOut
from equipoise.result.mass_comparison import MassComparison
from equipoise.robot.inertial import COMPONENTS, InertialParameters, composite_parameters, nominal_inertia
from equipoise.robot.model import DIAGONALS, RobotModel
from equipoise.robot.stance import Stance, lies, lying_posture

_BUDGET, _BUDGET_AFTER = 120.0, 30.0  # [s] on an A1; where an earlier run is known
_LONGEST = 3600.0  # [s]
_FINEST, _COARSEST = 1e-4, 500.0  # [kg]
_CABLES = {"none": 0.0, "light": 1.0, "heavy": 5.0}  # pull over its prior
_SURFACES = {"hard": 1.0, "carpet": 3.0}  # rolling resistance, sag and unevenness over their priors
_OF_SURFACE = ("rolling", "sag", "floor_warp", "foothold_change")
_OF_LEGS = (
    "leg_mass_common", "link_com", "link_com_common", "link_length", "link_length_common", "hip_position", "foot_radius_each",
)  # fmt: skip
_TRUSTED_MASS = 0.03
_LOOKED_FOR = 2.0  # times as much may lengths of legs be off that are looked for: 1.5 mm on an A1


@dataclass(frozen=True)
class Precise(Method):
    """3-D CoM, mass and the whole inertia, with the sensors calibrated on the way.

    The robot lifts two diagonal feet in many postures, at rest and turning its body, and feels how it tips.

    Attributes:
        budget: robot time [s], as 60s or 2min; default 120 s on an A1, 30 s after an earlier run, more on larger robots.
        mass: mass of the whole robot, from a scale [kg]; without it the mass comes from joint torques.
        mass_sd: standard deviation of that [kg]; default 0.5 %.
        confirm_mass: confirm a mass that disagrees with the joint torques by more than 15 %, or by more than 5 % with the
            torque constants of an earlier run; without it the command asks before it lifts a foot. The result is doubtful.
        sway: the sway about all axes at the end, which tells more about friction and Izz.
        turn: turning the robot by 180 deg half-way, which somebody does while it lies limp: what pulls at it, an uneven floor
            and the accelerometer's bias are told from the planar CoM.
        surface: what the robot stands on; on a `carpet` feet may resist rolling, sag and stand uneven three times as much.
        goals: standard deviations at which a calibration is good enough to stop early.
        cable: what may pull at the robot, an Ethernet cable being light; `none` makes the planar CoM surer.
        legs: whether masses, CoMs and lengths of the legs may be off the file's, as ever, or are `trusted` to be right to 3 %
            in mass; trusted legs make the CoM's height and the inertia surer.
        priors: what is believed before anything is measured; a TOML file of standard deviations by name.
        known: an earlier run of the same robot, whose sensors, legs and friction are known then: the run's folder. Half a
            minute does (default budget 30 s on an A1) for the CoM; what changed since is named.
        swings: lifts in which the two lifted feet swing as well, which teach what the legs weigh, where their CoMs are and
            how long they are; the CoM's height and the inertia become surer with them.
        leg_swing: what legs that swing in the air said of themselves in the same run; no setting.
    """

    name: ClassVar[str] = "precise"
    summary: ClassVar[str] = (
        "the robot lifts two diagonal feet in many postures, at rest and turning its body, and feels how it tips; mass, 3-D "
        "centre of mass and inertia with intervals, its sensors calibrated on the way"
    )
    estimates: ClassVar[tuple[str, ...]] = COMPONENTS
    judging: ClassVar[tuple[str, ...]] = ("mass", "mass_sd", "cable", "legs", "surface", "priors", "known")

    budget: float | None = None
    mass: float | None = None
    mass_sd: float | None = None
    sway: bool = True
    turn: bool = False
    cable: Literal["none", "light", "heavy"] = "light"
    legs: Literal["unknown", "trusted"] = "unknown"
    surface: Literal["hard", "carpet"] = "hard"
    goals: Goals = field(default_factory=Goals, metadata={"prefix": None})
    priors: Priors = field(default_factory=Priors, metadata={"file": Priors.read})
    known: KnownRun | None = field(default=None, metadata={"file": KnownRun.read, "metavar": "RUN"})
    swings: bool = field(default=False, metadata={"flag": False})  # `--what legs` says it
    leg_swing: LegSwing | None = field(default=None, metadata={"flag": False}, compare=False)
    confirm_mass: bool = False

    def __post_init__(self) -> None:
        if self.budget is not None and not 0.0 < self.budget <= _LONGEST:  # how long it must be, a robot's plan says
            raise SettingsError(f"budget is {self.budget:g} s; it must be above zero, up to {_LONGEST:g} s")
        if self.mass_sd is not None and not _FINEST <= self.mass_sd <= _COARSEST:
            raise SettingsError(f"mass_sd is {self.mass_sd}; it must be from {_FINEST:g} to {_COARSEST:g}")
        if self.mass is not None:
            check_mass(self.mass, self.mass_sd)
        if self.mass_sd is not None and self.mass is None:
            raise SettingsError("mass_sd says how sure a scale is; give its mass too")
        if self.confirm_mass and self.mass is None:
            raise SettingsError("confirm_mass confirms a given mass, and there is none; give mass too, or leave it out")
        for name, known in (("cable", _CABLES), ("legs", ("unknown", "trusted")), ("surface", _SURFACES)):
            if getattr(self, name) not in known:
                raise SettingsError(f"{name} is {getattr(self, name)!r}; it must be {' or '.join(known)}")
        if self.known is not None and self.turn:
            raise SettingsError(
                "turn needs no earlier run, and a run after one does not turn; leave one of the two out"
            )
        if self.swings and (self.known is not None or self.legs == "trusted"):
            known = "are known from an earlier run" if self.known is not None else "are trusted to be as the file says"
            raise SettingsError(f"legs that {known} are not looked for; leave one of the two out")
        if self.known is not None and self.legs not in ("unknown", self.known.legs):
            raise SettingsError(
                f"legs is {self.legs!r}, and was {self.known.legs!r} in the earlier run, which knows them as that said"
            )

    @property
    def beliefs(self) -> Priors:
        """The priors, with what was said of cable, surface, turn and legs, and what an earlier run has of what is kept."""
        said = self._said
        return said if self.known is None else self.known.priors_of(said, self._same_scale)

    @property
    def _same_scale(self) -> bool:
        """Whether the scale is taken to be that of the earlier run: who says how sure a scale is has another one."""
        return self.known is not None and None not in (self.known.weighed, self.mass) and self.mass_sd is None

    @property
    def _said(self) -> Priors:
        """The priors, with what was said of cable, surface, turn and legs."""
        wider = dict.fromkeys(_OF_SURFACE, _SURFACES[self.surface]) | {"pull": _CABLES[self.cable]}
        priors = replace(self.priors, **{name: factor * getattr(self.priors, name) for name, factor in wider.items()})
        if not self.turn:
            priors = priors.holding("foothold_change")
        if self.swings:  # who looks for legs does not trust the file's
            priors = replace(priors, link_length=_LOOKED_FOR * priors.link_length)
        if self.legs == "unknown":
            return priors
        return replace(priors.holding(*_OF_LEGS), leg_mass=min(_TRUSTED_MASS, priors.leg_mass))

    @property
    def assumptions(self) -> tuple[str, ...]:
        """What somebody said who knows more than the priors."""
        said = ("no cable pulls at the robot",) if self.cable == "none" else ()
        trusted = f"masses of the legs are the file's to {_TRUSTED_MASS:.0%}, their CoMs and lengths exactly"
        legs = self.legs if self.known is None else self.known.legs
        said = said if legs == "unknown" else (*said, trusted)
        return said if self.known is None else (*said, f"sensors, legs and friction are those of {self.known.name}")

    def budget_for(self, stance: Stance) -> float:
        """[s]."""
        return self.budget or (_BUDGET if self.known is None else _BUDGET_AFTER) * stance.scale.time

    @property
    def scale(self) -> tuple[float, float] | None:
        """The scale's mass and its standard deviation [kg], or None."""
        if self.mass is None:
            return None
        return self.mass, self.mass_sd or (SCALE_NOISE if self._same_scale else SCALE_GAIN) * self.mass

    def weighed(self, mass: float, deviation: float) -> Precise:
        return replace(self, mass=mass, mass_sd=deviation, confirm_mass=True)  # there is no operator to ask

    def informed(self, evidence: Evidence) -> Precise:
        """Told of legs that swung in the air, if legs are looked for."""
        return (
            replace(self, leg_swing=evidence.legs) if self.is_informed and isinstance(evidence, SwingEvidence) else self
        )

    @property
    def is_informed(self) -> bool:
        return self.swings

    def to_dict(self) -> dict[str, Any]:
        own = {name: value for name, value in super().to_dict().items() if name not in ("known", "leg_swing")}
        return own if self.known is None else {**own, "known": self.known.reference}

    def attachments(self) -> Mapping[str, Mapping[str, Any]]:
        return {} if self.known is None else {"known": self.known.to_dict()}

    def check(self, robot: RobotModel, stance: Stance) -> None:
        """Refuse a budget that is too small, a mass that is no such robot's (SettingsError), and a robot that can do no
        lift, or not lie (ReachError).
        """
        if self.turn and not lies(robot, stance, lying_posture(robot, stance)[0]):
            raise ReachError(f"{robot.name!r} cannot lie down over its feet to be turned; leave the turn out")
        if self.mass is not None:
            check_mass_of(robot, self.mass)
        self.forecast(robot, stance)

    def forecast(self, robot: RobotModel, stance: Stance) -> Plan:
        if self.known is not None:
            return forecast_after(robot, stance, self, self.known)
        return plan_ahead(robot, stance, self, self.leg_swing)

    def expected_trials(self, stance: Stance) -> int:
        return round(self.budget_for(stance) / Durations.of(stance).lift)

    def mass_in_doubt(self, planted: PlantedRobot, stance: Stance) -> MassComparison | None:
        if self.scale is None or self.confirm_mass or planted.platform.read().joint_torque is None:
            return None
        compared = compare_at_rest(planted.robot, stance, self.scale, dip(planted, stance), self.known)
        return compared if compared is not None and compared.disagrees else None

    def run(
        self,
        planted: PlantedRobot,
        stance: Stance,
        recordings: Sequence[Recording],
        report: Callable[[Progress], None] | None = None,
    ) -> None:
        """Search, planned trials, sway."""
        kind = PreciseRoutine if self.known is None else ShortRoutine
        kind(planted, planted.robot, stance, self, recordings, report).run()

    def rehearse(self, robot: RobotModel, stance: Stance) -> Course:
        plan = self.forecast(robot, stance)
        postures, time = _planned_postures(robot, stance, plan), plan.robot_time
        search, sway = (4, self.sway) if self.known is None else (2, False)
        if sway:
            time += sway_time(stance)
            postures += sway_postures(robot, stance, SwaySettings())
        doing = (
            f"moves its body over planted feet through {len(plan.visits)} postures, lifts two diagonal feet "
            f"{plan.lifts + search} times{', is turned by hand half-way, lying limp' if self.turn else ''}"
            f"{', sways' if sway else ''}"
        )
        return Course(doing, time, tuple(postures))

    def reading(self, robot: RobotModel, stance: Stance, recordings: Sequence[Recording]) -> PreciseReading:
        return PreciseReading(robot, stance, recordings, self.beliefs, self.scale, self.known)

    def estimate(
        self, robot: RobotModel, recordings: Sequence[Recording], stance: Stance, lifts_needed: bool = True
    ) -> Calibration:
        """What the recordings of a run of this method say.

        Args:
            lifts_needed: whether recordings without a usable lift are refused; else joint torques tell what they can.

        Raises:
            RecordingError: they hold nothing that can be used, sensors contradict each other, or the estimate predicts
                held-out motions worse than the model file does.
        """
        timings: dict[str, float] = {}
        with _Timed(timings, "screen the sensors"):
            screen(robot, recordings)
        with _Timed(timings, "read the recordings"):
            evidence = read_evidence(robot, stance, recordings)
            evidence = evidence if self.leg_swing is None else evidence.with_swing(self.leg_swing)
        with _Timed(timings, "estimate"):
            posterior, changes = self._posterior(robot, stance, evidence, lifts_needed)
        with _Timed(timings, "check"):
            predictions = predict_held_out(evidence, posterior, self.known)
            predicted = held_out(predictions)
            masses = compare_estimate(posterior, self.scale, self.known)
            looked_at = judge(robot, evidence, posterior, predicted, masses)
            looked_at += [] if self.known is None else [check_of_changes(changes, self.known)]
            checks = tuple(sorted(looked_at, key=lambda check: check.passed))
            _refuse_worse_than_file(predicted, checks)
            findings = (*map(Change.finding, changes), *sensor_findings(posterior))
        nominal = nominal_inertia(robot, stance.joint_position)
        well = all(check.passed for check in checks)

        unknowns = posterior.unknowns
        apart = None if well else half_difference(posterior)

        def judged(body: Body, of: Callable[[FloatArray], InertialParameters]) -> Body:
            return body if apart is None else body.doubted(np.abs(body_jacobian(unknowns, posterior.x, of) @ apart))

        links = link_findings(unknowns, posterior.x, posterior.covariance) if self.swings else {}

        return Calibration(
            **model_facts(robot, stance.joint_position),
            method=self.name,
            composite=judged(
                Body.known(
                    posterior.robot_body, posterior.robot_covariance, posterior.prior_deviation, nominal.composite
                ),
                unknowns.robot_body,
            ),
            base=judged(
                Body.known(
                    posterior.base_body, posterior.base_covariance, posterior.base_prior_deviation, nominal.base
                ),
                unknowns.base_body,
            ),
            stance_effective=judged(
                Body.known(
                    posterior.stance_effective_body,
                    posterior.stance_effective_covariance,
                    posterior.prior_deviation,
                    nominal.stance_effective,
                ),
                unknowns.stance_effective_body,
            ),
            sensors=findings,
            checks=checks,
            sways={},
            support_lines={},
            trials=tuple(_trial(motion, posterior) for motion in evidence.motions if motion.leg_swing is None),
            settings=self.to_dict(),
            warnings=tuple(f"{check.name}: {check.message}" for check in checks if not check.passed),
            assumptions=(
                *assumed_mass(self.scale, masses),
                *self.assumptions,
                *not_believed(posterior),
                *assumed_imu_position(posterior, evidence),
            ),
            evidence=PosteriorEvidence(tuple(recordings), evidence.motions, posterior, changes, predictions),
            held_out=predicted,
            mass_comparison=masses,
            budget=budget_of(posterior),
            links=links if well else {name: link.doubted() for name, link in links.items()},
            timings=timings,
        )

    def _posterior(
        self, robot: RobotModel, stance: Stance, evidence: RunEvidence, lifts_needed: bool
    ) -> tuple[Posterior, tuple[Change, ...]]:
        if self.known is None:

            def estimate(priors: Priors, sway_heard: bool = False) -> Posterior:
                # Lengths of legs come from planted moves, which say how quiet feet are where legs are looked for.
                return estimate_posterior(
                    robot, stance, evidence, priors, self.scale,
                    lifts_needed=lifts_needed, quiet_feet=self.swings, sway_heard=sway_heard,
                )  # fmt: skip

            # What looks like an IMU that sits elsewhere is lengths of legs that are off, unless they are trusted.
            heard = self.legs == "trusted"
            posterior = estimate_uncontradicted(partial(estimate, sway_heard=heard), self.beliefs, evidence)
            witness = None if heard else SwayWitness.of(evidence, posterior)
            if witness is not None and witness.tells:
                posterior = estimate_uncontradicted(partial(estimate, sway_heard=True), self.beliefs, evidence)
            return posterior, ()
        return estimate_after(robot, stance, evidence, self.beliefs, self.scale, self.known, lifts_needed)


def _refuse_worse_than_file(predicted: HeldOut | None, checks: Sequence[Check]) -> None:
    """Refuse an estimate that predicts unseen motions worse than the model file does, and worse than chance explains.

    Of a short run of a robot that is nearly its file's the one that predicts worse is a matter of chance.
    """
    if predicted is None or all(check.passed for check in checks if check.name == HELD_OUT_CHECK):
        return
    found, file = (1000 * predicted.error(body) for body in (FOUND, MODEL))
    if found > file:
        failed = "; ".join(f"{check.name}: {check.message}" for check in checks if not check.passed)
        raise RecordingError(
            f"no estimate is shown: it predicts {predicted.counted} from {predicted.others} within {found:.2f} mm rms, the "
            f"model file within {file:.2f} mm. Something acted on the robot that no equation has, or sensors, joint order or "
            f"model file are wrong. Checks that failed: {failed}"
        )


def _planned_postures(robot: RobotModel, stance: Stance, plan: Plan) -> list[RehearsedPosture]:
    com, height = composite_parameters(robot, stance.joint_position).com, lift_settings(stance).height
    found: list[RehearsedPosture] = []
    for visit in plan.visits:
        where = describe(visit.posture)
        found.append(held_posture(robot, where, feet_in_posture(stance, com, visit.posture), stance.joint_position))
        for lift in visit.lifts:
            _, lifted = lift_feet(stance, com, lift, height)
            what = f"{where}: two feet up, on {lift.diagonal}"
            ends = (0.0,) if lift.passive else (lift.amplitude(stance), -lift.amplitude(stance))
            for times, amount in zip((1, 0), ends, strict=False):
                feet = lift.feet(lifted, com, amount)
                found.append(held_posture(robot, what, feet, stance.joint_position, DIAGONALS[lift.diagonal], times))
    return found


def _trial(motion: MotionReading, posterior: Posterior) -> Trial:
    misfits = [misfit for misfit in (*posterior.lifts, *posterior.moves) if misfit.motion == motion.index]
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


class _Timed:
    """Measures a stage."""

    def __init__(self, timings: dict[str, float], stage: str) -> None:
        self._timings, self._stage = timings, stage

    def __enter__(self) -> None:
        self._start = time.perf_counter()

    def __exit__(self, *exception: object) -> None:
        self._timings[self._stage] = time.perf_counter() - self._start
