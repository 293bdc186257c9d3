"""The motions of the precise method: a posture is taken up over planted feet, and two feet are lifted in it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pinocchio as pin

from equipoise.conventions import FloatArray
from equipoise.errors import ReachError
from equipoise.experiments.lift import (
    LiftSettings,
    come_to_rest,
    replant,
    rest,
    settle,
    step_pair,
    still_part,
    tilt_limit,
    tipping_from,
)
from equipoise.experiments.motion import Motion
from equipoise.experiments.planted import PlantedRobot
from equipoise.experiments.posture import BodyPosture, check_posture, feet_in_posture, stance_line
from equipoise.experiments.tipping import Pendulum
from equipoise.paper.trial_runner import ComSearchSettings
from equipoise.platform.tilt_limit import TiltLimit
from equipoise.precise.safe_lift import found_doubt, safe_stop, unknown_doubt
from equipoise.recording.recording import TRIAL, Recording
from equipoise.robot.model import DIAGONALS, LEG_NAMES, RobotModel
from equipoise.robot.stance import Stance

Rotation = Literal["roll", "pitch", "yaw"]

# On an A1; lengths and times are multiplied by those of the stance's scale.
_LIFT, _STEP_RATIO = 0.024, 0.5  # [m]; height of a replanting step over that of a lift
_OFFSET = 0.006  # [m] of the CoM from the line: the robot tips within the time on two feet
_TILT_LIMIT = 0.06  # [rad]
_AIMED, _AIMS = 0.003, 3  # [m] that the CoM may miss its place over the line; moves until it is there
_RECOVERED, _LONGEST_RECOVERY, _RECOVERY_LOOK = 0.06, 8, 0.5  # [rad], times settling, of settling
_ACCELERATION = 1.2  # [m/s2] of the body over planted feet; turning it moves its CoM less than its feet
_STILL = 0.004  # [rad/s]; a base that sways by 6 mrad/s makes the accelerometer's up wander by a milliradian
_TURN_TIME = 1 / 3  # [s] of one turn of the body and back
AMPLITUDES: dict[Rotation, float] = {"roll": 0.10, "pitch": 0.05, "yaw": 0.06}
"""Of the body's rotation on two feet [rad]; more makes the feet flicker."""
_AXES: dict[Rotation, FloatArray] = {"roll": np.eye(3)[0], "pitch": np.eye(3)[1], "yaw": np.eye(3)[2]}


@dataclass(frozen=True)
class LiftDesign:
    """One lift trial of the precise method.

    Attributes:
        posture: of the base.
        diagonal: to stand on.
        side: on which side of the CoM the line is: 1 ahead, -1 behind, 0 under it.
        turn: rotation of the body about its own CoM while on two feet, or None.
    """

    posture: BodyPosture
    diagonal: str
    side: int
    turn: Rotation | None = None


@dataclass(frozen=True)
class Times:
    """How long the parts of a trial take on a robot of a certain size [s]."""

    settle: float
    move: float
    watch: float
    turn: float

    @classmethod
    def of(cls, stance: Stance) -> Times:
        """For a robot of a stance's size."""
        clock = stance.scale.time
        return cls(settle=0.12 * clock, move=0.3 * clock, watch=0.35 * clock, turn=_TURN_TIME * clock)


def lift_settings(stance: Stance) -> LiftSettings:
    """Heights and times of the precise method's lifts."""
    times, clock = Times.of(stance), stance.scale.time
    return replace(
        ComSearchSettings().lift(stance),
        height=_LIFT * stance.scale.length,
        settle_time=times.settle,
        rest_time=0.3 * clock,
        unload_time=0.12 * clock,
        lift_time=0.12 * clock,
        lower_time=0.15 * clock,
        step_time=0.07 * clock,
        tilt_limit=_TILT_LIMIT,
        stop_delay=0.04 * clock,
        rate_time=0.016 * clock,
        still_speed=_STILL,
        max_settling=25,
    )


def offset_of(stance: Stance, side: int) -> float:
    """Distance of the line from the CoM [m]."""
    return side * _OFFSET * stance.scale.length


