"""Motions of the Bayesian method: stance motions to a posture, and lifts of two feet in it."""

from __future__ import annotations

import numpy as np

from equipoise.bayesian.lift_design import LiftDesign, lift_feet, lift_settings, offset_of
from equipoise.bayesian.safe_lift import initial_covariance, safe_stop
from equipoise.conventions import FloatArray
from equipoise.errors import MotionError, ReachError
from equipoise.estimator.measurements.heading import angle_turned
from equipoise.experiments.lift import (
    LiftSettings,
    come_to_rest,
    in_time,
    replant,
    rest,
    settle,
    step_pair,
    still_part,
    tilt_limit,
    tipping_from,
)
from equipoise.experiments.motion import Motion
from equipoise.experiments.posture import check_posture, feet_in_posture, stance_line
from equipoise.experiments.stand import lie_down, rise
from equipoise.experiments.standing_robot import StandingRobot
from equipoise.experiments.tipping import Pendulum
from equipoise.experiments.turn import be_turned
from equipoise.platform.tilt_limit import TiltLimit
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.recording.trials import DesignedLift, PostureTrial, RecordedTrial, TurnTrial
from equipoise.robot.model import DIAGONALS, LEG_NAMES
from equipoise.robot.posture import BodyPosture
from equipoise.robot.stance import Stance

# On an A1; lengths scale with the stance's size, times with its clock.
_STEP_RATIO = 0.5  # height of a replanting step over that of a lift
_AIMED, _AIMS = 0.003, 3  # largest error of the CoM's distance from the line [m]; largest number of moves to reach it
_RECOVERED, _LONGEST_RECOVERY, _RECOVERY_LOOK = 0.06, 8, 0.5  # largest lean [rad]; periods; averaged part of one
# Largest difference from 180 deg [rad]: an external force is then determined almost as well, and the angle is measured.
_TURN_TOLERANCE = np.radians(30)
_ACCELERATION = 1.2  # [m/s2] of the body in a stance motion; its rotation moves the CoM less than the feet


