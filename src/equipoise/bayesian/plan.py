"""Which trials the Bayesian method does, and why these: those that teach most about what is reported, per second.

Candidates (planning/candidates.py) are postures over height, roll, pitch and yaw, and in each posture lifts on both
diagonals, passive and with the body turning. Each is predicted (predict.py) and adds its Fisher information to what the
priors, the search and earlier motions give. Greedily the one is taken that lowers most, per second of robot time, the sum
over reported quantities of posterior variance over the square of its goal (A-optimal design; planning/gains.py).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from equipoise.bayesian.goals import Goals
from equipoise.bayesian.lift_design import LiftDesign
from equipoise.bayesian.planning.candidates import Candidates, describe
from equipoise.bayesian.planning.gains import Steps
from equipoise.conventions import FloatArray
from equipoise.errors import SettingsError
from equipoise.estimator.diagnostics.link_findings import link_findings
from equipoise.estimator.problem import body_jacobian, prior_rows
from equipoise.json_form import to_json
from equipoise.result.findings import Link
from equipoise.robot.inertial import COMPONENTS, components
from equipoise.robot.model import DIAGONALS
from equipoise.robot.posture import BodyPosture
from equipoise.robot.stance import Stance

_SCALE_OF_MASS = 0.005  # as a fraction: the plan takes the mass to be known, from a scale or about so from torques
# Robot time on an A1, as measured, settling included [s]; others' is longer with the square root of their height.
_LIFT_TIME, _POSTURE_TIME, _REPLANT_TIME = 2.6, 2.1, 1.5
FEW_LIFTS = 10
"""Fewer different lifts are done more than once: motors too weak for most, or too little known of the robot."""
_END_TIME = 2.0  # [s] for the way back, on an A1
_TURN_TIME = (
    11.0  # [s] to lie down, to stand up and to rest, on an A1: how long somebody takes to turn it does not count
)


@dataclass(frozen=True)
class Visit:
    """A posture, and the lifts that are done in it."""

    posture: BodyPosture
    lifts: tuple[LiftDesign, ...] = ()

    def turns(self, diagonal: str) -> str:
        """The lifts on a diagonal, in words."""
        return ", ".join(lift.meanwhile for lift in self.lifts if lift.diagonal == diagonal)


@dataclass(frozen=True, eq=False)
class Plan:
    """What will be done.

    Attributes:
        visits: postures with their lifts, in order.
        robot_time: expected time on the robot, search and way back included [s].
        std: (10,) predicted posterior standard deviations of the whole robot, in the order of COMPONENTS.
        prior_std: (10,) standard deviations of these before any motion.
        body: (10,) parameters of the whole robot as it was thought to be, in the order of COMPONENTS.
        left_out: postures and lifts that the robot cannot do, and why.
        turn_after: number of visits after which the robot is turned to face the other way; None: it is not.
        before_search: number of visits before the search.
        search: lifts of the search on each diagonal, in words.
        without: (10,) standard deviations that the same time would give if no earlier run were known; None: none is.
        links: leg links by name, with predicted standard deviations; none unless feet may swing.
    """

    visits: tuple[Visit, ...]
    robot_time: float
    std: FloatArray
    prior_std: FloatArray
    body: FloatArray
    left_out: tuple[str, ...] = ()
    turn_after: int | None = None
    before_search: int = 0
    search: str = "passive x 2"
    without: FloatArray | None = None
    links: Mapping[str, Link] = field(default_factory=dict[str, Link])

    @property
    def lifts(self) -> int:
        """Number of lifts, those of the search not counted."""
        return sum(len(visit.lifts) for visit in self.visits)

    def trials(self) -> list[tuple[str, dict[str, str]]]:
        """Postures in order, and the lifts in each by diagonal, in words."""
        rows = [(describe(visit.posture), {name: visit.turns(name) for name in DIAGONALS}) for visit in self.visits]
        rows.insert(self.before_search, ("search, nominal", dict.fromkeys(DIAGONALS, self.search)))
        if self.turn_after is not None:
            rows.insert(1 + self.turn_after, ("turned by 180 deg", dict.fromkeys(DIAGONALS, "")))
        return rows

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        return {
            "robot_time": self.robot_time,
            "lifts": self.lifts,
            "turn_after": self.turn_after,
            "visits": [
                {
                    "posture": to_json(visit.posture),
                    "lifts": [{name: getattr(lift, name) for name in _IN_JSON} for lift in visit.lifts],
                }
                for visit in self.visits
            ],
            "predicted_deviation": name_components(self.std),
            "left_out": list(self.left_out),
            **({"links": to_json(self.links)} if self.links else {}),
            **({} if self.without is None else {"predicted_deviation_without_known": name_components(self.without)}),
        }


_IN_JSON = ("diagonal", "side", "turn", "swing")
"""Attributes of a lift in the JSON form of a plan."""


@dataclass(frozen=True)
class Durations:
    """Robot time of the parts of a calibration [s]; `replant` comes on top of a posture that follows lifts.

    How long somebody takes to turn the robot is not part of `turn`.
    """

    posture: float
    replant: float
    lift: float
    search: float
    end: float
    turn: float

    @classmethod
    def of(cls, stance: Stance) -> Durations:
        """For a robot of a stance's size."""
        clock = stance.scale.time
        return cls(
            clock * _POSTURE_TIME, clock * _REPLANT_TIME, clock * _LIFT_TIME, clock * 4 * _LIFT_TIME, clock * _END_TIME,
            clock * _TURN_TIME,
        )  # fmt: skip


