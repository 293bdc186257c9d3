"""Candidates of a plan: possible postures and lifts, with the information of each."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from equipoise.bayesian.lift_design import AMPLITUDES, LiftChecks, LiftDesign
from equipoise.bayesian.predict import Predictor
from equipoise.conventions import SWINGS, FloatArray
from equipoise.errors import ReachError
from equipoise.estimator.equations.stance_motion import StanceMotions
from equipoise.estimator.equations.tilt import TiltEquation
from equipoise.estimator.parameters import Unknowns
from equipoise.estimator.unknowns import Priors
from equipoise.robot.model import DIAGONALS, RobotModel
from equipoise.robot.posture import BodyPosture
from equipoise.robot.stance import Stance

# Scale factors of a posture, tried in order until the legs reach it.
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
_STANCE_POSTURES = (
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


@dataclass(eq=False)
class Candidates:
    """Possible lifts and stance motions, with the information of each.

    Attributes:
        com_covariance: (3, 3) covariance of the CoM in the base frame, as for `LiftChecks` [m2].
        swings: True if lifted feet may swing, which determines the leg masses.
        lifts: possible lifts.
        postures: postures of stance motions, from the first posture.
        rows: (m, size) rows of each lift, then of each posture's move; their information is rows^T rows.
        left_out: reasons why others are not possible.
    """

    predictor: Predictor
    unknowns: Unknowns
    com_covariance: FloatArray | None = None
    swings: bool = False
    lifts: list[LiftDesign] = field(default_factory=list[LiftDesign])
    postures: list[BodyPosture] = field(default_factory=list[BodyPosture])
    rows: list[FloatArray] = field(default_factory=list[FloatArray])
    left_out: list[str] = field(default_factory=list[str])

    @classmethod
    def of(
        cls, robot: RobotModel, stance: Stance, com: FloatArray, priors: Priors, com_covariance: FloatArray | None = None,
        swings: bool = False,
    ) -> Candidates:  # fmt: skip
        """Return the candidates for an assumed robot model."""
        found = cls(Predictor(robot, stance, com), Unknowns(robot, stance, priors), com_covariance, swings)
        for wanted in _LIFT_POSTURES:
            posture = found._largest(wanted, found._check_lifts)
            if posture is not None:
                found._add_lifts(posture)
        for wanted in _STANCE_POSTURES:
            posture = found._largest(wanted, found.predictor.rest)
            if posture is not None:
                found.postures.append(posture)
        if not found.lifts:
            raise ReachError(f"the robot can do no lift of the Bayesian method: {found.left_out[0]}")
        found.postures = list(dict.fromkeys([*(lift.posture for lift in found.lifts), *found.postures]))
        found._inform()
        return found

    def turned(self) -> Candidates:
        """Return the candidates after a turn by 180 deg, which reverses effects that are fixed in the world."""
        found = replace(self, predictor=replace(self.predictor, heading=math.pi), rows=[])
        found._inform()
        return found

    @property
    def search(self) -> list[int]:
        """Indices of the lifts that the search does."""
        home = self.lifts[0].posture
        return [index for index, lift in enumerate(self.lifts) if lift.posture == home and lift.passive]

    def information(self, index: int) -> FloatArray:
        """Return the (size, size) information of a lift, or of a posture's move, by its index in `rows`."""
        return self.rows[index].T @ self.rows[index]

    def _check_lifts(self, posture: BodyPosture) -> None:
        self.predictor.rest(posture)
        for diagonal in DIAGONALS:
            self._checks.check(LiftDesign(posture, diagonal, 1))

    @cached_property
    def _checks(self) -> LiftChecks:
        return LiftChecks(self.predictor.robot, self.predictor.stance, self.predictor.com, self.com_covariance)

    def _largest(self, wanted: BodyPosture, check: Callable[[BodyPosture], object]) -> BodyPosture | None:
        """Return the posture, or the largest scaled-down one that passes a check; None if none does."""
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
        passive = LiftDesign(posture, next(iter(DIAGONALS)), side)
        variants = [passive, *(replace(passive, turn=turn) for turn in AMPLITUDES)]
        variants += [replace(passive, swing=swing) for swing in SWINGS if self.swings]
        for lift in variants:
            for diagonal in DIAGONALS:
                side = -side
                design = replace(lift, diagonal=diagonal, side=side)
                try:
                    self._checks.check(design)
                except ReachError as error:
                    self.left_out.append(f"{describe(posture)}, {design.meanwhile} on {diagonal}: {error}")
                    continue
                self.lifts.append(design)

    def _inform(self) -> None:
        unknowns, predictor = self.unknowns, self.predictor
        x = unknowns.start()
        lifts = TiltEquation(unknowns, [(k, predictor.lift(d)) for k, d in enumerate(self.lifts)])
        home = self.lifts[0].posture
        moves = [(k, predictor.move(home, posture)) for k, posture in enumerate(self.postures)]
        standing = StanceMotions(unknowns, moves)
        lifts.zero_at(x)
        for equation in (lifts, standing):
            equation.prepare(x)
            _, jacobian = equation.linearise(x)
            for _, motion in equation.motions:
                rows = np.zeros((motion.stop - motion.start, unknowns.size))
                rows[:, equation.columns] = jacobian[motion]
                self.rows.append(rows)


def describe(posture: BodyPosture) -> str:
    """Return a short description of a posture."""
    parts = [
        f"{name} {math.degrees(value):+.0f} deg" if name in AMPLITUDES else f"{name} {value:+.2f}"
        for name, value in vars(posture).items()
        if value
    ]
    return ", ".join(parts) or "nominal"
