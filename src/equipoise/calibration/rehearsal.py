"""Rehearsal of a calibration from the model alone: postures, joint ranges and static torques.

Motion and an unmodelled payload add to the torques predicted here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.json_form import to_json
from equipoise.method.method import Method
from equipoise.method.rehearsal import Course, RehearsedPosture, held_posture
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import lying_posture, nominal_stance

_AROUND = 12.0  # [s] on an A1: initial checks, standing up, lying down, damping


@dataclass(frozen=True, eq=False)
class Rehearsal:
    """Motions of a calibration, from the model alone.

    Attributes:
        robot: model of the robot.
        method: method of the calibration.
        course: motions between standing up and lying down.
        postures: postures in order; lying first, if the robot begins so.
        duration: robot time [s].
    """

    robot: RobotModel
    method: Method
    course: Course
    postures: tuple[RehearsedPosture, ...]
    duration: float

    @property
    def joint_range(self) -> FloatArray:
        """Lowest and highest joint positions (2, nj), with the lying posture [rad]."""
        positions = np.array([posture.joint_position for posture in self.postures])
        return np.array([positions.min(axis=0), positions.max(axis=0)])

    @property
    def largest_torque(self) -> FloatArray:
        """Largest absolute static joint torques (nj,) [Nm]."""
        return np.abs([posture.torque for posture in self.postures]).max(axis=0)

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        names, (lower, upper) = self.robot.joint_names, self.joint_range.tolist()
        torques, limits = self.largest_torque.tolist(), self.robot.effort_limit.tolist()
        rows = zip(names, lower, upper, torques, limits, strict=True)
        return {
            "robot": self.robot.name,
            "method": self.method.name,
            "duration": self.duration,
            "replans": self.course.replans,
            "joints": {
                name: {"from": low, "to": high, "torque": torque, "torque_limit": limit if np.isfinite(limit) else None}
                for name, low, high, torque, limit in rows
            },
            "postures": to_json(self.postures),
        }


def rehearse(robot: RobotModel, method: Method, standing: bool = False) -> Rehearsal:
    """Rehearse a calibration without a robot.

    Args:
        standing: true if the robot stands at the start and the end; it lies then only if the method lets it lie.

    Raises:
        SettingsError: a setting does not suit the robot.
        ReachError: a posture is out of reach.
    """
    stance = nominal_stance(robot)
    position, _ = lying_posture(robot, stance)
    lying = RehearsedPosture("lying", position, np.zeros_like(position))
    nominal = held_posture(robot, "nominal stance", stance.feet_in_base, stance.joint_position)
    course = method.rehearse(robot, stance)
    if not standing:
        postures = (lying, nominal, *course.postures)
        return Rehearsal(robot, method, course, postures, course.duration + _AROUND * stance.scale.time)
    postures = (nominal, *([lying] if course.lies else []), *course.postures)
    return Rehearsal(robot, method, course, postures, course.duration)