def make_plan(
    candidates: Candidates,
    budget: float,
    goals: Goals | None = None,
    known: FloatArray | None = None,
    used: Sequence[LiftDesign] = (),
    searched: bool = False,
    turn: bool = False,
    aside: float = 0.0,
    after: FloatArray | None = None,
) -> Plan:
    """The best set of trials within a budget of robot time.

    Args:
        budget: time on the robot that is left [s].
        goals: standard deviations that accuracy is measured by.
        known: (size, size) information that there is already; default: the priors, a mass, and a search to come.
        used: lifts that were done already; they are done again only if there are few.
        searched: whether the search was done (and is part of `known`).
        turn: whether the robot is turned half-way; what is done before that may be done again after it.
        aside: part of the budget that is for what is not planned here [s].
        after: (size, size) information that comes when all is done, which no choice looks at; none by default.

    Raises:
        SettingsError: the budget allows no lift.
    """
    unknowns, goals = candidates.unknowns, goals or Goals()
    x = unknowns.start()
    durations = Durations.of(candidates.predictor.stance)
    mass = candidates.predictor.robot.mass
    _, rows = prior_rows(unknowns, x, (mass, _SCALE_OF_MASS * mass))
    prior = rows.T @ rows
    to_body = body_jacobian(unknowns, x, unknowns.robot_body)
    body = components(unknowns.robot_body(x))
    weights = to_body / goals.vector(body, candidates.predictor.stance)[:, None]
    information = prior.copy() if known is None else known.copy()
    budget = budget - aside
    left = budget - durations.end - turn * durations.turn
    if not searched:
        left -= durations.search
        for index, lift in enumerate(candidates.lifts):
            if lift.posture == candidates.lifts[0].posture and lift.passive:
                information += 2 * candidates.information(index)
    total = budget - left
    covariance = np.asarray(np.linalg.inv(information), dtype=float)
    parts = [_Part(candidates, Steps(candidates, covariance, weights), left / (1 + turn), used)]
    if turn:
        other = candidates.turned()
        parts.append(_Part(other, Steps(other, covariance, weights), left / 2, ()))
    while True:
        best, part = max(((part.best(), part) for part in parts), key=lambda choice: choice[0][0])
        if best[1] is None:
            break
        cost, taken = part.take(best[1])
        information = information + taken.T @ taken
        for each in parts:
            each.steps.learn(taken, covariance)
        covariance = np.asarray(np.linalg.inv(information), dtype=float)
        total += cost
    if not any(part.lifts for part in parts) and not searched:
        least = durations.search + durations.posture + durations.replant + durations.lift + durations.end
        least += turn * (least - durations.search - durations.end + durations.turn)
        raise SettingsError(
            f"a duration of {budget + aside:.0f} s allows no lift after the search; give {math.ceil(least + aside)} s "
            f"or more, "
            "or minutes as 2min"
        )
    everything = np.asarray(np.linalg.inv(information if after is None else information + after), dtype=float)
    covariance = to_body @ everything @ to_body.T
    before = to_body @ np.linalg.inv(prior) @ to_body.T
    visits = [part.visits for part in parts]
    return Plan(
        sum(visits, ()), total, np.sqrt(np.diag(covariance)), np.sqrt(np.diag(before)), body,
        tuple(candidates.left_out), len(visits[0]) if turn else None,
        links=link_findings(unknowns, x, everything) if candidates.swings else {},
    )  # fmt: skip


