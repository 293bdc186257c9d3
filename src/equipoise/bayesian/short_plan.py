"""The plan of a run of which an earlier one is known: whether a zero moved first, then few lifts, for the CoM.

Moves over planted feet tell whether the robot is as it was; with sensors that are known one lift a diagonal is search enough,
and the time that is left goes into the lifts that tell most of the centre of mass.
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

_OPENING = 3  # moves
_FEWEST_LIFTS = 2


def com_goals(goals: Goals) -> Goals:
    """Those of the CoM alone."""
    return replace(goals, mass=math.inf, inertia=math.inf, products=math.inf)


def short_plan(robot: RobotModel, stance: Stance, settings: BayesianSettings, known: PriorRun) -> Plan:
    """The plan for a robot that carries nothing else than its model says.

    Raises:
        SettingsError: the earlier run is of another robot; the budget allows too few lifts.
        ReachError: the robot can do no lift.
    """
    known.check(robot)
    candidates, durations = nominal_candidates(robot, settings.combined_priors), Durations.of(stance)
    opening = opening_moves(candidates, known)
    # The mass is taken to be known, from a scale or about so from torques, as in other plans.
    information = information_before(candidates, known, {}, settings.scale or (robot.mass, SCALE_GAIN * robot.mass))
    for index in (*_moves(candidates, opening), *_search(candidates)):
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
    return replace(
        plan, visits=visits, robot_time=plan.robot_time + spent, before_search=len(opening), search="passive"
    )


def plan_after_search(candidates: Candidates, left: float, goals: Goals, information: FloatArray) -> Plan:
    """The best use of the time that is left [s], given (size, size) information that there is.

    Moves come before lifts: feet that were lifted are put back before a move, which the search before them asks for anyway.
    """
    plan = make_plan(candidates, left, com_goals(goals), information, searched=True)
    return replace(plan, visits=tuple(sorted(plan.visits, key=lambda visit: len(visit.lifts) > 0)))


def forecast_after(robot: RobotModel, stance: Stance, settings: BayesianSettings, known: PriorRun) -> Plan:
    """The plan, and what the same time would give without the earlier run; raises as `short_plan`."""
    plan = short_plan(robot, stance, settings, known)
    alone = replace(
        settings, prior_run=None, leg_prior=known.leg_prior, excitation=False, duration=settings.duration_for(stance)
    )  # type: ignore[arg-type]
    try:
        without = plan_ahead(robot, stance, alone)
    except SettingsError:  # too little time for a run that knows nothing
        return plan
    return replace(plan, without=without.std)


def opening_moves(candidates: Candidates, known: PriorRun) -> tuple[BodyPosture, ...]:
    """Postures whose moves tell most of how far joint offsets may have moved, in order.

    Of changes d of variance q the posterior has q - q^2 (W - W C W), with W and C as in changes.py.
    """
    unknowns, count = candidates.unknowns, len(candidates.lifts)
    zeros = unknowns.columns("joint_offset")
    information = information_before(candidates, known, {int(place): FREE for place in zeros}, None)
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
        steps.learn(steps.rows((best[1],)), covariance)
        information = information + candidates.information(best[1])
        covariance = np.asarray(np.linalg.inv(information), dtype=float)
    return min(itertools.permutations(chosen), key=_longest_step)


def _longest_step(postures: tuple[BodyPosture, ...]) -> float:
    """The largest turn between postures in order [rad]: feet roll and gyroscopes err over a large one."""
    turns = [np.array([posture.roll, posture.pitch, posture.yaw]) for posture in (BodyPosture(), *postures)]
    return max((float(np.linalg.norm(b - a)) for a, b in itertools.pairwise(turns)), default=0.0)


def information_before(
    candidates: Candidates, known: PriorRun, anew: dict[int, float], mass: tuple[float, float] | None
) -> FloatArray:
    """(size, size) information that there is before a run."""
    unknowns = candidates.unknowns
    weighed = None if mass is None else (candidates.predictor.robot.mass, mass[1])
    _, rows = prior_rows(unknowns.with_prior(known.distribution(unknowns, anew)), unknowns.start(), weighed)
    return rows.T @ rows


def _moves(candidates: Candidates, postures: tuple[BodyPosture, ...]) -> list[int]:
    return [len(candidates.lifts) + candidates.postures.index(posture) for posture in postures]


def _search(candidates: Candidates) -> list[int]:
    home = candidates.lifts[0].posture
    return [k for k, lift in enumerate(candidates.lifts) if lift.posture == home and lift.passive]
