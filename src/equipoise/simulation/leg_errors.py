"""Differences of a simulated robot's legs from the model's: drawn effects in the axes of their links."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from equipoise.conventions import FloatArray
from equipoise.robot.inertial import InertialParameters
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance
from equipoise.simulation.drawn_errors import DrawnErrors

_MOST_WORN = 0.5  # fraction of a foot's radius
_PARALLEL = 0.9  # cosine beyond which a link points forward, and "across" begins with up


@dataclass(frozen=True, eq=False)
class LegErrors:
    """Shifts in a leg, in the axes of the link that they belong to; along a link is towards the next joint or the foot.

    Attributes:
        com_shift: (nj, 3) shift of the CoM of the link that each joint moves, in that link's axes [m].
        end_shift: (nj, 3) shift of the next joint or of the foot on that link, in that link's axes [m].
        hip_shift: (4, 3) shift of the first joints of the legs FL FR RL RR, in base axes [m].
        foot_radius: (4,) radii of the feet FL FR RL RR, less the model's [m].
        axis_turn: (nj, 3) rotation vectors of the joints' axes, in the axes of the link that each moves [rad].
    """

    com_shift: FloatArray
    end_shift: FloatArray
    hip_shift: FloatArray
    foot_radius: FloatArray
    axis_turn: FloatArray

    @classmethod
    def of(cls, robot: RobotModel, stance: Stance, errors: DrawnErrors) -> LegErrors:
        """Return the drawn errors of a robot's legs."""
        drawn, joints = errors.drawn, len(robot.joint_names)
        com, end, turn = (np.zeros((joints, 3)) for _ in range(3))
        per_leg = joints // 4
        com_each, turn_each = drawn["leg_com"].reshape(joints, 3), drawn["joint_axes"].reshape(joints, 2)
        com_kind, length_kind = drawn["leg_com_common"].reshape(per_leg, 3), drawn["leg_length_common"]
        foot_each = drawn["foot_position"].reshape(4, 3)
        for index, (joint, kind, axes, axis) in enumerate(_links(robot, stance)):
            com[joint] = axes @ (com_each[joint] + com_kind[kind])
            if kind >= per_leg - 2:  # a hip's length is in its position
                end[joint] = axes[:, 0] * (drawn["leg_length"][joint] + length_kind[kind])
            if kind == per_leg - 1:
                end[joint] += axes @ foot_each[index // per_leg]
            turn[joint] = _across(axis) @ turn_each[joint]
        radii = np.array([leg.foot_radius for leg in robot.legs.values()])
        worn = np.maximum(drawn["foot_radius"], -_MOST_WORN * radii)
        return cls(com, end, errors.hip_position, worn, turn)


def in_frame_of_hips(body: InertialParameters, errors: DrawnErrors) -> InertialParameters:
    """Return a body in the base frame whose origin the mean position of the hips defines.

    Encoders measure foot positions relative to the hips, and users of a CoM place the hips as in the model file.
    A common shift of all hips therefore is a shift of the base frame.
    The axes keep the base link's directions. Hip positions determine directions poorly: an A1's hips are 94 mm apart, so
    0.7 mm of height error of each hip would roll the frame by 7 mrad.

    Args:
        body: body in the frame of the base link.
        errors: drawn errors, which include the hip positions less the model's.
    """
    return InertialParameters(body.mass, body.com - errors.hip_position.mean(axis=0), body.inertia)


def _links(robot: RobotModel, stance: Stance) -> list[tuple[int, int, FloatArray, FloatArray]]:
    """Return for each leg link its joint and index in the leg, and directions (3, 3) and joint axis in its own axes.

    Columns: along it; across it, forward if it hangs; across it, inward if it hangs. Those of a right leg are
    the mirrored left one's, so that what all have in common is symmetric.
    """
    data = robot.create_data()
    q = robot.configuration(stance.joint_position)
    pin.framesForwardKinematics(robot.pinocchio, data, q)
    found: list[tuple[int, int, FloatArray, FloatArray]] = []
    for leg, foot in zip(robot.legs.values(), stance.feet_in_base, strict=True):
        ids = [robot.pinocchio.getJointId(name) for name in leg.joint_names]
        places = [np.array(data.oMi[index].translation) for index in ids]
        ends = [*places[1:], np.array(data.oMf[leg.foot_frame_id].translation)]
        for kind, (joint, index) in enumerate(zip(leg.joints, ids, strict=True)):
            side = 1.0 if foot[1] > 0 else -1.0
            in_base = _directions(ends[kind] - places[kind], side)
            axis = pin.computeJointJacobian(robot.pinocchio, data, q, index)[3:, 6 + joint]
            found.append((int(joint), kind, np.array(data.oMi[index].rotation).T @ in_base, np.array(axis)))
    return found


def _directions(along: FloatArray, side: float) -> FloatArray:
    """Return (3, 3) columns: along, forward across, and the third, mirrored on the other side."""
    length = np.linalg.norm(along)
    first = along / length if length > 1e-6 else np.array([0.0, side, 0.0])
    forward = np.array([1.0, 0, 0]) if abs(first[0]) < _PARALLEL else np.array([0.0, 0, 1])
    third = _unit_normal(first, forward)
    return np.column_stack([first, _unit_normal(third, first), side * third])


def _across(axis: FloatArray) -> FloatArray:
    """Return (3, 2) two directions across an axis; zero for a prismatic joint."""
    if not axis.any():
        return np.zeros((3, 2))
    first = _unit_normal(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    return np.column_stack([first, _unit_normal(axis, first)])


def _unit_normal(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return the (3,) unit vector perpendicular to two others, right-handed."""
    normal = np.asarray(np.cross(one, other), dtype=np.float64)
    return np.asarray(normal / np.linalg.norm(normal), dtype=np.float64)
