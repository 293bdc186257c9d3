"""How the legs of a robot move, for many samples at once.

The same quantities as Pinocchio's, which the tests hold them against: a calibration evaluates a few thousand samples some
hundred times, which a call per sample cannot do in the time that people wait.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from equipoise.alive import alive
from equipoise.conventions import FloatArray
from equipoise.robot.model import RobotModel
from equipoise.robot.tree import joint_axis


@dataclass(frozen=True, eq=False)
class LegMotion:
    """Links and feet of n samples, in base axes about the base's origin. Velocities lack the base origin's own.

    Attributes:
        com: (n, 4, k, 3) CoM of each of the k links of each leg, in the base frame [m].
        com_velocity: (n, 4, k, 3) velocity of that CoM, in base axes [m/s].
        spin: (n, 4, k, 3) angular momentum of each link about its own CoM, in base axes [kg m2/s].
        foot: (n, 4, 3) centres of the feet, in the base frame [m].
        foot_velocity: (n, 4, 3) velocity of these centres, in base axes [m/s].
        foot_angular_velocity: (n, 4, 3) angular velocity of the links below the knees, in base axes [rad/s].
    """

    com: FloatArray
    com_velocity: FloatArray
    spin: FloatArray
    foot: FloatArray
    foot_velocity: FloatArray
    foot_angular_velocity: FloatArray


class LegChains:
    """The four legs of a robot as arrays: leg FL FR RL RR first, then link from the hip down.

    Attributes:
        joints: (4, k) indices of each leg's joints in the joint vector.
        mass: (4, k) mass of each link, with all that is fixed to it, by the model [kg].
        foot_radius: (4,) radius of each foot [m].
    """

    def __init__(self, robot: RobotModel) -> None:
        model, legs = robot.pinocchio, list(robot.legs.values())
        ids = [leg.joint_ids for leg in legs]

        def by_link(value: Callable[[int], object]) -> FloatArray:
            return np.array([[value(joint) for joint in chain] for chain in ids])

        self.joints = np.array([leg.joints for leg in legs])
        self.mass = by_link(lambda joint: model.inertias[joint].mass)
        self.foot_radius = np.array([leg.foot_radius for leg in legs])
        self._placement_rotation = by_link(lambda joint: model.jointPlacements[joint].rotation)
        self._placement_translation = by_link(lambda joint: model.jointPlacements[joint].translation)
        self._axis = by_link(lambda joint: joint_axis(model, joint))
        self._lever = by_link(lambda joint: model.inertias[joint].lever)
        self._inertia = by_link(lambda joint: model.inertias[joint].inertia)
        self._foot = np.array([model.frames[leg.foot_frame_id].placement.translation for leg in legs])
        self._axis_cross = cross_matrix(self._axis)
        self._axis_cross_squared = self._axis_cross @ self._axis_cross

    @property
    def links(self) -> int:
        """Number of leg links of the robot."""
        return self.mass.size

    def feet(self, joint_position: FloatArray) -> FloatArray:
        """(n, 4, 3) centres of the feet in the base frame, of (n, nj) joint positions [m]."""
        return self.motion(joint_position, np.zeros_like(joint_position), np.zeros((len(joint_position), 3))).foot

    def motion(
        self, joint_position: FloatArray, joint_velocity: FloatArray, angular_velocity_in_base: FloatArray
    ) -> LegMotion:
        """Links and feet of n samples, by the recursion of velocities along each leg.

        Args:
            joint_position: (n, nj) joint positions [rad].
            joint_velocity: (n, nj) joint velocities [rad/s].
            angular_velocity_in_base: (n, 3) angular velocity of the base, in its own axes [rad/s].
        """
        alive()
        count, links = len(joint_position), self.joints.shape[1]
        rotation = np.broadcast_to(np.eye(3), (count, 4, 3, 3))
        position, velocity = np.zeros((count, 4, 3)), np.zeros((count, 4, 3))
        angular_velocity = np.broadcast_to(angular_velocity_in_base[:, None], (count, 4, 3))
        com, com_velocity, spin = (np.empty((count, 4, links, 3)) for _ in range(3))
        for link in range(links):
            arm = _turned(rotation, self._placement_translation[:, link])
            position = position + arm
            velocity = velocity + cross(angular_velocity, arm)
            angle = joint_position[:, self.joints[:, link], None, None]
            about_axis = (  # Rodrigues' formula
                np.eye(3)
                + np.sin(angle) * self._axis_cross[:, link]
                + (1 - np.cos(angle)) * self._axis_cross_squared[:, link]
            )
            rotation = rotation @ (self._placement_rotation[:, link] @ about_axis)
            angular_velocity = (
                angular_velocity
                + _turned(rotation, self._axis[:, link]) * joint_velocity[:, self.joints[:, link], None]
            )
            lever = _turned(rotation, self._lever[:, link])
            com[:, :, link] = position + lever
            com_velocity[:, :, link] = velocity + cross(angular_velocity, lever)
            in_link = np.swapaxes(rotation, -1, -2) @ angular_velocity[..., None]
            spin[:, :, link] = (rotation @ (self._inertia[:, link] @ in_link))[..., 0]
        arm = _turned(rotation, self._foot)
        return LegMotion(
            com, com_velocity, spin, position + arm, velocity + cross(angular_velocity, arm), angular_velocity
        )


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross product along the last axis; several times faster than numpy's on such arrays."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def cross_matrix(vector: FloatArray) -> FloatArray:
    """(..., 3, 3) matrices whose product with b is the cross product of (..., 3) vectors with b."""
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    zero = np.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _turned(rotation: FloatArray, vectors: FloatArray) -> FloatArray:
    return (rotation @ vectors[..., None])[..., 0]