class _Part:
    """What is planned for a robot that faces one way.

    Args:
        steps: what each of the candidates would teach.
        left: robot time for it [s].
        used: lifts that were done already.
    """

    def __init__(self, candidates: Candidates, steps: Steps, left: float, used: Sequence[LiftDesign]) -> None:
        self._candidates, self._left, self.steps = candidates, left, steps
        self._durations = Durations.of(candidates.predictor.stance)
        self._visited: dict[BodyPosture, list[LiftDesign]] = {}
        often = math.ceil(FEW_LIFTS / len(candidates.lifts))
        self._remaining = {index: often - used.count(lift) for index, lift in enumerate(candidates.lifts)}

    @property
    def lifts(self) -> int:
        """Number of lifts that are planned."""
        return sum(map(len, self._visited.values()))

    @property
    def visits(self) -> tuple[Visit, ...]:
        """Postures with lifts first, the most telling first, so that a run cut short has done the best part of it."""
        order = sorted(self._visited.items(), key=lambda item: len(item[1]) == 0)
        return tuple(Visit(posture, tuple(lifts)) for posture, lifts in order)

    def best(self) -> tuple[float, int | None]:
        """As of `Steps.best`, of what there is time for; zero and None if there is nothing."""
        count = len(self._candidates.lifts)
        possible = [index for index, times in self._remaining.items() if times > 0]
        costs = {
            index: cost
            for index in [*possible, *range(count, count + len(self._candidates.postures))]
            if (cost := self._cost(index)) is not None and cost <= self._left
        }
        return self.steps.best(costs, self._visited) or (0.0, None)

    def take(self, index: int) -> tuple[float, FloatArray]:
        """Plan a candidate; its robot time, the way to its posture included [s], and (m, size) rows of what it tells."""
        candidates, cost = self._candidates, self._cost(index) or 0.0
        count = len(candidates.lifts)
        rows = self.steps.rows(self.steps.parts(index, self._visited))
        self._left -= cost
        if index < count:
            self._visited.setdefault(candidates.lifts[index].posture, []).append(candidates.lifts[index])
            self._remaining[index] -= 1
        else:
            self._visited.setdefault(candidates.postures[index - count], [])
        return cost, rows

    def _cost(self, index: int) -> float | None:
        """Robot time of a candidate, the way to its posture included [s]; None if it is done already."""
        durations, count = self._durations, len(self._candidates.lifts)
        if index >= count:
            return None if self._candidates.postures[index - count] in self._visited else durations.posture
        posture = self._candidates.lifts[index].posture
        if self._visited.get(posture):
            return durations.lift
        way = durations.replant if posture in self._visited else durations.posture + durations.replant
        return durations.lift + way


def name_components(values: FloatArray) -> dict[str, float]:
    """By name, in the order of COMPONENTS."""
    return {name: float(value) for name, value in zip(COMPONENTS, values, strict=True)}
