"""Foot positions, centre of mass, Jacobians and inverse kinematics, all in the base frame."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from equipoise.conventions import FloatArray
from equipoise.errors import ReachError
from equipoise.robot.model import RobotModel
from equipoise.thread_memory import ThreadMemory

# Feet may miss their target by this fraction of the leg length before a posture counts as out of reach: 0.4 mm on an A1.
REACH_TOLERANCE_RATIO = 1e-3
_MAX_ITERATIONS = 50
_CONVERGED = 1e-7  # [rad]; Newton steps square the error, so the next one would be far below it
_MAX_JOINT_STEP = 0.3  # [rad], keeps Newton steps where the linearisation holds


_memory = ThreadMemory(RobotModel.create_data)


class Kinematics:
    """Positions of the links, the feet and the CoM of a robot at given joint positions, in the base frame.

    Returned arrays belong to the caller. Creating Pinocchio's data takes longer than most computations: each thread keeps
    one per robot.

    Args:
        robot: the robot.
    """

    def __init__(self, robot: RobotModel) -> None:
        self._robot = robot

    @property
    def _data(self) -> pin.Data:
        return _memory.of(self._robot)

    def joint_poses(self, joint_position: FloatArray) -> list[pin.SE3]:
        """Return poses of the joints' frames in the base frame, by Pinocchio's joint id: 0 the world, 1 the base."""
        pin.forwardKinematics(self._robot.pinocchio, self._data, self._robot.configuration(joint_position))
        return [pin.SE3(pose) for pose in self._data.oMi]

    def foot_positions(self, joint_position: FloatArray) -> FloatArray:
        """Return the (4, 3) centres of the feet FL FR RL RR in the base frame [m]."""
        pin.forwardKinematics(self._robot.pinocchio, self._data, self._robot.configuration(joint_position))
        return self._feet()

    def feet_and_jacobians(self, joint_position: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return foot positions, and the derivative of each by its own leg's n joints, hip first.

        Returns:
            (4, 3) centres of the feet FL FR RL RR in the base frame [m] and (4, 3, n) in base axes [m/rad].
        """
        robot = self._robot
        columns = pin.computeJointJacobians(robot.pinocchio, self._data, robot.configuration(joint_position))
        feet = self._feet()
        # A column holds the velocity of its body at the origin, linear then angular, per joint speed: (6, 4, n).
        moved = columns[:, 6 + robot.leg_joints]
        turn_x, turn_y, turn_z = moved[3], moved[4], moved[5]
        x, y, z = feet.T[:, :, None]
        moved[0] += turn_y * z - turn_z * y
        moved[1] += turn_z * x - turn_x * z
        moved[2] += turn_x * y - turn_y * x
        return feet, moved[:3].transpose(1, 0, 2)

    def com(self, joint_position: FloatArray) -> FloatArray:
        """Return the (3,) centre of mass of the whole robot in the base frame [m]."""
        configuration = self._robot.configuration(joint_position)
        return np.array(pin.centerOfMass(self._robot.pinocchio, self._data, configuration))

    def com_jacobian(self, joint_position: FloatArray) -> FloatArray:
        """Return the (3, nj) derivative of the whole robot's CoM by the joints, in the base frame [m/rad]."""
        configuration = self._robot.configuration(joint_position)
        return np.array(pin.jacobianCenterOfMass(self._robot.pinocchio, self._data, configuration)[:, 6:])

    def _feet(self) -> FloatArray:
        """Return the foot positions of the last computed configuration."""
        model, data = self._robot.pinocchio, self._data
        return np.array([pin.updateFramePlacement(model, data, frame).translation for frame in self._robot.foot_frames])


def foot_positions(robot: RobotModel, joint_position: FloatArray) -> FloatArray:
    """Return the (4, 3) centres of the feet FL FR RL RR in the base frame [m]."""
    return Kinematics(robot).foot_positions(joint_position)


def foot_jacobians(robot: RobotModel, joint_position: FloatArray) -> FloatArray:
    """Return the (4, 3, n) derivative of each foot's position by its own leg's n joints, hip first, in base axes [m/rad]."""
    return Kinematics(robot).feet_and_jacobians(joint_position)[1]


def foot_forces_from_torques(robot: RobotModel, joint_position: FloatArray, joint_torque: FloatArray) -> FloatArray:
    """Return (4, 3) forces of the ground on the feet FL FR RL RR for massless legs [N], in base axes.

    Such a leg has tau = -J^T f, so f = -J^-T tau. On a leg of two joints the force has no component along their axes.

    Args:
        joint_position: (nj,) joint positions [rad].
        joint_torque: (nj,) joint torques [Nm].
    """
    return massless_leg_forces(foot_jacobians(robot, joint_position), joint_torque[robot.leg_joints])


