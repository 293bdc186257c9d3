"""Step 2 of the paper: the sinusoidal excitation. Feet planted, the base oscillates about one axis at a time."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from equipoise.conventions import AXES, GRAVITY, Axis, FloatArray
from equipoise.errors import ReachError, SettingsError
from equipoise.experiments.planted import PlantedRobot
from equipoise.recording.recording import TRIAL, Recording
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.kinematics import (
    feet_and_forces,
    feet_under_base,
    inverse_kinematics,
)
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance

_KNOTS = 9
_RAMP_PERIODS = 1.5
_LAG_PERIODS = 0.5  # after the ramp, until the base follows steadily
_PERIODS = 6
_FEWEST_PERIODS = 1.2
_SETTLE_TIME = 0.3  # [s]
_PLANTED_STRIDE = 40  # samples between two looks at whether feet are planted
_LOAD_MARGIN = 0.2  # of a foot's static load must remain at the peak of a planned sway
_SLIP_RATIO = 0.02  # of the stance's length: feet whose distance changes by more have slipped or lifted


@dataclass(frozen=True)
class SwaySettings:
    """How the base sways.

    Attributes:
        amplitude: of the commanded rotation [rad].
        frequency: [Hz]; default 2 Hz on an A1, slower on larger robots.
        duration: of the steady part [s]; default six periods.
    """

    amplitude: float = 0.05
    frequency: float | None = None
    duration: float | None = None

    def __post_init__(self) -> None:
        for name, least, most in (("amplitude", 0.005, 0.5), ("frequency", 0.2, 10.0), ("duration", 0.1, 120.0)):
            value = getattr(self, name)
            if value is not None and not least <= value <= most:
                raise SettingsError(f"sway {name} is {value}; it must be from {least} to {most}")

    def duration_for(self, stance: Stance) -> float:
        """[s]; raises SettingsError if it is too short for a frequency."""
        frequency = self.frequency_for(stance)
        duration = self.duration or _PERIODS / frequency
        if duration * frequency < _FEWEST_PERIODS:
            raise SettingsError(
                f"a sway of {duration} s at {frequency:.2f} Hz is {duration * frequency:.1f} periods long; it takes "
                f"{_FEWEST_PERIODS} at least"
            )
        return duration

    def frequency_for(self, stance: Stance) -> float:
        """[Hz]."""
        return self.frequency or 2.0 / stance.scale.time


def sway_axis(planted: PlantedRobot, stance: Stance, axis: Axis, settings: SwaySettings) -> None:
    """Oscillate the base about one axis through the model's CoM, feet planted.

    If the feet move it is done again with half the amplitude. An axis that planted feet do not allow is skipped:
    `why_unreachable` tells why. The recordings have the phases "settle", "ramp", "sway" and "end".
    """
    if why_unreachable(planted.robot, stance, axis, settings) is not None:
        return
    amplitude = _amplitude_for(planted.robot, stance, axis, settings)
    recording = _play_sway(planted, stance, axis, amplitude, settings)
    if why_not_planted(planted.robot, recording) is not None:
        _play_sway(planted, stance, axis, amplitude / 2, settings)


def why_unreachable(robot: RobotModel, stance: Stance, axis: Axis, settings: SwaySettings) -> str | None:
    """Why planted feet do not allow a sway about an axis, or None if they do."""
    for feet in extreme_feet(robot, stance, axis, settings):
        try:
            inverse_kinematics(robot, feet, stance.joint_position)
        except ReachError as error:
            return str(error)
    return None


def extreme_feet(
    robot: RobotModel, stance: Stance, axis: Axis, settings: SwaySettings
) -> tuple[FloatArray, FloatArray]:
    """(4, 3) planted feet in the base frame, at either end of a sway [m]."""
    amplitude, feet_at = _amplitude_for(robot, stance, axis, settings), _feet_during_sway(robot, stance, axis)
    return feet_at(amplitude), feet_at(-amplitude)


def _feet_during_sway(robot: RobotModel, stance: Stance, axis: Axis) -> Callable[[float], FloatArray]:
    """(4, 3) planted feet in the base frame, with the base turned by an angle about the model's CoM."""
    pivot = composite_parameters(robot, stance.joint_position).com

    def feet_at(angle: float) -> FloatArray:
        rotation = axis_rotation(axis, angle)
        return feet_under_base(stance.feet_in_base, pivot - rotation @ pivot, rotation)

    return feet_at


def _play_sway(
    planted: PlantedRobot, stance: Stance, axis: Axis, amplitude: float, settings: SwaySettings
) -> Recording:
    frequency = settings.frequency_for(stance)
    duration = settings.duration_for(stance)
    ramp, lag = _RAMP_PERIODS / frequency, _LAG_PERIODS / frequency
    total = duration + lag + 2 * ramp
    time = np.arange(round(total / planted.platform.control_period)) * planted.platform.control_period
    envelope = np.clip(np.minimum(time, total - time) / ramp, 0, 1)
    angle = amplitude * envelope * np.sin(2 * np.pi * frequency * time)
    motion = planted.motion()
    motion.event(TRIAL, kind="sway", axis=axis, amplitude=amplitude, frequency=frequency)
    motion.phase("settle").move_feet(stance.feet_in_base, _SETTLE_TIME).hold(_SETTLE_TIME)
    begin = motion.time
    motion.phase("ramp").follow(_feet_during_sway(planted.robot, stance, axis), _KNOTS, angle)
    motion.phase_at("sway", begin + ramp + lag).phase_at("end", begin + ramp + lag + duration)
    planted.play(motion.move_feet(stance.feet_in_base, _SETTLE_TIME))
    return planted.finish()


