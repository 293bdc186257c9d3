"""Amplitudes and postures of excitations of the base with all feet on the floor."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

from equipoise.conventions import AXES, GRAVITY, Axis, FloatArray
from equipoise.errors import ReachError
from equipoise.experiments.excitation_settings import ExcitationSettings
from equipoise.experiments.posture import check_clear
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.kinematics import feet_under_base, inverse_kinematics
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance

RAMP_PERIODS = 1.5
"""Number of periods in which an excitation grows, and in which it fades."""
SETTLE_TIME = 0.3
"""Pause before and after an excitation [s]."""
_LOAD_MARGIN = 0.2  # fraction of a foot's static load that must remain at the peak of a planned excitation


def why_unreachable(robot: RobotModel, stance: Stance, axis: Axis, settings: ExcitationSettings) -> str | None:
    """Return the reason why an excitation about an axis is out of reach, or None if it is within reach."""
    for feet in extreme_feet(robot, stance, axis, settings):
        try:
            check_clear(robot, inverse_kinematics(robot, feet, stance.joint_position))
        except ReachError as error:
            return str(error)
    return None


def extreme_feet(
    robot: RobotModel, stance: Stance, axis: Axis, settings: ExcitationSettings
) -> tuple[FloatArray, FloatArray]:
    """Return the (4, 3) feet in the base frame at either end of an excitation [m]."""
    amplitude, feet_at = amplitude_for(robot, stance, axis, settings), feet_during_excitation(robot, stance, axis)
    return feet_at(amplitude), feet_at(-amplitude)


def feet_during_excitation(robot: RobotModel, stance: Stance, axis: Axis) -> Callable[[float], FloatArray]:
    """Return a function from the base's rotation about the model's CoM [rad] to the (4, 3) feet in the base frame [m]."""
    pivot = composite_parameters(robot, stance.joint_position).com

    def feet_at(angle: float) -> FloatArray:
        rotation = axis_rotation(axis, angle)
        return feet_under_base(stance.feet_in_base, pivot - rotation @ pivot, rotation)

    return feet_at


def axis_rotation(axis: Axis, angle: float) -> FloatArray:
    """Return the (3, 3) rotation about a base axis."""
    vector = np.zeros(3)
    vector[AXES.index(axis)] = angle
    return np.array(pin.exp3(vector))


def amplitude_for(robot: RobotModel, stance: Stance, axis: Axis, settings: ExcitationSettings) -> float:
    """Return the requested amplitude, limited by the static load of the feet or, for yaw, by floor friction [rad]."""
    composite = composite_parameters(robot, stance.joint_position)
    feet = stance.feet_in_base[:, :2] - composite.com[:2]
    index = AXES.index(axis)
    if axis == "yaw":  # friction provides the torque: half of the available friction, with a coefficient of 0.5
        torque = 0.5 * 0.5 * composite.mass * GRAVITY * float(np.linalg.norm(feet, axis=1).mean())
    else:  # a torque T about an axis takes T / (4 arm) from each foot on one side
        arm = float(np.abs(feet[:, 1 - index]).mean())
        torque = (1 - _LOAD_MARGIN) * composite.mass * GRAVITY * arm
    largest = torque / (composite.inertia[index, index] * (2 * np.pi * settings.frequency_for(stance)) ** 2)
    return min(settings.amplitude, largest)
