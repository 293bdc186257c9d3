"""Short stance motion down and up, with a rest after each: joint friction has opposite signs in the two rests."""

from __future__ import annotations

import numpy as np

from equipoise.experiments.lift import LiftSettings, come_to_rest
from equipoise.experiments.standing_robot import StandingRobot
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.robot.stance import Stance

_DEPTH = 0.03  # of the hip height: joints move several times farther than friction deflects their position control


def dip(standing: StandingRobot, stance: Stance) -> tuple[Recording, Recording]:
    """Lower the body, rest, raise it again, rest. The recordings are not stored in the run.

    Returns:
        recordings of the lower rest, reached downward, and of the rest at the stance, reached upward.

    Raises:
        MotionError: the robot does not come to rest.
        ReachError: the posture is out of reach.
    """
    home = stance.feet_in_base
    settings = LiftSettings.of(stance, height=0.0)
    below, above = (
        _rest_at(standing, feet, settings) for feet in (home + np.array([0.0, 0.0, _DEPTH * stance.hip_height]), home)
    )
    standing.take()
    return below, above


def _rest_at(standing: StandingRobot, feet_in_base: np.ndarray, settings: LiftSettings) -> Recording:
    time = standing.move_time(feet_in_base, standing.target.feet_in_base, settings.move_time)
    motion = standing.motion().phase(Phase.MOVE).move_feet(feet_in_base, time)
    return come_to_rest(standing, motion, settings, "before its mass is compared")
