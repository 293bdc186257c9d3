"""Postures with the CoM over the support line, and the torques that hold them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from equipoise.conventions import FloatArray
from equipoise.errors import ReachError
from equipoise.robot.description import LEG_NAMES
from equipoise.robot.kinematics import Kinematics, inverse_kinematics
from equipoise.robot.model import DIAGONALS, RobotModel

_UP = np.array([0.0, 0.0, 1.0])
_ITERATIONS = 20
_OVER_LINE = 1e-9  # [m]


@dataclass(frozen=True, eq=False)
class Posture:
    """Level posture at rest with the CoM over the support line and the base frame at the origin.

    Attributes:
        joint_position: (nj,) joint positions [rad].
        torque: (nj,) joint torques that hold the robot on the two feet [Nm].
        foot_force: (6,) ground forces on the right and left foot, with the least force along the line between them [N].
        com: (3,) centre of mass [m].
        middle: (3,) middle of the line between the two contact points [m].
        left: (3,) unit vector along the support line, to the robot's left.
        forward: (3,) its horizontal normal, left x up: a robot that turns about +left tips this way.
    """

    joint_position: FloatArray
    torque: FloatArray
    foot_force: FloatArray
    com: FloatArray
    middle: FloatArray
    left: FloatArray
    forward: FloatArray


def stance_legs(diagonal: str) -> tuple[str, str]:
    """Return the right and the left leg of a diagonal. `DIAGONALS` names the front leg first."""
    front, rear = DIAGONALS[diagonal]
    return (rear, front) if front == "FL" else (front, rear)


def line_through(right: FloatArray, left: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the unit vector along a support line to the left, and its horizontal normal, which points forward."""
    along = (left - right) / np.linalg.norm(left - right)
    x, y, _ = along
    return along, np.array([y, -x, 0.0]) / np.hypot(x, y)


def contact_jacobian(robot: RobotModel, configuration: FloatArray, legs: Sequence[str]) -> FloatArray:
    """Compute the (3 feet, nv) Jacobian of the contact points on a level floor, in world axes.

    Feet are spheres: v_contact = v + w x (-r e_z), so J = J_linear + [r e_z]x J_angular. A foot that rolls without
    slipping has J v = 0.
    """
    model, data = robot.pinocchio, robot.create_data()
    pin.computeJointJacobians(model, data, configuration)
    pin.updateFramePlacements(model, data)
    rows: list[FloatArray] = []
    for leg in legs:
        jacobian = pin.getFrameJacobian(model, data, robot.legs[leg].foot_frame_id, pin.LOCAL_WORLD_ALIGNED)
        rows.append(jacobian[:3] + pin.skew(robot.legs[leg].foot_radius * _UP) @ jacobian[3:])
    return np.concatenate(rows)


def generalized_gravity(robot: RobotModel, configuration: FloatArray) -> FloatArray:
    """Compute the (nv,) generalised force that compensates gravity [N, Nm]."""
    return np.array(pin.computeGeneralizedGravity(robot.pinocchio, robot.create_data(), configuration))


def posture_over_line(
    robot: RobotModel, feet: FloatArray, diagonal: str, swing_height: float, guess: FloatArray
) -> Posture:
    """Compute the level posture over given footholds with the CoM over the middle of the support line.

    Args:
        robot: design model of the robot.
        feet: (4, 3) centres of the feet on the floor, the third axis vertical, from any origin [m].
        swing_height: height of the other two feet above their footholds [m].
        guess: (nj,) joint positions to start from [rad].

    Raises:
        ReachError: the posture is out of the legs' reach.
    """
    right, left = stance_legs(diagonal)
    index = {leg: row for row, leg in enumerate(LEG_NAMES)}
    raised = np.array(feet)
    raised[[leg not in (right, left) for leg in LEG_NAMES], 2] += swing_height
    along, forward = line_through(raised[index[right]], raised[index[left]])
    kinematics, joints, miss = Kinematics(robot), guess, np.zeros(3)
    for _ in range(_ITERATIONS):
        joints = inverse_kinematics(robot, raised, joints)
        com = kinematics.com(joints)
        middle = (raised[index[right]] + raised[index[left]]) / 2
        miss = (com - middle) * [1.0, 1.0, 0.0]
        if np.linalg.norm(miss) < _OVER_LINE:
            break
        raised = raised + miss
    else:
        raise ReachError(
            f"no posture brings the centre of mass of {robot.name!r} over the line {diagonal}: it stays "
            f"{1000 * float(np.linalg.norm(miss)):.1f} mm off; check the model's centre of mass"
        )
    middle = kinematics.foot_positions(joints)[[index[right], index[left]]].mean(axis=0)
    middle = middle - np.mean([robot.legs[leg].foot_radius for leg in (right, left)]) * _UP
    torque, force = _holding(robot, joints, (right, left))
    return Posture(joints, torque, force, com, middle, along, forward)


def _holding(robot: RobotModel, joints: FloatArray, legs: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Compute joint torques and foot forces at rest: J_base^T f = g_base, tau = g_joints - J_joints^T f."""
    configuration = robot.configuration(joints)
    gravity = generalized_gravity(robot, configuration)
    jacobian = contact_jacobian(robot, configuration, legs)
    force, *_ = np.linalg.lstsq(jacobian[:, :6].T, gravity[:6], rcond=1e-9)
    return gravity[6:] - jacobian[:, 6:].T @ force, np.asarray(force, dtype=float)