class BayesianTrials:
    """Motions of the Bayesian method on a standing robot.

    Attributes:
        com: (3,) current estimate of the CoM in the base frame, for support lines and rotations of the body [m].
        com_covariance: (3, 3) covariance of that CoM, as in `safe_lift` [m2].
    """

    def __init__(self, standing: StandingRobot, stance: Stance, com: FloatArray) -> None:
        self.standing, self.stance, self.com = standing, stance, com
        self.settings = lift_settings(stance)
        self.com_covariance = initial_covariance(stance)
        self._lifted = False
        self._drift = np.zeros(2)  # CoM over the feet minus its commanded position, in the stance's axes [m]

    def take_posture(self, posture: BodyPosture) -> Recording:
        """Rest, do a stance motion to the posture, rest again. Phases: ready, settle, before, move, settle, rest.

        Feet that were lifted since the last posture are first replanted at the nominal stance: their position errors
        cause internal forces, which would make them slip during the motion.

        Raises:
            ReachError: the posture is out of reach.
            MotionError: the robot did not come to rest.
        """
        feet = feet_in_posture(self.stance, self.com, posture)
        check_posture(self.standing.robot, self.stance, feet)
        self._get_ready(PostureTrial(posture=posture), "before a move")
        return self._move_over(feet, posture, "after a move")

    def turn(self) -> Recording:
        """Lie down, be turned to face the other way, stand up and rest.

        Phases: ready, settle, before, lie, turn, fold, stand, move, settle, rest.

        Raises:
            MotionError: the robot was not turned, or not by about 180 deg, or did not come to rest.
            FallError: the robot is not upright.
        """
        standing, level = self.standing, feet_in_posture(self.stance, self.com, BodyPosture())
        self._lifted = True  # replant: the angle is measured from a body without yaw relative to its feet
        rested = self._get_ready(TurnTrial(), "before a turn")
        lain = lie_down(standing, self.stance)
        whole = Recording.concatenate([rested, lain, be_turned(standing, self.stance)])
        angle = abs(angle_turned(standing.robot, whole))
        if angle < np.pi - _TURN_TOLERANCE:
            raise MotionError(
                f"the robot was turned by {np.degrees(angle):.0f} deg according to its gyroscope; it must be 150 to 210. Put "
                "it back as it stood at the start of the run, and resume the run",
                (whole,),
            )
        rise(standing, self.stance)
        return self._move_over(level, BodyPosture(), "after a turn")

    def _get_ready(self, trial: RecordedTrial, when: str) -> Recording:
        """Replant the feet if they were lifted, come to rest, and return the recording."""
        motion = self.standing.motion().begin(trial).phase(Phase.READY)
        if self._lifted:
            level = feet_in_posture(self.stance, self.com, BodyPosture())
            motion.move_feet(level, self._move_time(level, self.settings.move_time))
            replant(motion, level, next(iter(DIAGONALS)), self.settings)
            self._lifted = False
        return come_to_rest(self.standing, motion, self.settings, when, rest_phase=Phase.BEFORE)

    def _move_over(self, feet: FloatArray, posture: BodyPosture, when: str) -> Recording:
        """Move to a posture, rest, update the drift of the CoM, and return the whole trial."""
        motion = self.standing.motion().phase(Phase.MOVE)
        motion.move_feet(feet, self._move_time(feet, self.settings.move_time))
        rested = come_to_rest(self.standing, motion, self.settings, when)
        diagonal = next(iter(DIAGONALS))
        tipping = tipping_from(self.standing, rested.phase(Phase.REST), diagonal)
        self._drift = self._drift_of(tipping, diagonal, posture)
        return self.standing.finish()

    def lift(self, design: LiftDesign) -> Recording:
        """Move over the line, rest, lift two feet, rotate the body if designed, lower and replant.

        Phases: move, settle, rest, unload, lift, watch, lower, replant.

        Raises:
            ReachError: the lift is out of reach.
            MotionError: the robot did not come to rest.
            FallError: the robot is not upright.
        """
        stance_legs, settings = DIAGONALS[design.diagonal], self.settings
        trial = DesignedLift(
            diagonal=design.diagonal, offset=0.0, lift_height=settings.height, tilt_threshold=settings.tilt_threshold,
            posture=design.posture, side=design.side, turn=design.turn, swing=design.swing,
        )  # fmt: skip
        motion = self.standing.motion().begin(trial)
        self._lifted = True
        try:
            feet, lifted = self._aim(motion, design)
            limit = self._limit(design.diagonal, in_time(self.standing, feet, lifted, settings))
        except ReachError:
            if (done := self.standing.take()) is not None:
                self.standing.keep(done)
            raise
        up = self.standing.motion().phase(Phase.UNLOAD).shift_load(stance_legs, settings.unload_time)
        up.phase(Phase.LIFT).move_feet(lifted, settings.lift_time).phase(Phase.WATCH)
        if design.passive:
            up.hold(self.settings.watch_time)
        else:
            amounts = design.amounts(self.stance, self.standing.platform.control_period)
            up.follow(lambda amount: design.feet(lifted, self.com, amount), 9, amounts)
        self.standing.play(up, limit)
        down = self.standing.motion().phase(Phase.LOWER).move_feet(feet, settings.lower_time)
        down.shift_load(LEG_NAMES, settings.unload_time)
        landed = self.standing.play(down)
        if self._stands_up_again(landed, design.posture):
            # The robot tipped onto its lifted feet. Step once to release the internal forces of misplaced feet.
            stepped = feet + _STEP_RATIO * (lifted - feet)
            self.standing.play(step_pair(self.standing.motion().phase(Phase.REPLANT), stance_legs, stepped, settings))
        return self.standing.finish()

    def _aim(self, motion: Motion, design: LiftDesign) -> tuple[FloatArray, FloatArray]:
        """Move until the measured CoM is at its designed distance from the line; return feet as `lift_feet`."""
        feet, lifted = self._feet(design)
        for left in reversed(range(_AIMS)):
            motion.phase(Phase.MOVE).move_feet(feet, self._move_time(feet, self.settings.move_time * 2 / 3))
            settled = settle(self.standing, motion, self.settings, f"before a lift on {design.diagonal}")
            tipping = tipping_from(self.standing, still_part(settled, self.settings), design.diagonal)
            self._drift = self._drift_of(tipping, design.diagonal, design.posture)
            if not left or abs(tipping.ahead + offset_of(self.stance, design.side)) < _AIMED * self.stance.scale.length:
                break
            motion, (feet, lifted) = self.standing.motion(), self._feet(design)
        return feet, lifted

    def _limit(self, diagonal: str, settings: LiftSettings) -> TiltLimit:
        """Rest, and return the tilt limit of the lift."""
        tipping = tipping_from(self.standing, rest(self.standing, self.settings), diagonal)
        return tilt_limit(
            self.standing, tipping, settings, safe_stop(tipping, settings, self.stance, self.com_covariance)
        )

    def _feet(self, design: LiftDesign) -> tuple[FloatArray, FloatArray]:
        _, normal, _ = stance_line(self.stance, design.diagonal)
        return lift_feet(self.stance, self.com, design, self.settings.height, float(normal[:2] @ self._drift))

    def _drift_of(self, tipping: Pendulum, diagonal: str, posture: BodyPosture) -> FloatArray:
        """Return the (2,) CoM minus its commanded position, from compliance and creep, in the stance's axes [m]."""
        left, normal, _ = stance_line(self.stance, diagonal)
        found = tipping.ahead * normal + tipping.along * left
        middle = self.standing.target.feet_in_base[[leg in DIAGONALS[diagonal] for leg in LEG_NAMES]].mean(axis=0)
        return (found - posture.rotation @ (self.com - middle))[:2]

    def _stands_up_again(self, landed: Recording, posture: BodyPosture) -> bool:
        """Wait until the robot that tipped is back in its posture; return False if it is not: a step would tip it over."""
        rotation = np.array(self.standing.robot.imu_in_base.rotation)
        for _ in range(_LONGEST_RECOVERY):
            end = landed.imu.time[-1] - _RECOVERY_LOOK * self.settings.settle_time
            gravity = rotation @ landed.between(end, np.inf).imu.acceleration_in_imu.mean(axis=0)
            lean = float(np.arccos(np.clip(gravity @ posture.rotation[2] / np.linalg.norm(gravity), -1, 1)))
            if lean < _RECOVERED:
                return True
            landed = self.standing.play(self.standing.motion().hold(self.settings.settle_time))
        return False

    def _move_time(self, feet: FloatArray, least: float) -> float:
        return self.standing.move_time(feet, self.standing.target.feet_in_base, least, _ACCELERATION)