def massless_leg_forces(jacobians: FloatArray, leg_torques: FloatArray) -> FloatArray:
    """Return (..., 4, 3) forces as `foot_forces_from_torques`, from (..., 4, 3, n) Jacobians and (..., 4, n) torques."""
    transposed, torques = np.swapaxes(jacobians, -1, -2), leg_torques[..., None]
    square = jacobians.shape[-1] == 3
    solved = np.linalg.solve(transposed, torques) if square else np.linalg.pinv(transposed) @ torques
    return np.asarray(-solved[..., 0], dtype=float)


def feet_and_forces(
    robot: RobotModel, joint_positions: FloatArray, joint_torques: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return (n, 4, 3) feet [m] and forces on them as `foot_forces_from_torques` [N], from (n, nj) samples."""
    kinematics = Kinematics(robot)
    pairs = (kinematics.feet_and_jacobians(position) for position in joint_positions)
    feet, jacobians = (np.array(part) for part in zip(*pairs, strict=True))
    return feet, massless_leg_forces(jacobians, joint_torques[:, robot.leg_joints])


def inverse_kinematics(
    robot: RobotModel, feet_in_base: FloatArray, start: FloatArray, tolerance: float | None = None
) -> FloatArray:
    """Return joint positions that bring the feet to their targets, within the joint limits.

    Damped Newton steps on each leg's Jacobian (differential inverse kinematics), clipped to the joint limits. A leg of
    two joints cannot reach every point; it comes as close as it can.

    Args:
        feet_in_base: (4, 3) wanted centres of the feet FL FR RL RR in the base frame [m].
        start: (nj,) joint positions to start from [rad]; they determine the bending side of the knees.
        tolerance: largest distance of a foot from its target [m]; default 0.1 % of the leg length.

    Returns:
        (nj,) joint positions [rad].

    Raises:
        ReachError: a foot misses its target by more than the tolerance; the message has leg and distance.
    """
    tolerance = REACH_TOLERANCE_RATIO * robot.leg_length if tolerance is None else tolerance
    position = inverse_kinematics_best_effort(robot, feet_in_base, start)
    misses = np.linalg.norm(foot_positions(robot, position) - feet_in_base, axis=1)
    worst = int(np.argmax(misses))
    if not misses[worst] <= tolerance:
        leg = list(robot.legs.values())[worst]
        at_limit = [
            robot.joint_names[j]
            for j in leg.joints
            if position[j] <= robot.lower_limit[j] + 1e-6 or position[j] >= robot.upper_limit[j] - 1e-6
        ]
        reason = f"joint {', '.join(at_limit)} is at its limit" if at_limit else "the leg is too short or lacks a joint"
        raise ReachError(
            f"the {leg.name} foot misses its place by {misses[worst] * 1000:.1f} mm "
            f"(allowed {tolerance * 1000:.1f} mm): {reason}"
        )
    return position


def inverse_kinematics_best_effort(robot: RobotModel, feet_in_base: FloatArray, start: FloatArray) -> FloatArray:
    """Return the nearest posture that `inverse_kinematics` finds, at any distance."""
    kinematics = Kinematics(robot)
    position = _within(start, robot.lower_limit, robot.upper_limit)
    joints = robot.leg_joints
    damping = (1e-4 * robot.leg_length) ** 2 * np.eye(joints.shape[1])
    for _ in range(_MAX_ITERATIONS):
        feet, jacobians = kinematics.feet_and_jacobians(position)
        errors = feet_in_base - feet
        transposed = jacobians.transpose(0, 2, 1)
        normal = transposed @ jacobians + damping
        steps = np.asarray(np.linalg.solve(normal, transposed @ errors[:, :, None])[:, :, 0], dtype=float)
        stepped = position.copy()
        stepped[joints] += _within(steps, -_MAX_JOINT_STEP, _MAX_JOINT_STEP)
        stepped = _within(stepped, robot.lower_limit, robot.upper_limit)
        moved = float(np.abs(stepped - position).max())
        position = stepped
        if moved < _CONVERGED:
            break
    return position


def _within(values: FloatArray, low: FloatArray | float, high: FloatArray | float) -> FloatArray:
    """Clip values; `numpy.clip` takes ten times as long for few numbers."""
    return np.minimum(np.maximum(values, low), high)


def feet_under_base(feet_in_base: FloatArray, translation: FloatArray, rotation: FloatArray) -> FloatArray:
    """Return the positions of standing feet in the base frame after the base has moved.

    Args:
        feet_in_base: (4, 3) foot positions in the base frame before the move [m].
        translation: (3,) translation of the base, in its axes before the move [m].
        rotation: (3, 3) rotation of the base: new axes in old ones, about the old origin moved by the translation.

    Returns:
        (4, 3) foot positions in the base frame after the move [m].
    """
    return (feet_in_base - translation) @ rotation
