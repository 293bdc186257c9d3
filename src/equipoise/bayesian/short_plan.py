"""Plan of a run with a prior run: stance motions that detect changed joint offsets, then few lifts for the CoM.

With calibrated sensors, one lift per diagonal suffices as search. The remaining time is used for the lifts that determine
the CoM best.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np

from equipoise.bayesian.goals import Goals
from equipoise.bayesian.plan import Durations, Plan, Visit, make_plan
from equipoise.bayesian.planning.candidates import Candidates
from equipoise.bayesian.planning.gains import Steps
from equipoise.bayesian.planning.nominal import nominal_candidates
from equipoise.bayesian.routine import plan_ahead
from equipoise.bayesian.settings import BayesianSettings
from equipoise.conventions import FloatArray
from equipoise.errors import SettingsError
from equipoise.estimator.prior_runs.changes import FREE
from equipoise.estimator.prior_runs.prior_run import SCALE_GAIN, PriorRun
from equipoise.estimator.problem import prior_rows
from equipoise.robot.model import DIAGONALS, RobotModel
from equipoise.robot.posture import BodyPosture
from equipoise.robot.stance import Stance

_OPENING = 3  # stance motions
_FEWEST_LIFTS = 2


def short_plan(robot: RobotModel, stance: Stance, settings: BayesianSettings, prior_run: PriorRun) -> Plan:
    """Plan the trials of a robot whose load equals its model's.

    Raises:
        SettingsError: the prior run is of another robot, or the duration allows too few lifts.
        ReachError: no lift is possible.
    """
    prior_run.check(robot)
    candidates, durations = nominal_candidates(robot, settings.combined_priors), Durations.of(stance)
    opening = opening_moves(candidates, prior_run)
    # As in other plans, the mass is assumed to come from a scale, or to be as accurate from torques.
    information = information_before(candidates, prior_run, {}, settings.scale or (robot.mass, SCALE_GAIN * robot.mass))
    moves = [len(candidates.lifts) + candidates.postures.index(posture) for posture in opening]
    for index in (*moves, *candidates.search):
        information = information + candidates.information(index)
    spent = len(opening) * durations.posture + len(DIAGONALS) * durations.lift
    budget = settings.duration_for(stance)
    plan = plan_after_search(candidates, budget - spent, settings.goals, information)
    if plan.lifts < _FEWEST_LIFTS:
        least = spent + durations.end + _FEWEST_LIFTS * (durations.posture + durations.replant + durations.lift)
        raise SettingsError(
            f"a duration of {budget:.0f} s allows {plan.lifts} lifts after the search; give {math.ceil(least)} s or more"
        )
    visits = (*map(Visit, opening), *plan.visits)
    return replace(plan, visits=visits, robot_time=plan.robot_time + spent, before_search=len(opening), search=1)


def plan_after_search(candidates: Candidates, left: float, goals: Goals, information: FloatArray) -> Plan:
    """Plan the remaining time [s] from the current (size, size) information.

    Stance motions come first: they need replanted feet, as after the search, and every lift would require that again.
    """
    of_com = replace(goals, mass=math.inf, inertia=math.inf, products=math.inf)
    plan = make_plan(candidates, left, of_com, information)
    return replace(plan, visits=tuple(sorted(plan.visits, key=lambda visit: len(visit.lifts) > 0)))


def forecast_after(robot: RobotModel, stance: Stance, settings: BayesianSettings, prior_run: PriorRun) -> Plan:
    """Return the plan with the accuracy of the same duration without the prior run; raises as `short_plan`."""
    plan = short_plan(robot, stance, settings, prior_run)
    alone = replace(
        settings,
        prior_run=None,
        leg_prior=prior_run.leg_prior,
        excitation=False,
        duration=settings.duration_for(stance),
    )  # type: ignore[arg-type]
    try:
        without = plan_ahead(robot, stance, alone)
    except SettingsError:  # too short for a run without a prior run
        return plan
    return replace(plan, std_without_prior_run=without.std)


def opening_moves(candidates: Candidates, prior_run: PriorRun) -> tuple[BodyPosture, ...]:
    """Return the postures, in order, whose stance motions best determine changes of the joint offsets.

    Changes of prior variance q have the posterior variance q - q^2 (W - W C W), with W and C as in changes.py.
    """
    unknowns, count = candidates.unknowns, len(candidates.lifts)
    zeros = unknowns.columns("joint_offset")
    information = information_before(candidates, prior_run, {int(place): FREE for place in zeros}, None)
    left = {count + index: 1.0 for index in range(1, len(candidates.postures))}
    covariance = np.asarray(np.linalg.inv(information), dtype=float)
    steps = Steps(candidates, covariance, information[zeros])
    chosen: list[BodyPosture] = []
    for _ in range(_OPENING):
        best = steps.best(left, ())
        if best is None:
            break
        del left[best[1]]
        chosen.append(candidates.postures[best[1] - count])
        steps.update(steps.rows((best[1],)), covariance)
        information = information + candidates.information(best[1])
        covariance = np.asarray(np.linalg.inv(information), dtype=float)
    return min(itertools.permutations(chosen), key=_longest_step)


def _longest_step(postures: tuple[BodyPosture, ...]) -> float:
    """Return the largest rotation between consecutive postures [rad]: feet roll and gyroscopes drift over large ones."""
    turns = [np.array([posture.roll, posture.pitch, posture.yaw]) for posture in (BodyPosture(), *postures)]
    return max((float(np.linalg.norm(b - a)) for a, b in itertools.pairwise(turns)), default=0.0)


def information_before(
    candidates: Candidates, prior_run: PriorRun, variances: dict[int, float], mass: tuple[float, float] | None
) -> FloatArray:
    """Return the (size, size) information before a run."""
    unknowns = candidates.unknowns
    weighed = None if mass is None else (candidates.predictor.robot.mass, mass[1])
    _, rows = prior_rows(unknowns.with_prior(prior_run.distribution(unknowns, variances)), unknowns.start(), weighed)
    return rows.T @ rows
