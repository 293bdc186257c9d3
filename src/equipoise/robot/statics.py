"""Joint torques that hold a posture against gravity, with the feet on a level floor and any orientation of the base."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import pinocchio as pin

from equipoise.conventions import FloatArray
from equipoise.robot.floor import floor_normal_of
from equipoise.robot.kinematics import Kinematics, foot_forces_from_torques
from equipoise.robot.model import RobotModel

_UP = np.array([0.0, 0.0, 1.0])

PLAUSIBLE_LOAD = (0.4, 2.5)
"""Limits of the mass from joint torques, over the model's: payloads add half, friction and motor constants err by a fifth."""


def foot_forces(robot: RobotModel, joint_position: FloatArray, legs: Collection[str]) -> FloatArray:
    """Return (4, 3) forces of the ground on the feet of a robot at rest, in base axes [N].

    They are the smallest forces on the standing feet that carry the weight and its moment. Two feet cannot carry a moment
    about the line between them, which tips the robot.

    Args:
        joint_position: (nj,) joint positions [rad].
        legs: names of the legs that stand, of FL FR RL RR; none: the robot lies, and no foot carries anything.
    """
    kinematics = Kinematics(robot)
    return _forces_on(robot, kinematics.foot_positions(joint_position), kinematics.com(joint_position), legs)


def loads_on_feet(robot: RobotModel, joint_position: FloatArray) -> FloatArray:
    """Return (4,) loads on the four feet of a robot at rest, along the floor's normal [N].

    They are the smallest forces that carry the weight and its moment; statics does not determine the diagonals' shares.

    Args:
        joint_position: (nj,) joint positions [rad].
    """
    forces = foot_forces(robot, joint_position, robot.legs)
    carried = forces.sum(axis=0)
    return np.asarray(forces @ carried / np.linalg.norm(carried), dtype=float)


def _forces_on(robot: RobotModel, feet: FloatArray, com: FloatArray, legs: Collection[str]) -> FloatArray:
    standing = _indices(robot, legs)
    forces = np.zeros((4, 3))
    if not standing:
        return forces
    balance = np.zeros((6, 3 * len(standing)))
    for column, index in enumerate(standing):
        balance[:3, 3 * column : 3 * column + 3] = np.eye(3)
        balance[3:, 3 * column : 3 * column + 3] = pin.skew(feet[index] - com)
    weight = robot.mass * np.linalg.norm(robot.pinocchio.gravity.linear) * np.array(floor_normal_of(feet, standing))
    solution, *_ = np.linalg.lstsq(balance, np.concatenate([weight, np.zeros(3)]), rcond=1e-6)
    forces[standing] = solution.reshape(-1, 3)
    return forces


def _indices(robot: RobotModel, legs: Collection[str]) -> list[int]:
    return [index for index, leg in enumerate(robot.legs) if leg in legs]


def static_torques(robot: RobotModel, joint_position: FloatArray, legs: Collection[str]) -> FloatArray:
    """Return (nj,) joint torques that hold a robot at rest on some of its legs, or lying level on its belly on none [Nm]."""
    kinematics = Kinematics(robot)
    feet, jacobians = kinematics.feet_and_jacobians(joint_position)
    forces = _forces_on(robot, feet, kinematics.com(joint_position), legs)
    up = np.array(floor_normal_of(feet, _indices(robot, legs))) if legs else _UP
    weight = robot.mass * float(np.linalg.norm(robot.pinocchio.gravity.linear))
    torques = weight * up @ kinematics.com_jacobian(joint_position)
    torques[robot.leg_joints] -= (forces[:, None] @ jacobians)[:, 0]
    return torques


def torques_of_legs(robot: RobotModel, joint_position: FloatArray) -> FloatArray:
    """Return (nj,) joint torques that carry the legs of a robot with a fixed level base [Nm].

    Args:
        joint_position: (nj,) joint positions [rad].
    """
    configuration = robot.configuration(joint_position)
    return np.array(pin.computeGeneralizedGravity(robot.pinocchio, robot.create_data(), configuration)[6:])


def carried_mass(robot: RobotModel, joint_position: FloatArray, joint_torque: FloatArray) -> float:
    """Return the mass of a level robot at rest from its joint torques, with the legs' weight from the model [kg].

    Args:
        robot: the robot, on four feet.
        joint_position: (nj,) joint positions [rad].
        joint_torque: (nj,) joint torques [Nm].
    """
    of_legs = torques_of_legs(robot, joint_position)
    forces = foot_forces_from_torques(robot, joint_position, joint_torque - of_legs)
    return float(forces[:, 2].sum() / np.linalg.norm(robot.pinocchio.gravity.linear))
