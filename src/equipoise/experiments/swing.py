"""Swing trials that identify the motors: all legs of a lying robot at once, or one leg at a time on three feet."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.experiments.legs_up import legs_up
from equipoise.experiments.lift import LiftSettings, settle
from equipoise.experiments.motion import Motion
from equipoise.experiments.one_leg_up import SOFTER, OneLegUp, legs_in_turn
from equipoise.experiments.stand import lie_down, rise
from equipoise.experiments.standing_robot import StandingRobot
from equipoise.recording.phases import Phase
from equipoise.recording.trials import MotorTrial
from equipoise.robot.model import LEG_NAMES, RobotModel
from equipoise.robot.stance import Stance

_FREQUENCIES = (0.5, 0.85, 1.4, 2.3, 3.7, 6.0)  # [Hz] on an A1
RAMP_TIME = 0.5
"""Time in which a swing grows, and in which it fades, on an A1 [s]."""
_RAISING_SPEED = 1.0  # [rad/s], mean
_SHORTEST, _REST = 1.0, 0.4  # [s]
# On three feet, on an A1 [s]: the body moves slowly between its stances, and then waits until it is still.
_SHIFT_TIME, _UNLOAD_TIME, _LIFT_TIME = 1.0, 0.2, 0.6
_RAMP_ON_THREE = 0.25


def swing_legs(standing: StandingRobot, stance: Stance, duration: float) -> None:
    """Lie down, turn the legs up, swing all joints, and stand up again.

    Phases: lie, raise, rest, ramp, swing, end, fold, stand.

    Args:
        duration: time of the steady part [s].

    Raises:
        ReachError: the robot cannot turn its legs up.
    """
    up, robot = legs_up(standing.robot, stance), standing.robot
    lie_down(standing, stance, _trial(standing, stance))
    _turn_legs(standing, Phase.RAISE, up.folded, up.way)
    joints = range(len(robot.joint_names))
    standing.play(_swing(standing, stance, joints, up.swing, duration, RAMP_TIME))
    _turn_legs(standing, Phase.FOLD, up.joint_position, up.way_back)
    rise(standing, stance)
    standing.finish()


def swing_leg(standing: StandingRobot, stance: Stance, up: OneLegUp, duration: float) -> None:
    """Move the body over three feet, lift the fourth, swing that leg's joints, put the foot down.

    Phases: move, settle, unload, lift, rest, ramp, swing, end, lower.

    Args:
        up: leg and posture of the robot.
        duration: time of the steady part [s].

    Raises:
        MotionError: the robot does not come to rest over three feet.
    """
    times = LiftSettings.of(stance, 0.0)
    unload, lift = (time * stance.scale.time for time in (_UNLOAD_TIME, _LIFT_TIME))
    over = standing.motion().begin(_trial(standing, stance, up.leg)).phase(Phase.MOVE)
    over.move_feet(up.feet, _shift_time(stance, standing.target.feet_in_base, up.feet))
    settle(standing, over, times, f"over three feet, before it lifts the {up.leg} one")
    motion = standing.motion().phase(Phase.UNLOAD).shift_load(up.standing, unload)
    standing.play(motion.phase(Phase.LIFT).move_feet(up.raised, lift))
    joints = standing.robot.legs[up.leg].joints
    standing.play(_swing(standing, stance, joints, up.swing, duration, _RAMP_ON_THREE))
    standing.play(standing.motion().phase(Phase.LOWER).move_feet(up.feet, lift).shift_load(LEG_NAMES, unload))
    standing.finish()


def _trial(standing: StandingRobot, stance: Stance, leg: str | None = None) -> MotorTrial:
    """Return the trial, with the gains of the swinging joints if the platform accepts gains."""
    if "gains" not in standing.platform.accepts:
        return MotorTrial(leg=leg)
    kp, kd = standing.robot.gains(stance.hip_height)
    return MotorTrial(kp=SOFTER * kp, kd=SOFTER * kd, leg=leg)


def _swing(
    standing: StandingRobot, stance: Stance, joints: Sequence[int], swing: FloatArray, duration: float, ramp: float
) -> Motion:
    """Fade out the joints' torques, swing them with soft gains, and wait until the motion has decayed.

    Args:
        joints: indices of the joints that swing; the others keep the platform's gains.
        swing: (nj,) angles to either side [rad].
        duration: time of the steady part [s].
        ramp: time in which the swing grows, and in which it fades, on an A1 [s].
    """
    robot, period, motion = standing.robot, standing.platform.control_period, standing.motion()
    if "gains" in standing.platform.accepts:
        share = np.ones(len(robot.joint_names))
        share[list(joints)] = SOFTER
        kp, kd = robot.gains(stance.hip_height)
        motion.with_gains(share * kp, share * kd)
    motion.phase(Phase.REST).relax(_REST, joints)
    begin, growing = motion.time, ramp * stance.scale.time
    time: FloatArray = np.arange(1.0, round((duration + 2 * growing) / period) + 1) * period
    motion.phase(Phase.RAMP).swing_joints(swing_angles(robot, stance, swing, time, ramp))
    motion.phase_at(Phase.SWING, begin + growing).phase_at(Phase.END, begin + growing + duration)
    return motion.hold(_REST)


def swing_time(robot: RobotModel, stance: Stance, duration: float) -> float:
    """Return the approximate robot time of `swing_legs` [s]."""
    up, around = legs_up(robot, stance), 4.0 * stance.scale.time  # lying down, standing up
    turning = sum(_turning_time(before, after) for before, after in pairwise((up.folded, *up.way)))
    return duration + 2 * (RAMP_TIME * stance.scale.time + _REST + turning) + around


def swing_time_on_three(robot: RobotModel, stance: Stance, duration: float) -> float:
    """Return the approximate robot time of `swing_leg` for all legs [s]; `duration` is their total swing time."""
    ups, least = legs_in_turn(robot, stance), LiftSettings.of(stance, 0.0)
    places = (stance.feet_in_base, *(up.feet for up in ups), stance.feet_in_base)
    shifting = sum(_shift_time(stance, before, after) for before, after in pairwise(places))
    each = 2 * (_UNLOAD_TIME + _LIFT_TIME + _RAMP_ON_THREE) * stance.scale.time + 2 * _REST + least.settle_time
    return duration + shifting + len(ups) * each


def swing_angles(
    robot: RobotModel, stance: Stance, swing: FloatArray, time: FloatArray, ramp: float = RAMP_TIME
) -> FloatArray:
    """Return (n, nj) swing angles at (n,) times, the last of which ends the swing [rad].

    Each joint's swing is a sum of six sines with distinct phases and amplitudes that decrease with frequency.

    Args:
        swing: (nj,) largest angles to either side [rad].
        ramp: time in which the swing grows, and in which it fades, on an A1 [s].
    """
    frequencies = np.array(_FREQUENCIES) / stance.scale.time
    order = np.arange(1, len(frequencies) + 1)
    joint = np.arange(len(robot.joint_names))
    phases = 2 * np.pi * np.outer(joint, order) / 12 - np.pi * order * (order - 1) / 6
    sines = np.sin(2 * np.pi * frequencies * time[:, None, None] + phases)
    shape = (sines / np.sqrt(frequencies)).sum(axis=2)
    grown = np.clip(np.minimum(time, time[-1] - time) / (ramp * stance.scale.time), 0.0, 1.0)
    return grown[:, None] * shape * (swing / np.abs(shape).max(axis=0))


def _turn_legs(standing: StandingRobot, phase: str, start: FloatArray, way: tuple[FloatArray, ...]) -> None:
    motion = standing.motion().phase(phase)
    for before, after in pairwise((start, *way)):
        motion.move_joints(after, _turning_time(before, after))
    standing.play(motion)


def _turning_time(before: FloatArray, after: FloatArray) -> float:
    """Return the duration of a joint motion [s]."""
    return max(_SHORTEST, float(np.abs(after - before).max()) / _RAISING_SPEED)


def _shift_time(stance: Stance, before: FloatArray, after: FloatArray) -> float:
    """Return the duration of a stance motion [s]."""
    return StandingRobot.move_time(after, before, _SHIFT_TIME * stance.scale.time)