def axis_rotation(axis: Axis, angle: float) -> FloatArray:
    """(3, 3) rotation about a base axis."""
    vector = np.zeros(3)
    vector[AXES.index(axis)] = angle
    return np.array(pin.exp3(vector))


def _amplitude_for(robot: RobotModel, stance: Stance, axis: Axis, settings: SwaySettings) -> float:
    """The amplitude asked for, or the largest at which every foot keeps a margin of its static load, by the model."""
    composite = composite_parameters(robot, stance.joint_position)
    feet = stance.feet_in_base[:, :2] - composite.com[:2]
    index = AXES.index(axis)
    if axis == "yaw":  # friction carries it: half the load's friction at the feet's distance from the CoM
        torque = 0.5 * 0.5 * composite.mass * GRAVITY * float(np.linalg.norm(feet, axis=1).mean())
    else:  # a torque T about an axis takes T / (4 arm) from each foot on one side
        arm = float(np.abs(feet[:, 1 - index]).mean())
        torque = (1 - _LOAD_MARGIN) * composite.mass * GRAVITY * arm
    largest = torque / (composite.inertia[index, index] * (2 * np.pi * settings.frequency_for(stance)) ** 2)
    return min(settings.amplitude, largest)


def why_not_planted(robot: RobotModel, recording: Recording) -> str | None:
    """What the sensors say against the feet having stayed where they were, or None.

    Feet that stay planted keep their distances from each other, and their loads, from the joint torques, stay positive.
    """
    steady = recording.phase("sway").joints
    torques = np.zeros_like(steady.position) if steady.torque is None else steady.torque
    feet, forces = feet_and_forces(robot, steady.position[::_PLANTED_STRIDE], torques[::_PLANTED_STRIDE])
    pairs = feet[:, :, None] - feet[:, None]
    spread = np.linalg.norm(pairs, axis=-1).std(axis=0).max()
    length = float(np.ptp(feet[0, :, 0]))
    if spread > _SLIP_RATIO * length:
        return f"the distances between the feet change by {spread * 1000:.1f} mm"
    if steady.torque is not None:
        loads = forces[:, :, 2]
        if loads.min() < 0.05 * loads.mean():
            return f"a foot carries only {loads.min():.1f} N of {loads.mean():.1f} N at the lightest"
    return None


# Sways about all axes at once: each axis has its own frequency, so that the dominant sinusoid of its angular velocity is its
# own; friction's direction then changes at many moments of the motion.
_ALL_AXES_FREQUENCIES = (2.3, 1.9, 1.5)  # [Hz] of roll, pitch and yaw on an A1
_ALL_AXES_AMPLITUDE = 0.04  # [rad]
_ALL_AXES_PERIODS = 8  # of the slowest
_KNOTS_PER_PERIOD = 12


def sway_all_axes(planted: PlantedRobot, stance: Stance, com: FloatArray) -> None:
    """Oscillate the base about all axes that planted feet allow, at once, through the CoM.

    The recording has the phases "settle", "ramp", "sway" and "end".

    Args:
        com: (3,) CoM in the base frame, as far as it is known [m].
    """
    robot = planted.robot
    settings = SwaySettings(amplitude=_ALL_AXES_AMPLITUDE)
    axes: list[Axis] = [axis for axis in AXES if why_unreachable(robot, stance, axis, settings) is None]
    if not axes:
        return
    frequencies: dict[Axis, float] = {
        axis: f / stance.scale.time for axis, f in zip(AXES, _ALL_AXES_FREQUENCIES, strict=True) if axis in axes
    }
    amplitudes = {
        axis: _amplitude_for(robot, stance, axis, replace(settings, frequency=frequency)) / np.sqrt(len(axes))
        for axis, frequency in frequencies.items()
    }
    slowest = min(frequencies.values())
    ramp, duration = _RAMP_PERIODS / slowest, _ALL_AXES_PERIODS / slowest
    total = duration + 2 * ramp

    def feet_at(time: float) -> FloatArray:
        envelope = float(np.clip(min(time, total - time) / ramp, 0, 1))
        rotation = np.eye(3)
        for axis, frequency in frequencies.items():
            angle = amplitudes[axis] * envelope * np.sin(2 * np.pi * frequency * time)
            rotation = rotation @ axis_rotation(axis, float(angle))
        return feet_under_base(stance.feet_in_base, com - rotation @ com, rotation)

    period = planted.platform.control_period
    time: FloatArray = np.arange(1.0, round(total / period) + 1) * period
    motion = planted.motion().event(TRIAL, kind="sway", axis="all", frequencies=frequencies)
    motion.phase("settle").move_feet(stance.feet_in_base, _SETTLE_TIME).hold(_SETTLE_TIME)
    begin = motion.time
    knots = math.ceil(_KNOTS_PER_PERIOD * total * max(frequencies.values()))
    motion.phase("ramp").follow(feet_at, knots, time)
    motion.phase_at("sway", begin + ramp).phase_at("end", begin + ramp + duration)
    planted.play(motion.move_feet(stance.feet_in_base, _SETTLE_TIME))
    planted.finish()


def sway_time(stance: Stance) -> float:
    """Robot time of `sway_all_axes` [s]."""
    slowest = min(_ALL_AXES_FREQUENCIES) / stance.scale.time
    return (_ALL_AXES_PERIODS + 2 * _RAMP_PERIODS) / slowest + 3 * _SETTLE_TIME
