"""All joints swing at once, the legs of the lying robot turned up: what tells its motors apart."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.experiments.legs_up import LegsUp, legs_up
from equipoise.experiments.planted import PlantedRobot
from equipoise.experiments.stand import lie_down, rise
from equipoise.recording.phases import Phase
from equipoise.recording.trials import MotorTrial
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance

_FREQUENCIES = (0.5, 0.85, 1.4, 2.3, 3.7, 6.0)  # [Hz] on an A1
SOFTER = 0.25
"""Gains while joints swing, over the platform's own: the legs' own dynamics then show in what the joints do."""
RAMP_TIME = 0.5
"""In which a swing grows and in which it fades [s] on an A1."""
_RAISING_SPEED = 1.0  # [rad/s], mean
_SHORTEST, _REST = 1.0, 0.4  # [s]


def swing_legs(planted: PlantedRobot, stance: Stance, duration: float) -> None:
    """Lie down, turn the legs up, swing all joints, and stand up again.

    Phases: lie, raise, rest, ramp, swing, end, fold, stand.

    Args:
        duration: time of the steady part [s].

    Raises:
        ReachError: the robot cannot turn its legs up.
    """
    up, robot = legs_up(planted.robot, stance), planted.robot
    gains = robot.gains(stance.hip_height) if "gains" in planted.platform.accepts else None
    kp, kd = (None, None) if gains is None else (SOFTER * gain for gain in gains)
    lie_down(planted, stance)
    _turn_legs(planted, Phase.RAISE, up.folded, up.way)
    motion = planted.motion().begin(MotorTrial(kp=kp, kd=kd))
    if kp is not None and kd is not None:
        joints = len(robot.joint_names)
        motion.with_gains(np.full(joints, kp), np.full(joints, kd))
    ramp, period = RAMP_TIME * stance.scale.time, planted.platform.control_period
    motion.phase(Phase.REST).relax(_REST)
    begin = motion.time
    motion.phase(Phase.RAMP).phase_at(Phase.SWING, begin + ramp).phase_at(Phase.END, begin + ramp + duration)
    time: FloatArray = np.arange(1.0, round((duration + 2 * ramp) / period) + 1) * period
    motion.swing_joints(swing_angles(robot, stance, up, time))
    planted.play(motion.hold(_REST))
    _turn_legs(planted, Phase.FOLD, up.joint_position, up.way_back)
    rise(planted, stance)
    planted.finish()


def swing_time(robot: RobotModel, stance: Stance, duration: float) -> float:
    """Robot time of `swing_legs`, roughly [s]."""
    up, around = legs_up(robot, stance), 4.0 * stance.scale.time  # lying down, standing up
    turning = sum(_turning_time(before, after) for before, after in pairwise((up.folded, *up.way)))
    return duration + 2 * (RAMP_TIME * stance.scale.time + _REST + turning) + around


def swing_angles(robot: RobotModel, stance: Stance, up: LegsUp, time: FloatArray) -> FloatArray:
    """(n, nj) angles at (n,) times, which end when the swing does [rad].

    Each joint swings by six sines, faster ones less far, with phases of its own, scaled to what there is room for.
    """
    frequencies = np.array(_FREQUENCIES) / stance.scale.time
    order = np.arange(1, len(frequencies) + 1)
    joint = np.arange(len(robot.joint_names))
    phases = 2 * np.pi * np.outer(joint, order) / 12 - np.pi * order * (order - 1) / 6
    sines = np.sin(2 * np.pi * frequencies * time[:, None, None] + phases)
    shape = (sines / np.sqrt(frequencies)).sum(axis=2)
    grown = np.clip(np.minimum(time, time[-1] - time) / (RAMP_TIME * stance.scale.time), 0.0, 1.0)
    return grown[:, None] * shape * (up.swing / np.abs(shape).max(axis=0))


def _turn_legs(planted: PlantedRobot, phase: str, start: FloatArray, way: tuple[FloatArray, ...]) -> None:
    motion = planted.motion().phase(phase)
    for before, after in pairwise((start, *way)):
        motion.move_joints(after, _turning_time(before, after))
    planted.play(motion)


def _turning_time(before: FloatArray, after: FloatArray) -> float:
    """[s]."""
    return max(_SHORTEST, float(np.abs(after - before).max()) / _RAISING_SPEED)