class PreciseTrials:
    """Does the precise method's motions on a planted robot.

    Attributes:
        com: (3,) CoM in the base frame as far as it is known: lines are placed under it, bodies turn about it [m].
        doubt: (3, 3) of it, as `safe_lift` has it [m2].
    """

    def __init__(self, planted: PlantedRobot, stance: Stance, com: FloatArray) -> None:
        self.planted, self.stance, self.com = planted, stance, com
        self.settings, self.times = lift_settings(stance), Times.of(stance)
        self.doubt = unknown_doubt(stance)
        self._lifted = False
        self._drift = np.zeros(2)  # of the CoM over the feet from where it was sent, in the stance's axes [m]

    def take_posture(self, posture: BodyPosture) -> Recording:
        """Rest, move over planted feet, rest again. Phases: ready, settle, before, move, settle, rest.

        Feet that were lifted since the last posture do not stand quite where they should: legs that pull at each other
        would make them slip on the move. They are put back first, at the nominal stance.

        Raises:
            ReachError: the posture is out of reach.
            TrackingError: the robot did not come to rest.
        """
        feet = feet_in_posture(self.stance, self.com, posture)
        check_posture(self.planted.robot, self.stance, feet)
        motion = self.planted.motion().event(TRIAL, kind="posture", **vars(posture)).phase("ready")
        if self._lifted:
            level = feet_in_posture(self.stance, self.com, BodyPosture())
            motion.move_feet(level, self._move_time(level, self.times.move))
            replant(motion, level, next(iter(DIAGONALS)), self.settings)
            self._lifted = False
        come_to_rest(self.planted, motion, self.settings, "before a move", rest_phase="before")
        motion = self.planted.motion().phase("move")
        motion.move_feet(feet, self._move_time(feet, self.times.move))
        rested = come_to_rest(self.planted, motion, self.settings, "after a move")
        diagonal = next(iter(DIAGONALS))
        tipping = tipping_from(self.planted, rested.phase("rest"), diagonal)
        self._drift = self._drift_of(tipping, diagonal, posture)
        return self.planted.finish()

    def lift(self, design: LiftDesign) -> Recording:
        """Move over the line, rest, lift two feet, perhaps turn the body, come down and replant.

        Phases: move, settle, rest, unload, lift, watch, lower, replant.

        Raises:
            ReachError: the lift is out of reach.
            TrackingError: the robot did not come to rest.
            FallError: it does not stand upright.
        """
        stance_legs, settings = DIAGONALS[design.diagonal], self.settings
        motion = self.planted.motion().event(
            TRIAL, kind="lift", diagonal=design.diagonal, side=design.side, turn=design.turn,
            posture=vars(design.posture), offset=0.0, lift_height=settings.height,
            tilt_threshold=settings.tilt_threshold,
        )  # fmt: skip
        self._lifted = True
        try:
            feet, lifted = self._aim(motion, design)
            limit = self._limit(design.diagonal)
        except ReachError:
            if (done := self.planted.take()) is not None:
                self.planted.keep(done)
            raise
        up = self.planted.motion().phase("unload").shift_load(stance_legs, settings.unload_time)
        up.phase("lift").move_feet(lifted, settings.lift_time).phase("watch")
        if design.turn is None:
            up.hold(self.times.watch)
        else:
            angle = turn_angle(design.turn, self.times.turn, self.planted.platform.control_period)
            up.follow(lambda phi: turned_feet(lifted, self.com, design.turn, phi), 9, angle)
        self.planted.play(up, limit)
        down = self.planted.motion().phase("lower").move_feet(feet, settings.lower_time)
        down.shift_load(LEG_NAMES, settings.unload_time)
        landed = self.planted.play(down)
        if self._stands_up_again(landed, design.posture):
            # The robot has tipped onto its lifted feet: they stand where they landed, and the legs pull. Step once.
            stepped = feet + _STEP_RATIO * (lifted - feet)
            self.planted.play(step_pair(self.planted.motion().phase("replant"), stance_legs, stepped, settings))
        return self.planted.finish()

    def _aim(self, motion: Motion, design: LiftDesign) -> tuple[FloatArray, FloatArray]:
        """Move over the line until the CoM is where the design wants it, by what the sensors say; feet as `lift_feet`."""
        feet, lifted = self._feet(design)
        for left in reversed(range(_AIMS)):
            motion.phase("move").move_feet(feet, self._move_time(feet, self.times.move * 2 / 3))
            settled = settle(self.planted, motion, self.settings, f"before a lift on {design.diagonal}")
            tipping = tipping_from(self.planted, still_part(settled, self.settings), design.diagonal)
            self._drift = self._drift_of(tipping, design.diagonal, design.posture)
            if not left or abs(tipping.ahead + offset_of(self.stance, design.side)) < _AIMED * self.stance.scale.length:
                break
            motion, (feet, lifted) = self.planted.motion(), self._feet(design)
        return feet, lifted

    def _limit(self, diagonal: str) -> TiltLimit:
        """Rest, and say when the lift must end."""
        tipping = tipping_from(self.planted, rest(self.planted, self.settings), diagonal)
        return tilt_limit(
            self.planted, tipping, self.settings, safe_stop(tipping, self.settings, self.stance, self.doubt)
        )

    def _feet(self, design: LiftDesign) -> tuple[FloatArray, FloatArray]:
        _, normal, _ = stance_line(self.stance, design.diagonal)
        return lift_feet(self.stance, self.com, design, self.settings.height, float(normal[:2] @ self._drift))

    def _drift_of(self, tipping: Pendulum, diagonal: str, posture: BodyPosture) -> FloatArray:
        """(2,) of the CoM over the feet from where it was sent, as joints sag and feet creep, in the stance's axes [m]."""
        left, normal, _ = stance_line(self.stance, diagonal)
        found = tipping.ahead * normal + tipping.along * left
        middle = self.planted.target.feet_in_base[[leg in DIAGONALS[diagonal] for leg in LEG_NAMES]].mean(axis=0)
        return (found - posture.rotation @ (self.com - middle))[:2]

    def _stands_up_again(self, landed: Recording, posture: BodyPosture) -> bool:
        """Wait until the robot leans as it was sent, after it tipped; to step before would tip it over."""
        rotation = np.array(self.planted.robot.imu_in_base.rotation)
        for _ in range(_LONGEST_RECOVERY):
            end = landed.imu.time[-1] - _RECOVERY_LOOK * self.times.settle
            gravity = rotation @ landed.between(end, np.inf).imu.acceleration.mean(axis=0)
            lean = float(np.arccos(np.clip(gravity @ posture.rotation[2] / np.linalg.norm(gravity), -1, 1)))
            if lean < _RECOVERED:
                return True
            landed = self.planted.play(self.planted.motion().hold(self.times.settle))
        return False

    def _move_time(self, feet: FloatArray, least: float) -> float:
        return self.planted.move_time(feet, self.planted.target.feet_in_base, least, _ACCELERATION)


