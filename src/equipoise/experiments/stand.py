"""Motions at the beginning and end of a routine: standing up, returning, and lying down."""

from __future__ import annotations

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import SettingsError
from equipoise.experiments.motion import Target
from equipoise.experiments.standing_robot import StandingRobot
from equipoise.platform.platform import Platform
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.recording.trials import RecordedTrial
from equipoise.robot.kinematics import foot_positions
from equipoise.robot.model import LEG_NAMES, RobotModel
from equipoise.robot.stance import Stance, lies, lying_posture

_SPEED_RATIO = 0.35  # leg lengths a second, for feet that carry the robot up or down
_SHORTEST = 0.5  # [s]
_BEFORE_STOP = 0.003  # of a joint's range
_FOLDING_SPEED = 0.6  # [rad/s], mean
_ELSEWHERE_RATIO = 0.15  # of the leg length: a robot whose feet are farther from its stance returns to them


def stand_up(platform: Platform, robot: RobotModel, stance: Stance) -> tuple[StandingRobot, FloatArray]:
    """Move from the present joint positions to the nominal stance, with feet on straight lines in the base frame.

    Returns:
        the standing robot, and the (4, 3) feet in the base frame to end with [m]: those over which it lies if it lay, the
        initial ones if it stood elsewhere, else the stance's.

    Raises:
        SettingsError: the platform's joints are not the robot's.
        ReachError: the path is out of the legs' reach.
    """
    standing = take_over(platform, robot, stance)
    if not standing.target.legs:
        down = rise(standing, stance)
        standing.take()
        return standing, down
    feet = standing.target.feet_in_base
    move_to(standing, stance.feet_in_base)
    elsewhere = np.linalg.norm(feet - stance.feet_in_base, axis=1).max() > _ELSEWHERE_RATIO * robot.leg_length
    return standing, feet if elsewhere else stance.feet_in_base


def take_over(platform: Platform, robot: RobotModel, stance: Stance) -> StandingRobot:
    """Return the standing or lying robot with its present joint positions as targets; no command is sent.

    Raises:
        SettingsError: the platform's joints are not the robot's.
    """
    if platform.joint_names != robot.joint_names:
        raise SettingsError(
            f"the platform's joints {', '.join(platform.joint_names)} are not the leg joints of {robot.name!r}: "
            f"{', '.join(robot.joint_names)}"
        )
    here = before_stops(robot, platform.read().joint_position)
    target = Target.lying(robot, here) if lies(robot, stance, here) else Target.standing(robot, here)
    return StandingRobot(platform, robot, target, stance.feet_in_base)


def before_stops(robot: RobotModel, joint_position: FloatArray) -> FloatArray:
    """Return joint positions within the limits: a limp robot rests on its joint stops, and encoders have offsets."""
    inside = _BEFORE_STOP * (robot.upper_limit - robot.lower_limit)
    return np.clip(joint_position, robot.lower_limit + inside, robot.upper_limit - inside)


def lie_down(standing: StandingRobot, stance: Stance, trial: RecordedTrial | None = None) -> Recording:
    """Lower the body over its feet until the legs carry no load. Phase: lie.

    Args:
        trial: trial that begins with this motion, or None.
    """
    robot = standing.robot
    folded, _ = lying_posture(robot, stance)
    feet = foot_positions(robot, folded)
    motion = standing.motion() if trial is None else standing.motion().begin(trial)
    motion.phase(Phase.LIE).move_feet(feet, _carrying_time(standing, feet))
    return standing.play(motion.shift_load((), _SHORTEST))


def rise(standing: StandingRobot, stance: Stance) -> FloatArray:
    """Fold the legs under the lying robot, load them, and stand up.

    Returns:
        the (4, 3) feet in the base frame over which it lies [m].
    """
    robot = standing.robot
    folded, _ = lying_posture(robot, stance)
    swept = float(np.abs(folded - standing.target.joint_position).max())
    motion = standing.motion().phase(Phase.FOLD).move_joints(folded, max(_SHORTEST, swept / _FOLDING_SPEED))
    standing.play(motion.shift_load(LEG_NAMES, _SHORTEST))
    _move(standing, stance.feet_in_base)
    return foot_positions(robot, folded)


def move_to(standing: StandingRobot, feet_in_base: FloatArray) -> None:
    """Move the feet in the base frame slowly enough to carry the robot; the recording is discarded."""
    _move(standing, feet_in_base)
    standing.take()


def _move(standing: StandingRobot, feet_in_base: FloatArray) -> None:
    duration = _carrying_time(standing, feet_in_base)
    standing.play(standing.motion().phase(Phase.STAND).move_feet(feet_in_base, duration).hold(_SHORTEST))


def _carrying_time(standing: StandingRobot, feet_in_base: FloatArray) -> float:
    """Return the duration of a motion of feet that carry the robot [s]."""
    distance = float(np.linalg.norm(feet_in_base - standing.target.feet_in_base, axis=1).max())
    return max(_SHORTEST, 2 * distance / (_SPEED_RATIO * standing.robot.leg_length))
