"""Which trials the precise method does, and why these: those that teach most about what is reported, per second.

Candidates are postures over height, roll, pitch and yaw, and in each posture lifts on both diagonals, passive and with the
body turning. Each is predicted (predict.py) and adds its Fisher information to what the priors, the search and earlier
motions give. Greedily the one is taken that lowers most, per second of robot time, the sum over reported quantities of
posterior variance over the square of its goal (A-optimal design).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from equipoise.alive import alive
from equipoise.conventions import FloatArray
from equipoise.errors import ReachError, SettingsError
from equipoise.experiments.posture import check_posture, feet_in_posture
from equipoise.precise.lift_design import AMPLITUDES, LiftDesign, check_lift
from equipoise.precise.measurements.leg_motion import LegChains
from equipoise.precise.parameters import Unknowns
from equipoise.precise.posterior import body_jacobian, prior_rows
from equipoise.precise.predict import Predictor
from equipoise.precise.residual_blocks import PlantedBlock, TiltBlock
from equipoise.precise.unknowns import Priors
from equipoise.robot.inertial import COMPONENTS, components
from equipoise.robot.model import DIAGONALS, RobotModel
from equipoise.robot.posture import BodyPosture
from equipoise.robot.stance import Stance

# Asked for at full size first, then smaller, until the legs reach them.
_SIZES = (1.0, 0.75, 0.5, 0.3)
_LIFT_POSTURES = (
    BodyPosture(),
    BodyPosture(crouch=0.2),
    BodyPosture(roll=0.22, crouch=0.06),
    BodyPosture(roll=-0.22, crouch=0.06),
    BodyPosture(pitch=0.27, crouch=0.08),
    BodyPosture(pitch=-0.27, crouch=0.08),
    BodyPosture(yaw=0.3, crouch=0.05),
    BodyPosture(yaw=-0.3, crouch=0.05),
    BodyPosture(roll=0.22, pitch=0.22, crouch=0.12),
    BodyPosture(roll=-0.22, pitch=0.22, crouch=0.12),
    BodyPosture(roll=0.22, pitch=-0.22, crouch=0.12),
    BodyPosture(roll=-0.22, pitch=-0.22, crouch=0.12),
)
_PLANTED_POSTURES = (
    BodyPosture(crouch=0.15, yaw=0.3, ahead=0.15, aside=0.1),
    BodyPosture(crouch=0.15, yaw=-0.3, ahead=0.15, aside=-0.1),
    BodyPosture(crouch=0.25, roll=0.25, ahead=-0.15),
    BodyPosture(crouch=0.25, roll=-0.25, ahead=-0.15),
    BodyPosture(crouch=0.1, yaw=0.3, aside=-0.15),
    BodyPosture(crouch=0.1, yaw=-0.3, aside=0.15),
    BodyPosture(crouch=0.25, pitch=0.25, yaw=0.2, aside=0.1),
    BodyPosture(crouch=0.25, pitch=0.25, yaw=-0.2, aside=-0.1),
    BodyPosture(crouch=0.3, roll=0.25, yaw=0.3),
    BodyPosture(crouch=0.3, roll=-0.25, yaw=-0.3),
    BodyPosture(crouch=0.05, pitch=-0.25, ahead=0.15),
    BodyPosture(crouch=0.35),
)
_SCALE_OF_MASS = 0.005  # as a fraction: the plan takes the mass to be known, from a scale or about so from torques
# Robot time on an A1, as measured, settling included [s]; others' is longer with the square root of their height.
_LIFT_TIME, _POSTURE_TIME, _REPLANT_TIME = 2.6, 2.1, 1.5
FEW_LIFTS = 10
"""Fewer different lifts are done more than once: motors too weak for most, or too little known of the robot."""
_END_TIME = 2.0  # [s] for the way back, on an A1


@dataclass(frozen=True)
class Goals:
    """Posterior standard deviations at which a calibration is good enough, for an A1; lengths scale with the leg.

    Attributes:
        com_planar, com_height: [m].
        mass: as a fraction.
        inertia: moments, each as a fraction of itself.
        products: as a fraction of Ixx.
    """

    com_planar: float = 0.25e-3
    com_height: float = 0.5e-3
    mass: float = 0.012
    inertia: float = 0.01
    products: float = 0.01

    def vector(self, body: FloatArray, stance: Stance) -> FloatArray:
        """(10,) in the order of COMPONENTS, for a body with those parameters."""
        lengths = stance.scale.length * np.array([self.com_planar, self.com_planar, self.com_height])
        return np.concatenate(
            [[self.mass * body[0]], lengths, self.inertia * body[4:7], np.full(3, self.products * body[4])]
        )


@dataclass(frozen=True)
class Visit:
    """A posture, and the lifts that are done in it."""

    posture: BodyPosture
    lifts: tuple[LiftDesign, ...] = ()

    def turns(self, diagonal: str) -> str:
        """The lifts on a diagonal, in words."""
        return ", ".join(lift.turn or "passive" for lift in self.lifts if lift.diagonal == diagonal)


@dataclass(frozen=True, eq=False)
class Plan:
    """What will be done.

    Attributes:
        visits: postures with their lifts, in order.
        robot_time: expected time on the robot, search and way back included [s].
        deviation: (10,) predicted posterior standard deviations of the whole robot, in the order of COMPONENTS.
        prior_deviation: (10,) standard deviations of these before any motion.
        body: (10,) parameters of the whole robot as it was thought to be, in the order of COMPONENTS.
        left_out: postures and lifts that the robot cannot do, and why.
    """

    visits: tuple[Visit, ...]
    robot_time: float
    deviation: FloatArray
    prior_deviation: FloatArray
    body: FloatArray
    left_out: tuple[str, ...] = ()

    @property
    def lifts(self) -> int:
        """Number of lifts, those of the search not counted."""
        return sum(len(visit.lifts) for visit in self.visits)

    def trials(self) -> list[tuple[str, dict[str, str]]]:
        """Postures in order, and the lifts in each by diagonal, in words."""
        return [
            ("search, nominal", dict.fromkeys(DIAGONALS, "passive x 2")),
            *((describe(visit.posture), {name: visit.turns(name) for name in DIAGONALS}) for visit in self.visits),
        ]

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        return {
            "robot_time": self.robot_time,
            "lifts": self.lifts,
            "visits": [
                {
                    "posture": dataclasses.asdict(visit.posture),
                    "lifts": [
                        {"diagonal": lift.diagonal, "side": lift.side, "turn": lift.turn} for lift in visit.lifts
                    ],
                }
                for visit in self.visits
            ],
            "predicted_deviation": name_components(self.deviation),
            "left_out": list(self.left_out),
        }


@dataclass(frozen=True)
class Durations:
    """Robot time of the parts of a calibration [s]; `replant` comes on top of a posture that follows lifts."""

    posture: float
    replant: float
    lift: float
    search: float
    end: float

    @classmethod
    def of(cls, stance: Stance) -> Durations:
        """For a robot of a stance's size."""
        clock = stance.scale.time
        return cls(
            clock * _POSTURE_TIME, clock * _REPLANT_TIME, clock * _LIFT_TIME, clock * 4 * _LIFT_TIME, clock * _END_TIME
        )


