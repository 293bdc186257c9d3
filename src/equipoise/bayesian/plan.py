"""Greedy A-optimal selection of trials: the largest reduction of the reported variances per second of robot time.

Candidates (planning/candidates.py) are postures over height, roll, pitch and yaw, and in each posture lifts on both
diagonals, passive and with a body rotation. Each is predicted (predict.py). Its Fisher information is added to that of
the priors, the search and earlier motions. Each step takes the candidate that lowers, per second, the sum of the posterior
variances of the reported quantities most, each divided by its squared goal (planning/gains.py).
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

_MASS_STD = 0.005  # std as a fraction: the plan assumes a mass from a scale, or one as accurate from torques
FEW_LIFTS = 10
"""Number of possible lifts below which each is repeated: motors too weak for most, or a robot too uncertain."""
SEARCH = "search, nominal"
"""Name of the search in plans and dry runs."""


@dataclass(frozen=True)
class Visit:
    """Posture and the lifts in it."""

    posture: BodyPosture
    lifts: tuple[LiftDesign, ...] = ()

    def lifts_on(self, diagonal: str) -> str:
        """Return a description of the lifts on a diagonal."""
        return ", ".join(lift.meanwhile for lift in self.lifts if lift.diagonal == diagonal)


@dataclass(frozen=True, eq=False)
class Plan:
    """Planned trials and their predicted accuracy.

    Attributes:
        visits: postures with their lifts, in order.
        robot_time: expected robot time of search, if it is still to come, visits, return to the stance and excitation [s].
        std: (10,) predicted posterior standard deviations of the whole robot, in the order of COMPONENTS.
        body: (10,) assumed parameters of the whole robot, in the order of COMPONENTS.
        left_out: postures and lifts that the robot cannot do, with reasons.
        rotate_after: number of visits after which the robot is turned to face the other way; None: not turned.
        before_search: number of visits before the search.
        search: number of the search's lifts on each diagonal.
        excitation: True if an excitation about all axes follows the lifts.
        std_without_prior_run: (10,) `std` without the prior run, in the same duration; None: no prior run.
        links: leg links by name, with predicted standard deviations; empty unless lifted feet may swing.
    """

    visits: tuple[Visit, ...]
    robot_time: float
    std: FloatArray
    body: FloatArray
    left_out: tuple[str, ...] = ()
    rotate_after: int | None = None
    before_search: int = 0
    search: int = 2
    excitation: bool = False
    std_without_prior_run: FloatArray | None = None
    links: Mapping[str, Link] = field(default_factory=dict[str, Link])

    @property
    def lifts(self) -> int:
        """Number of lifts, without those of the search."""
        return sum(len(visit.lifts) for visit in self.visits)

    def trials(self) -> list[tuple[str, dict[str, str]]]:
        """Return the postures in order, each with descriptions of its lifts by diagonal."""
        rows = [(describe(visit.posture), {name: visit.lifts_on(name) for name in DIAGONALS}) for visit in self.visits]
        rows.insert(self.before_search, (SEARCH, dict.fromkeys(DIAGONALS, f"passive x {self.search}")))
        if self.rotate_after is not None:
            rows.insert(1 + self.rotate_after, ("turned by 180 deg", dict.fromkeys(DIAGONALS, "")))
        if self.excitation:
            rows.append(("excitation about all axes", dict.fromkeys(DIAGONALS, "")))
        return rows

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        without = self.std_without_prior_run
        return {
            "robot_time": self.robot_time,
            "lifts": self.lifts,
            "search_lifts": self.search * len(DIAGONALS),
            "before_search": self.before_search,
            "excitation": self.excitation,
            "rotate_after": self.rotate_after,
            "visits": [
                {
                    "posture": to_json(visit.posture),
                    "lifts": [{name: getattr(lift, name) for name in _IN_JSON} for lift in visit.lifts],
                }
                for visit in self.visits
            ],
            "predicted_std": name_components(self.std),
            "left_out": list(self.left_out),
            **({"links": to_json(self.links)} if self.links else {}),
            **({} if without is None else {"predicted_std_without_prior_run": name_components(without)}),
        }


_IN_JSON = ("diagonal", "side", "turn", "swing")
"""Attributes of a lift in the JSON form of a plan."""


@dataclass(frozen=True)
class Durations:
    """Robot time of the parts of a calibration, as measured on an A1, settling included [s].

    It scales with the square root of the robot's height. `replant` is added to the first posture after lifts, `end` is the
    return to the stance. `turn` is to lie down, stand up and rest, without the operator's time to turn the robot.
    """

    posture: float = 2.1
    replant: float = 1.5
    lift: float = 2.6
    search: float = 4 * 2.6  # lifts
    end: float = 2.0
    turn: float = 11.0

    @classmethod
    def of(cls, stance: Stance) -> Durations:
        """Return the durations for a robot of the stance's size."""
        return cls(**{name: stance.scale.time * on_a1 for name, on_a1 in vars(cls()).items()})


