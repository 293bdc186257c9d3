"""Excitation about all axes at once, which determines friction and the inertia about the vertical."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from equipoise.conventions import AXES, Axis, FloatArray
from equipoise.experiments.excitation import (
    RAMP_PERIODS,
    SETTLE_TIME,
    amplitude_for,
    axis_rotation,
    why_unreachable,
)
from equipoise.experiments.excitation_settings import ExcitationSettings
from equipoise.experiments.standing_robot import StandingRobot
from equipoise.recording.phases import Phase
from equipoise.recording.trials import ExcitationTrial
from equipoise.robot.kinematics import feet_under_base
from equipoise.robot.stance import Stance

# Each axis has its own frequency, so that its angular velocity has a distinct dominant sinusoid.
# The direction of friction then changes often during the motion.
_ALL_AXES_FREQUENCIES = (2.3, 1.9, 1.5)  # [Hz] of roll, pitch and yaw on an A1
ALL_AXES_SETTINGS = ExcitationSettings(amplitude=0.04)
"""Settings of the excitation about all axes at once; each axis has its own frequency."""
_ALL_AXES_PERIODS = 8  # of the slowest
_KNOTS_PER_PERIOD = 12


def excitation_all_axes(standing: StandingRobot, stance: Stance, com: FloatArray) -> None:
    """Oscillate the base through the CoM, at once about all axes that the feet on the floor allow.

    The recording has the phases "settle", "ramp", "excitation" and "end".

    Args:
        com: (3,) current estimate of the CoM in the base frame [m].
    """
    robot = standing.robot
    axes: list[Axis] = [axis for axis in AXES if why_unreachable(robot, stance, axis, ALL_AXES_SETTINGS) is None]
    if not axes:
        return
    frequencies: dict[Axis, float] = {
        axis: f / stance.scale.time for axis, f in zip(AXES, _ALL_AXES_FREQUENCIES, strict=True) if axis in axes
    }
    amplitudes = {
        axis: amplitude_for(robot, stance, axis, replace(ALL_AXES_SETTINGS, frequency=frequency)) / np.sqrt(len(axes))
        for axis, frequency in frequencies.items()
    }
    slowest = min(frequencies.values())
    ramp, duration = RAMP_PERIODS / slowest, _ALL_AXES_PERIODS / slowest
    total = duration + 2 * ramp

    def feet_at(time: float) -> FloatArray:
        envelope = float(np.clip(min(time, total - time) / ramp, 0, 1))
        rotation = np.eye(3)
        for axis, frequency in frequencies.items():
            angle = amplitudes[axis] * envelope * np.sin(2 * np.pi * frequency * time)
            rotation = rotation @ axis_rotation(axis, float(angle))
        return feet_under_base(stance.feet_in_base, com - rotation @ com, rotation)

    period = standing.platform.control_period
    time: FloatArray = np.arange(1.0, round(total / period) + 1) * period
    motion = standing.motion().begin(ExcitationTrial(frequencies=frequencies))
    motion.phase(Phase.SETTLE).move_feet(stance.feet_in_base, SETTLE_TIME).hold(SETTLE_TIME)
    begin = motion.time
    knots = math.ceil(_KNOTS_PER_PERIOD * total * max(frequencies.values()))
    motion.phase(Phase.RAMP).follow(feet_at, knots, time)
    motion.phase_at(Phase.EXCITATION, begin + ramp).phase_at(Phase.END, begin + ramp + duration)
    standing.play(motion.move_feet(stance.feet_in_base, SETTLE_TIME))
    standing.finish()


def excitation_time(stance: Stance) -> float:
    """Return the robot time of `excitation_all_axes` [s]."""
    slowest = min(_ALL_AXES_FREQUENCIES) / stance.scale.time
    return (_ALL_AXES_PERIODS + 2 * RAMP_PERIODS) / slowest + 3 * SETTLE_TIME