def lift_feet(
    stance: Stance, com: FloatArray, design: LiftDesign, height: float, drift: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """(4, 3) planted and lifted feet in the base frame [m].

    Args:
        drift: how far ahead of where it is sent the CoM comes to be [m].
    """
    feet = feet_in_posture(stance, com, design.posture, design.diagonal, offset_of(stance, design.side) + drift)
    lifted = feet.copy()
    in_air = [leg not in DIAGONALS[design.diagonal] for leg in LEG_NAMES]
    lifted[in_air] += height * design.posture.rotation[2]
    return feet, lifted


def turned_feet(feet: FloatArray, com: FloatArray, turn: Rotation | None, angle: float) -> FloatArray:
    """Feet in the base frame of a body that turned about its CoM over them."""
    if turn is None:
        return feet
    return (feet - com) @ np.array(pin.exp3(_AXES[turn] * angle)) + com


def turn_angle(turn: Rotation, duration: float, control_period: float) -> FloatArray:
    """(n,) the angle at each control period: once to and fro, starting and ending at rest [rad]."""
    phase = np.arange(1, round(duration / control_period) + 1) / round(duration / control_period)
    return AMPLITUDES[turn] * np.sin(2 * np.pi * phase) * np.sin(np.pi * phase)


def check_lift(
    robot: RobotModel, stance: Stance, com: FloatArray, design: LiftDesign, doubt: FloatArray | None = None
) -> None:
    """Refuse a lift that is out of reach, too weak or not safe, before anything moves.

    Args:
        doubt: (3, 3) of the CoM [m2]; default `found_doubt`.

    Raises:
        ReachError: says what is wrong.
    """
    settings = lift_settings(stance)
    feet, lifted = lift_feet(stance, com, design, settings.height)
    position = check_posture(robot, stance, feet)
    for angle in (0.0,) if design.turn is None else (AMPLITUDES[design.turn], -AMPLITUDES[design.turn]):
        check_posture(robot, stance, turned_feet(lifted, com, design.turn, angle), DIAGONALS[design.diagonal])
    height = float(com @ design.posture.rotation[2] - (feet @ design.posture.rotation[2]).mean())
    half_width = float(np.abs(stance.feet_in_base[:, 1]).mean())
    if settings.height > half_width or height <= 0:
        raise ReachError(
            f"a lift of {settings.height * 1000:.0f} mm is too high for feet {half_width * 2000:.0f} mm apart"
        )
    tipping = Pendulum.of(robot, position, design.posture.rotation[2], design.diagonal)
    safe_stop(tipping, settings, stance, found_doubt(stance) if doubt is None else doubt)