def make_plan(
    candidates: Candidates,
    budget: float,
    goals: Goals | None = None,
    known: FloatArray | None = None,
    used: Sequence[LiftDesign] = (),
    turn: bool = False,
    reserved: float = 0.0,
    after: FloatArray | None = None,
) -> Plan:
    """Plan trials within a budget of robot time.

    Args:
        budget: remaining robot time [s].
        goals: standard deviations by which variances are weighted.
        known: (size, size) information after the search; default: that of the priors, a mass, and a search still to come.
        used: completed lifts; they are repeated only if few lifts are possible.
        turn: True if the robot is turned half-way; trials before it may be repeated after it.
        reserved: part of the budget for the excitation that follows, if any [s].
        after: (size, size) information from later motions, which does not affect the selection; default none.

    Raises:
        SettingsError: the budget allows no lift.
    """
    unknowns, goals = candidates.unknowns, goals or Goals()
    x = unknowns.start()
    durations = Durations.of(candidates.predictor.stance)
    mass = candidates.predictor.robot.mass
    _, rows = prior_rows(unknowns, x, (mass, _MASS_STD * mass))
    to_body = body_jacobian(unknowns, x, unknowns.robot_body)
    body = components(unknowns.robot_body(x))
    weights = to_body / goals.vector(body, candidates.predictor.stance)[:, None]
    information = rows.T @ rows if known is None else known.copy()
    left = budget - reserved - durations.end - turn * durations.turn
    if known is None:
        left -= durations.search
        for index in candidates.search:
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
            each.steps.update(taken, covariance)
        covariance = np.asarray(np.linalg.inv(information), dtype=float)
        total += cost
    visits = [part.visits for part in parts]
    planned = sum(visits, ())
    if known is None and not any(visit.lifts for visit in planned):
        least = durations.search + durations.posture + durations.replant + durations.lift + durations.end
        least += turn * (least - durations.search - durations.end + durations.turn)
        raise SettingsError(
            f"a duration of {budget:.0f} s allows no lift after the search; give {math.ceil(least + reserved)} s "
            "or more, or a duration in minutes, such as 2min"
        )
    everything = np.asarray(np.linalg.inv(information if after is None else information + after), dtype=float)
    covariance = to_body @ everything @ to_body.T
    return Plan(
        planned, total, np.sqrt(np.diag(covariance)), body,
        tuple(candidates.left_out), len(visits[0]) if turn else None,
        links=link_findings(unknowns, x, everything) if candidates.swings else {}, excitation=reserved > 0,
    )  # fmt: skip


class _Part:
    """Part of a plan in which the robot faces one way.

    Args:
        steps: information gains of the candidates.
        left: robot time of this part [s].
        used: completed lifts.
    """

    def __init__(self, candidates: Candidates, steps: Steps, left: float, used: Sequence[LiftDesign]) -> None:
        self._candidates, self._left, self.steps = candidates, left, steps
        self._durations = Durations.of(candidates.predictor.stance)
        self._visited: dict[BodyPosture, list[LiftDesign]] = {}
        often = math.ceil(FEW_LIFTS / len(candidates.lifts))
        self._remaining = {index: often - used.count(lift) for index, lift in enumerate(candidates.lifts)}

    @property
    def visits(self) -> tuple[Visit, ...]:
        """Visits by information gain, those with lifts first, so that an interrupted run has the best of them."""
        order = sorted(self._visited.items(), key=lambda item: len(item[1]) == 0)
        return tuple(Visit(posture, tuple(lifts)) for posture, lifts in order)

    def best(self) -> tuple[float, int | None]:
        """Return `Steps.best` of the candidates that fit the remaining time; zero and None if there are none."""
        count = len(self._candidates.lifts)
        possible = [index for index, times in self._remaining.items() if times > 0]
        costs = {
            index: cost
            for index in [*possible, *range(count, count + len(self._candidates.postures))]
            if (cost := self._cost(index)) is not None and cost <= self._left
        }
        return self.steps.best(costs, self._visited) or (0.0, None)

    def take(self, index: int) -> tuple[float, FloatArray]:
        """Add a candidate, and return its robot time with the move to its posture [s] and its (m, size) information rows."""
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
        """Return the robot time of a candidate with the move to its posture [s]; None if it is planned already."""
        durations, count = self._durations, len(self._candidates.lifts)
        if index >= count:
            return None if self._candidates.postures[index - count] in self._visited else durations.posture
        posture = self._candidates.lifts[index].posture
        if self._visited.get(posture):
            return durations.lift
        way = durations.replant if posture in self._visited else durations.posture + durations.replant
        return durations.lift + way


def name_components(values: FloatArray) -> dict[str, float]:
    """Return (10,) values by the names of COMPONENTS."""
    return {name: float(value) for name, value in zip(COMPONENTS, values, strict=True)}
