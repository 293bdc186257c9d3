"""How a routine begins and ends: up from wherever the robot is, and gently back."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from equipoise.errors import SettingsError
from equipoise.experiments.motion import Target
from equipoise.experiments.planted import PlantedRobot
from equipoise.platforms.platform import Platform
from equipoise.robot.kinematics import foot_positions
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance

FloatArray = NDArray[np.float64]

_SPEED_RATIO = 0.35  # leg lengths a second, for feet that carry the robot up or down
_SHORTEST = 0.5  # [s]
_LYING_RATIO = (
    0.15  # a robot whose feet are farther than this fraction of the leg length from its stance does not stand
)


def stand_up(platform: Platform, robot: RobotModel, stance: Stance) -> tuple[PlantedRobot, FloatArray]:
    """From where the joints are to the nominal stance, the feet on straight lines in the base frame.

    Returns:
        the planted robot, and the (4, 3) feet in the base frame to end with: those it began with if it lay, else the
        stance's.

    Raises:
        SettingsError: the platform's joints are not the robot's.
        ReachError: the way is out of the legs' reach.
    """
    if platform.joint_names != robot.joint_names:
        raise SettingsError(
            f"the platform's joints {', '.join(platform.joint_names)} are not the leg joints of {robot.name!r}: "
            f"{', '.join(robot.joint_names)}"
        )
    # Folded legs rest on their stops, where encoders may read a little more than the limits that motions keep to.
    here = np.clip(platform.read().joint_position, robot.lower_limit, robot.upper_limit)
    feet = foot_positions(robot, here)
    planted = PlantedRobot(platform, robot, Target.standing(robot, np.array(here)), stance.feet_in_base)
    move_to(planted, stance.feet_in_base)
    lay = np.linalg.norm(feet - stance.feet_in_base, axis=1).max() > _LYING_RATIO * robot.leg_length
    return planted, feet if lay else stance.feet_in_base


def move_to(planted: PlantedRobot, feet_in_base: FloatArray) -> None:
    """Move the feet in the base frame slowly enough for feet that carry the robot."""
    distance = float(np.linalg.norm(feet_in_base - planted.target.feet_in_base, axis=1).max())
    duration = max(_SHORTEST, 2 * distance / (_SPEED_RATIO * planted.robot.leg_length))
    planted.play(planted.motion().phase("stand").move_feet(feet_in_base, duration).hold(_SHORTEST))
    planted.take()