@dataclass(eq=False)
class Candidates:
    """Everything that may be done, and what each would teach.

    Attributes:
        doubt: (3, 3) covariance of the CoM in the base frame, as `check_lift` takes it [m2].
        lifts: possible lifts.
        postures: postures of planted moves, from the first posture.
        information: (size, size) information of each lift, then of each posture's move.
        left_out: reasons why others are not possible.
    """

    predictor: Predictor
    unknowns: Unknowns
    doubt: FloatArray | None = None
    lifts: list[LiftDesign] = field(default_factory=list[LiftDesign])
    postures: list[BodyPosture] = field(default_factory=list[BodyPosture])
    information: list[FloatArray] = field(default_factory=list[FloatArray])
    left_out: list[str] = field(default_factory=list[str])

    @classmethod
    def of(
        cls, robot: RobotModel, stance: Stance, com: FloatArray, priors: Priors, doubt: FloatArray | None = None
    ) -> Candidates:
        """Of a robot as it is thought to be."""
        found = cls(Predictor(robot, stance, com), Unknowns(robot, stance, priors), doubt)
        for wanted in _LIFT_POSTURES:
            posture = found._largest(wanted, found._check_lifts)
            if posture is not None:
                found._add_lifts(posture)
        for wanted in _PLANTED_POSTURES:
            posture = found._largest(wanted, found._check_planted)
            if posture is not None:
                found.postures.append(posture)
        if not found.lifts:
            raise ReachError(f"no lift of the precise method is within reach: {found.left_out[0]}")
        found.postures = list(dict.fromkeys([*(lift.posture for lift in found.lifts), *found.postures]))
        found._inform()
        return found

    def _check_planted(self, posture: BodyPosture) -> None:
        predictor = self.predictor
        check_posture(predictor.robot, predictor.stance, feet_in_posture(predictor.stance, predictor.com, posture))

    def _check_lifts(self, posture: BodyPosture) -> None:
        self._check_planted(posture)
        for diagonal in DIAGONALS:
            self._check(LiftDesign(posture, diagonal, 1))

    def _check(self, design: LiftDesign) -> None:
        check_lift(self.predictor.robot, self.predictor.stance, self.predictor.com, design, self.doubt)

    def _largest(self, wanted: BodyPosture, check: Callable[[BodyPosture], None]) -> BodyPosture | None:
        """The posture, or a smaller one in its direction, that passes a check."""
        reason = ""
        for size in _SIZES:
            posture = BodyPosture(*(size * value for value in vars(wanted).values()))
            try:
                check(posture)
            except ReachError as error:
                reason = reason or str(error)
                continue
            return posture
        self.left_out.append(f"{describe(wanted)}: {reason}")
        return None

    def _add_lifts(self, posture: BodyPosture) -> None:
        side = 1
        for turn in (None, *AMPLITUDES):
            for diagonal in DIAGONALS:
                side = -side
                design = LiftDesign(posture, diagonal, side, turn)
                try:
                    self._check(design)
                except ReachError as error:
                    self.left_out.append(f"{describe(posture)}, {turn} on {diagonal}: {error}")
                    continue
                self.lifts.append(design)

    def _inform(self) -> None:
        unknowns, predictor = self.unknowns, self.predictor
        x, legs = unknowns.start(), LegChains(predictor.robot)
        rotation = np.array(predictor.robot.imu_in_base.rotation)
        lifts = TiltBlock(unknowns, legs, rotation, [(k, predictor.lift(d)) for k, d in enumerate(self.lifts)])
        home = self.lifts[0].posture
        moves = [(k, predictor.move(home, posture)) for k, posture in enumerate(self.postures)]
        planted = PlantedBlock(unknowns, legs, rotation, moves)
        for block in (lifts, planted):
            block.prepare(x)
            self.information += [information for _, information, _ in block.by_motion(x)]


