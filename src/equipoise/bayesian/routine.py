"""Experiment of the Bayesian method: search, planned trials, then an excitation about all axes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np

from equipoise.bayesian.excitation import excitation_all_axes, excitation_time
from equipoise.bayesian.lift_design import LiftDesign
from equipoise.bayesian.newton_search import find_com_fast, loaded_robot
from equipoise.bayesian.plan import FEW_LIFTS, Durations, Plan, make_plan
from equipoise.bayesian.planning.candidates import Candidates, describe
from equipoise.bayesian.planning.nominal import nominal_candidates
from equipoise.bayesian.safe_lift import search_covariance
from equipoise.bayesian.settings import BayesianSettings
from equipoise.bayesian.trials import BayesianTrials
from equipoise.errors import EquipoiseError, MotionError, ReachError
from equipoise.estimator.equations.equation import MotionSamples
from equipoise.estimator.equations.leg_swing import LegSwings
from equipoise.estimator.motions import read_motions
from equipoise.estimator.prior_runs.changes import Change, estimate_with_prior_run
from equipoise.estimator.problem import Posterior, prior_rows
from equipoise.experiments.progress import Progress
from equipoise.experiments.standing_robot import StandingRobot
from equipoise.experiments.turn import check_turn
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.robot.inertial import components, composite_parameters
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance

_REPLAN_AT = 0.55  # of the visits
_SAFETY_FACTOR = 2.0  # standard deviations
_FEWEST_LIFTS = 4  # with fewer lifts the run fails, unless its time ran out


@lru_cache(maxsize=4)  # computed before the robot moves, and again for display
def plan_ahead(robot: RobotModel, stance: Stance, settings: BayesianSettings, swings: Sequence[Recording] = ()) -> Plan:
    """Plan the trials of a robot that equals its model; raises SettingsError or ReachError if no plan is possible.

    Args:
        swings: predicted recordings of legs that swing in the air afterwards.
    """
    return plan_for(nominal_candidates(robot, settings.combined_priors, settings.swings), stance, settings, swings)


def plan_for(
    candidates: Candidates, stance: Stance, settings: BayesianSettings, swings: Sequence[Recording] = ()
) -> Plan:
    """Plan the trials from the prior alone; raises SettingsError if the duration is too short."""
    reserved, after = _excitation_time(stance, settings), None
    swung = LegSwings.of(candidates.unknowns, [MotionSamples(0, samples=tuple(swings))])
    if swung is not None:
        ((_, after, _),) = swung.by_motion(candidates.unknowns.start())
    return make_plan(
        candidates,
        settings.duration_for(stance),
        settings.goals,
        turn=settings.rotate_halfway,
        reserved=reserved,
        after=after,
    )


def _excitation_time(stance: Stance, settings: BayesianSettings) -> float:
    return excitation_time(stance) if settings.excitation else 0.0


class BayesianRoutine:
    """Experiment on a standing robot; `standing.keep` stores the recordings, and decisions depend on them alone."""

    def __init__(
        self,
        standing: StandingRobot,
        stance: Stance,
        settings: BayesianSettings,
        recordings: Sequence[Recording],
        report: Callable[[Progress], None] | None = None,
    ) -> None:
        self.standing, self.stance, self.settings = standing, stance, settings
        self.robot = standing.robot  # the model of the user; that of `standing` follows the estimate
        self._recordings, self._report = recordings, report
        self.trials = BayesianTrials(standing, stance, composite_parameters(self.robot, stance.joint_position).com)
        self._obstacles: list[str] = []
        self._changes: tuple[Change, ...] = ()
        self._expected = 0

    def run(self) -> None:
        """Run the whole experiment.

        Raises:
            MotionError: a motion failed.
        """
        if self.settings.rotate_halfway:
            check_turn(self.standing)
        self._expected = round(self.settings.duration_for(self.stance) / Durations.of(self.stance).lift)
        self._search()
        self._report_progress("planning the most informative lifts")
        candidates = self._candidates()
        plan = plan_for(candidates, self.stance, self.settings)
        self._expected = (
            len(self._recordings)
            + len(plan.visits)
            + plan.lifts
            + self.settings.rotate_halfway
            + self.settings.excitation
        )
        done: list[LiftDesign] = []
        # With too few safe lifts, replan after the first visit, when the CoM is more certain.
        replan_at = round(_REPLAN_AT * len(plan.visits)) if len(candidates.lifts) >= FEW_LIFTS else 1
        if plan.rotate_after is not None:
            replan_at = plan.rotate_after
        self._visit(plan, 0, replan_at, done)
        posterior = self._posterior()
        if posterior is None or not self._good_enough(posterior):
            self._use_estimate(posterior)
            if self.settings.rotate_halfway:
                self._report_progress("turn the robot to face the other way")
                self.trials.turn()
            self._report_progress("planning the remaining trials")
            rest = self._replan(posterior, done)
            if rest is None or len(done) + rest.lifts < _FEWEST_LIFTS:  # stance motions alone are not sufficient
                rest = plan
            self._visit(rest, 0 if rest is not plan else replan_at, len(rest.visits), done)
        self._refuse_few(done, _FEWEST_LIFTS)
        if self.settings.excitation:
            self._report_progress("excitation about all axes")
            excitation_all_axes(self.standing, self.stance, self.trials.com)

    def _refuse_few(self, done: Sequence[LiftDesign], fewest: int) -> None:
        """Raise MotionError if fewer lifts than necessary were done because others were out of reach."""
        if len(done) < fewest and self._obstacles:
            raise MotionError(
                f"only {len(done)} of the planned lifts were possible: {'; '.join(self._obstacles)}",
                tuple(self._recordings),
            )

    def _search(self, calibrated: bool = False) -> None:
        """Search the planar CoM; a payload that the search finds makes the height of the CoM uncertain."""
        find_com_fast(self.trials, lambda diagonal: self._report_progress(f"search on {diagonal}"), calibrated)
        self.trials.com_covariance = search_covariance(self.stance, abs(self.standing.robot.mass / self.robot.mass - 1))

    def _visit(self, plan: Plan, first: int, last: int, done: list[LiftDesign]) -> None:
        durations = Durations.of(self.stance)
        budget = self._budget - durations.end
        for visit in plan.visits[first:last]:
            if self._time() + durations.posture + bool(visit.lifts) * durations.lift > budget:
                return
            if not self._do(describe(visit.posture), lambda posture=visit.posture: self.trials.take_posture(posture)):
                continue
            for design in visit.lifts:
                if self._time() + durations.lift > budget:
                    return
                name = f"lift on {design.diagonal}, {design.meanwhile}: {describe(design.posture)}"
                if self._do(name, lambda design=design: self.trials.lift(design)):
                    done.append(design)

    def _do(self, name: str, motion: Callable[[], object]) -> bool:
        """Do a motion; return False and note the reason if it is out of reach."""
        self._report_progress(name)
        try:
            motion()
        except ReachError as error:
            self.standing.take()
            self._obstacles.append(f"{name}: {error}")
            return False
        return True

    def _posterior(self, lifts_needed: bool = True) -> Posterior | None:
        """Return the posterior of the recordings so far; None if it cannot be estimated."""
        priors, scale, prior_run = self.settings.combined_priors, self.settings.scale, self.settings.prior_run
        try:
            motions = read_motions(self.robot, self.stance, self._recordings)
            posterior, self._changes = estimate_with_prior_run(
                self.robot, self.stance, motions, priors, scale, prior_run, lifts_needed, rounds=1
            )
        except (EquipoiseError, np.linalg.LinAlgError):
            return None
        return posterior

    def _good_enough(self, posterior: Posterior) -> bool:
        goals = self.settings.goals.vector(components(posterior.robot_body), self.stance)
        return bool((np.sqrt(np.diag(posterior.robot_covariance)) <= goals).all())

    def _use_estimate(self, posterior: Posterior | None) -> None:
        """Use the current estimates of CoM and mass for support lines and torques."""
        if posterior is None:
            return
        body = posterior.robot_body
        if np.linalg.norm(body.com - self.trials.com) < 0.1 * self.stance.hip_height:
            self.trials.com = body.com
            com_covariance = posterior.robot_covariance[1:4, 1:4]
            self.trials.com_covariance = _SAFETY_FACTOR**2 * com_covariance + search_covariance(self.stance)
            self.standing.robot = loaded_robot(self.robot, self.trials, body.mass)

    def _candidates(self) -> Candidates:
        """Return the candidates for the current estimate of the robot."""
        trials, settings = self.trials, self.settings
        return Candidates.of(
            self.standing.robot,
            self.stance,
            trials.com,
            settings.combined_priors,
            trials.com_covariance,
            settings.swings,
        )

    def _replan(self, posterior: Posterior | None, done: list[LiftDesign]) -> Plan | None:
        """Plan the remaining time with the information of the recordings so far."""
        if posterior is None:
            return None
        _, rows = prior_rows(posterior.unknowns, posterior.x, self.settings.scale)
        information = rows.T @ rows + sum(posterior.information.values())
        left, candidates = self._budget - self._time(), self._candidates()
        if self.settings.rotate_halfway:
            return make_plan(candidates.turned(), left, self.settings.goals, information)
        return make_plan(candidates, left, self.settings.goals, information, done)

    @property
    def _budget(self) -> float:
        return self.settings.duration_for(self.stance) - _excitation_time(self.stance, self.settings)

    def _time(self) -> float:
        """Return the robot time so far, without the time in which the operator turned the robot [s]."""
        waited = [r.phase(Phase.TURN).duration for r in self._recordings if r.has_phase(Phase.TURN)]
        return sum(recording.duration for recording in self._recordings) - sum(waited)

    def _report_progress(self, doing: str) -> None:
        if self._report is not None:
            done = len(self._recordings)
            self._report(Progress(doing, done, max(self._expected, done + 1)))
