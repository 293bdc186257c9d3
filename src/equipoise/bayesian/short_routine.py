"""Experiment of a run with a prior run: stance motions, a short search, few lifts."""

from __future__ import annotations

import numpy as np

from equipoise.bayesian.lift_design import LiftDesign
from equipoise.bayesian.plan import Durations, Plan
from equipoise.bayesian.planning.candidates import describe
from equipoise.bayesian.planning.nominal import nominal_candidates
from equipoise.bayesian.routine import BayesianRoutine
from equipoise.bayesian.short_plan import information_before, opening_moves, plan_after_search
from equipoise.estimator.prior_runs.prior_run import PriorRun
from equipoise.estimator.problem import Posterior
from equipoise.robot.inertial import composite_parameters

_MORE_TIME = 15.0  # [s] on an A1, if a parameter changed and no duration is given
_FEWEST_LIFTS = 2
_LARGEST_STD = 0.05  # of the hip height: largest std of a planar CoM from stance motions that the search starts at


class ShortRoutine(BayesianRoutine):
    """Experiment on a standing robot; the prior run's base is used only to start the search."""

    @property
    def _prior_run(self) -> PriorRun:
        assert self.settings.prior_run is not None
        return self.settings.prior_run

    def run(self) -> None:
        """Run the whole experiment.

        Raises:
            MotionError: a motion failed.
        """
        self._expected = round(self._budget / Durations.of(self.stance).lift)
        self.standing.robot = self.robot.with_base(self._prior_run.base_body.to_pinocchio())
        self.trials.com = composite_parameters(self.standing.robot, self.stance.joint_position).com
        for posture in opening_moves(nominal_candidates(self.robot, self.settings.combined_priors), self._prior_run):
            self._do(describe(posture), lambda posture=posture: self.trials.take_posture(posture))
        early = self._posterior(lifts_needed=False)
        largest = _LARGEST_STD * self.stance.hip_height
        if early is not None and early.robot_covariance[1:3, 1:3].trace() < largest**2:
            self._use_estimate(early)
        self._search(calibrated=True)
        posterior = self._posterior()
        self._use_estimate(posterior)
        plan, done = self._rest(posterior), list[LiftDesign]()
        self._expected = len(self._recordings) + len(plan.visits) + plan.lifts
        self._visit(plan, 0, len(plan.visits), done)
        self._refuse_few(done, _FEWEST_LIFTS)

    def _rest(self, posterior: Posterior | None) -> Plan:
        """Plan the remaining time."""
        candidates = self._candidates()
        if posterior is None:
            information = information_before(candidates, self._prior_run, {}, self.settings.scale)
        else:
            information = np.asarray(np.linalg.inv(posterior.covariance), dtype=float)
        return plan_after_search(candidates, self._budget - self._time(), self.settings.goals, information)

    @property
    def _budget(self) -> float:
        more = _MORE_TIME * self.stance.scale.time if self._changes and self.settings.duration is None else 0.0
        return self.settings.duration_for(self.stance) + more
