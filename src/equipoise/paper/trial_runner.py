"""Lift trials of a search: offsets, lift heights, safety checks and progress reports."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import MotionError, ReachError
from equipoise.experiments.lift import LiftSettings
from equipoise.experiments.posture import check_clear
from equipoise.experiments.standing_robot import StandingRobot
from equipoise.experiments.tipping import Pendulum
from equipoise.paper.bracket import Bracket, TriedOffset
from equipoise.paper.lift_trial import LiftReading, lift_trial, read_lift_trial
from equipoise.paper.settings import ComSearchSettings
from equipoise.robot.kinematics import inverse_kinematics
from equipoise.robot.model import DIAGONALS, RobotModel
from equipoise.robot.stance import Stance

# Capture point of a robot at a bound when it lands on its lifted feet, as a fraction of the distance to the edge of its feet.
# Larger than in a planned lift, because a search reaches its bounds only if the CoM is near them.
_LANDING = 0.8
_LIFTED = 0.5  # of the commanded height: with feet that rose less, the robot may not be balanced

Report = Callable[[str, str, int], None]
"""Function of the next trial's diagonal, the trial's description and the number of halvings left."""


class TrialRunner:
    """Runner of the lift trials of a search, with higher lifts if no tilt is measured."""

    def __init__(
        self, standing: StandingRobot, stance: Stance, settings: ComSearchSettings, report: Report | None = None
    ) -> None:
        self.standing, self.stance, self.settings = standing, stance, settings
        self.heights = lift_heights(settings.lift(stance))
        self._rung = 0
        self._report = report

    def tilt_at(self, diagonal: str, x_m: float, bracket: Bracket, lifts: list[LiftReading]) -> TriedOffset:
        """Stand on a diagonal whose line is offset by x_m, lift the other feet, and return which way the robot tips.

        If no tilt is measured, the lift is repeated higher, and later trials start at the height that gave a tilt. If the
        highest lift gives none, the robot is balanced.

        Args:
            diagonal: diagonal to stand on.
            x_m: offset of the support lines along the base's x axis [m].
            bracket: bracket that the offset lies in, for the progress report.
            lifts: list to append the lifts to.

        Raises:
            MotionError: no tilt was measured because the feet hardly left the floor.
        """
        if self._report is not None:
            left = max(1, int(np.ceil(np.log2(max(1.0, bracket.width / bracket.tolerance)))))
            lift = f"lift on {diagonal}: offset {x_m * 1000:+.1f} mm"
            self._report(
                diagonal, f"{lift}, bracket {bracket.lower * 1000:+.1f} to {bracket.upper * 1000:+.1f} mm", left
            )
        r_hat = shifted_feet(self.stance, x_m)  # Algorithm 1, lines 3 and 4
        for rung in range(self._rung, len(self.heights)):
            settings = replace(self.settings.lift(self.stance), height=self.heights[rung])
            recording = lift_trial(self.standing, diagonal, x_m, r_hat, settings)  # lines 5 to 12
            lifts.append(read_lift_trial(self.standing.robot, recording, self.stance.joint_position))
            _check_direction(lifts[-1])
            if lifts[-1].tilt.verdict != "balanced":
                self._rung = rung
                return lifts[-1].tried
        tilt, commanded = lifts[-1].tilt, lifts[-1].trial.lift_height
        if tilt.rise < _LIFTED * commanded:
            raise MotionError(
                f"no tilt was measured on {diagonal}: the feet rose by only {tilt.rise * 1000:.1f} mm of the commanded "
                f"{commanded * 1000:.1f} mm; check that the feet are free and the gains are plausible",
                tuple(lift.recording for lift in lifts),
            )
        return lifts[-1].tried


def check_search(robot: RobotModel, stance: Stance, settings: ComSearchSettings) -> None:
    """Raise an error if a search is not possible or not safe, before the robot moves.

    Raises:
        SettingsError: bounds, tolerance or lift height do not fit the robot.
        ReachError: a bound is out of reach, or the robot could fall over its own feet there.
    """
    height = settings.lift(stance).height
    for x in settings.bounds(stance):
        check_offset(robot, stance, x, height)


def check_offset(robot: RobotModel, stance: Stance, x_m: float, lift_height: float) -> None:
    """Raise ReachError if the legs do not reach an offset, or touch there, or the robot could fall over its own feet.

    According to the pendulum of `tipping`, the robot must come to rest well inside its feet when it lands on the lifted ones.

    Args:
        robot: model of the robot.
        stance: nominal stance of the robot.
        x_m: offset of the support lines along the base's x axis [m].
        lift_height: height of the lifted feet [m].
    """
    feet = shifted_feet(stance, x_m)
    position = inverse_kinematics(robot, feet, stance.joint_position)
    check_clear(robot, position)
    for diagonal in DIAGONALS:
        tipping = Pendulum.of(robot, position, np.array([0.0, 0.0, 1.0]), diagonal)
        ahead = tipping.lean > 0
        reach, room = tipping.landing(lift_height)[ahead] * tipping.height, tipping.room[ahead]
        if reach > _LANDING * room:
            raise ReachError(
                f"with the support lines at {x_m * 1000:.0f} mm and a lift of {lift_height * 1000:.0f} mm the robot could "
                f"fall over its own feet: it would land {reach * 1000:.0f} mm from the line on {diagonal}, more than the safe "
                f"{_LANDING * room * 1000:.0f} mm; set narrower bounds or a lower lift"
            )


def lift_heights(settings: LiftSettings) -> list[float]:
    """Return the heights that are tried in order until a tilt is measured [m]."""
    return [settings.height * settings.growth**rung for rung in range(settings.max_lifts)]


def shifted_feet(stance: Stance, offset: float) -> FloatArray:
    """Return the (4, 3) feet in the base frame with the support lines shifted along x (Algorithm 1, lines 3 and 4) [m]."""
    return stance.feet_in_base + np.array([offset, 0, 0])


def _check_direction(lift: LiftReading) -> None:
    """Raise MotionError if the robot rotated across its support line, which means that the IMU's orientation is wrong."""
    tilt = lift.tilt
    if tilt.across_line > 2 * abs(tilt.about_line) and tilt.across_line > 0.04:
        raise MotionError(
            f"on {lift.trial.diagonal} the robot rotated across the support line by {np.degrees(tilt.across_line):.1f} deg: "
            "the orientation of the IMU is wrong; set imu_rpy in the robot configuration",
            (lift.recording,),
        )