def make_plan(
    candidates: Candidates,
    budget: float,
    goals: Goals | None = None,
    known: FloatArray | None = None,
    used: Sequence[LiftDesign] = (),
    searched: bool = False,
) -> Plan:
    """The best set of trials within a budget of robot time.

    Args:
        budget: time on the robot that is left [s].
        goals: standard deviations that accuracy is measured by.
        known: (size, size) information that there is already; default: the priors, a mass, and a search to come.
        used: lifts that were done already; they are done again only if there are few.
        searched: whether the search was done (and is part of `known`).

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
    left = budget - durations.end
    if not searched:
        left -= durations.search
        for index, lift in enumerate(candidates.lifts):
            if lift.posture == candidates.lifts[0].posture and lift.turn is None:
                information += 2 * candidates.information[index]
    visited: dict[BodyPosture, list[LiftDesign]] = {}
    count = len(candidates.lifts)
    often = math.ceil(FEW_LIFTS / count)
    remaining = {index: often - used.count(lift) for index, lift in enumerate(candidates.lifts)}
    total = budget - left
    while True:
        alive()
        best, gain, cost_of_best, added_by_best = None, 0.0, 0.0, prior
        covariance = np.linalg.inv(information)
        weighted = weights @ covariance
        possible = [index for index, times in remaining.items() if times > 0]
        for index in [*possible, *range(count, count + len(candidates.postures))]:
            added, cost = _step(candidates, index, visited, durations)
            if added is None or cost > left:
                continue
            # Of the sum of weighted variances: exact for an addition A: W (C^-1 + A)^-1 W^T.
            lowered = float(
                np.sum(weighted @ np.linalg.solve(np.eye(len(added)) + added @ covariance, added) * weighted)
            )
            if lowered / cost > gain:
                best, gain, cost_of_best, added_by_best = index, lowered / cost, cost, added
        if best is None:
            break
        information = information + added_by_best
        left -= cost_of_best
        total += cost_of_best
        if best < count:
            visited.setdefault(candidates.lifts[best].posture, []).append(candidates.lifts[best])
            remaining[best] -= 1
        else:
            visited.setdefault(candidates.postures[best - count], [])
    if not any(visited.values()) and not searched:
        least = durations.search + durations.posture + durations.replant + durations.lift + durations.end
        raise SettingsError(
            f"{budget:.0f} s (the sway not counted) allow no lift after the search; it takes {least:.0f} s at least"
        )
    covariance = to_body @ np.linalg.inv(information) @ to_body.T
    before = to_body @ np.linalg.inv(prior) @ to_body.T
    return Plan(
        _in_order(visited), total, np.sqrt(np.diag(covariance)), np.sqrt(np.diag(before)), body,
        tuple(candidates.left_out),
    )  # fmt: skip


def _step(
    candidates: Candidates, index: int, visited: dict[BodyPosture, list[LiftDesign]], durations: Durations
) -> tuple[FloatArray | None, float]:
    """Information and robot time of a candidate, the way to its posture included; None if it is done already."""
    count = len(candidates.lifts)
    if index >= count:
        posture = candidates.postures[index - count]
        return (None, 0.0) if posture in visited else (candidates.information[index], durations.posture)
    posture = candidates.lifts[index].posture
    if visited.get(posture):
        return candidates.information[index], durations.lift
    if posture in visited:  # so far without lifts
        return candidates.information[index], durations.lift + durations.replant
    move = candidates.information[count + candidates.postures.index(posture)]
    return candidates.information[index] + move, durations.lift + durations.posture + durations.replant


def _in_order(visited: dict[BodyPosture, list[LiftDesign]]) -> tuple[Visit, ...]:
    """Postures with lifts first, the most telling first, so that a run cut short has done the best part of it."""
    order = sorted(visited.items(), key=lambda item: len(item[1]) == 0)
    return tuple(Visit(posture, tuple(lifts)) for posture, lifts in order)


def describe(posture: BodyPosture) -> str:
    """In words, short."""
    parts = [
        f"{name} {math.degrees(value):+.0f} deg" if name in AMPLITUDES else f"{name} {value:+.2f}"
        for name, value in vars(posture).items()
        if value
    ]
    return ", ".join(parts) or "nominal"


def name_components(values: FloatArray) -> dict[str, float]:
    """By name, in the order of COMPONENTS."""
    return {name: float(value) for name, value in zip(COMPONENTS, values, strict=True)}
