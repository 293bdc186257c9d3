"""Leg kinematics of many samples at once.

The tests compare the results with Pinocchio's. A calibration evaluates a few thousand samples some hundred times, and one
call of Pinocchio per sample would be too slow.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from equipoise.conventions import FloatArray
from equipoise.estimator.measurements.traced import Traced, contract, cos, sin, stacked, turned
from equipoise.estimator.measurements.traced import cross as traced_cross
from equipoise.estimator.unknowns import TracedValues
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import nominal_stance
from equipoise.robot.tree import joint_axis

LEG_SHAPE = ("link_length", "link_length_common", "hip_position")
_SUM = "kl,il...->ik..."
_ON_AXIS = 1e-6  # of the leg length: a joint this near to the previous joint's axis counts as lying on it
_PARALLEL = 1e-6  # sine of the angle to an axis below which a direction counts as parallel


@dataclass(frozen=True, eq=False)
class LegMotion:
    """Motion of the feet in n samples, in base axes. Velocities are relative to the base's origin.

    Attributes:
        foot: (n, 4, 3) centres of the feet, in the base frame [m].
        foot_velocity: (n, 4, 3) velocity of the feet's centres, in base axes [m/s].
        foot_angular_velocity: (n, 4, 3) angular velocity of the links below the knees, in base axes [rad/s].
    """

    foot: FloatArray
    foot_velocity: FloatArray
    foot_angular_velocity: FloatArray


@dataclass(frozen=True, eq=False)
class TracedPosture:
    """Leg postures in an equation, components first and samples last, in base axes.

    Attributes:
        rotation: (3, 3, k, 4, n) rotation of each link.
        arm: (3, k, 4, n) vector from the joint above, or the base's origin, to each link's joint [m].
        lever: (3, k, 4, n) vector from a link's joint to its CoM [m].
        shank: (3, 4, n) vector from the last joint to the foot's centre [m].
        com: (3, k, 4, n) CoM of each link, in the base frame [m].
        foot: (3, 4, n) centres of the feet, in the base frame [m].
    """

    rotation: Traced
    arm: Traced
    lever: Traced
    shank: Traced
    com: Traced
    foot: Traced


@dataclass(frozen=True, eq=False)
class TracedLegMotion:
    """Leg motion in an equation, in base axes; velocities are relative to the base's origin.

    Attributes:
        com_velocity: (3, k, 4, n) velocity of each link's CoM [m/s].
        spin: (3, k, 4, n) angular momentum of each link about its own CoM [kg m2/s].
        angular_velocity: (3, k, 4, n) angular velocity of each link [rad/s].
        foot_velocity, foot_angular_velocity: (3, 4, n) as in `LegMotion`.
        bending: (3, n) sum of the angular velocities of all links relative to the ones above them [rad/s].
    """

    com_velocity: Traced
    spin: Traced
    angular_velocity: Traced
    foot_velocity: Traced
    foot_angular_velocity: Traced
    bending: Traced


@dataclass(frozen=True, eq=False)
class LegShape:
    """Differences of leg lengths and hip positions from the model's.

    Attributes:
        longer: (2, 4, n) lengths of thighs and calves minus the model's [m].
        hip: (3, 4, n) positions of the first joints minus the model's, in the base frame [m].
    """

    longer: Traced
    hip: Traced

    @classmethod
    def of(cls, legs: LegChains, values: TracedValues) -> LegShape:
        """Compute the differences from the parameters of LEG_SHAPE."""
        longer = values["link_length"][np.arange(8).reshape(4, 2).T] + values["link_length_common"][:, None]
        # Motions of all hips as one body are removed: a shift is one of the base frame, which the hips define, and a rotation
        # cannot be distinguished from leg lengths and joint offsets.
        apart = contract("ij,j...->i...", legs.hips_apart, values["hip_position"])
        return cls(longer, apart[np.arange(12).reshape(4, 3).T])


class LegChains:
    """The four legs of a robot as arrays: leg FL FR RL RR first, then link from the hip down.

    Attributes:
        robot: robot of the legs.
        joints: (4, k) indices of each leg's joints in the joint vector.
        by_kind: (nj, k) one where a joint is the first, second or further one of its leg, else zero.
        mass: (4, k) mass of each link and the bodies fixed to it, according to the model [kg].
        foot_radius: (4,) radius of each foot [m].
        axes: (4, k, 3, 3) directions in each link's frame, as columns: down the link to the next joint or foot, forward across
            the joint's axis, and along that axis. If the next joint lies on the axis, down is towards the one after it.
        reach: (4, k) distance across its axis from each joint to the next, or to the foot's centre, in the model [m].
        robot_mass: mass of the whole robot, according to the model [kg].
        hips_apart: (12, 12) projection of the first joints' displacements that removes common shifts and rotations.
    """

    def __init__(self, robot: RobotModel) -> None:
        self.robot, model, legs = robot, robot.pinocchio, list(robot.legs.values())
        ids = [leg.joint_ids for leg in legs]

        def by_link(value: Callable[[int], object]) -> FloatArray:
            return np.array([[value(joint) for joint in chain] for chain in ids])

        self.joints = np.array([leg.joints for leg in legs])
        self.robot_mass = robot.mass
        self.by_kind = np.zeros((len(robot.joint_names), self.joints.shape[1]))
        self.by_kind[self.joints, np.arange(self.joints.shape[1])] = 1.0
        self.mass = by_link(lambda joint: model.inertias[joint].mass)
        self.foot_radius = np.array([leg.foot_radius for leg in legs])
        placed = by_link(lambda joint: model.jointPlacements[joint].rotation)
        axis = by_link(lambda joint: joint_axis(model, joint))
        about = cross_matrix(axis)
        # A link in the one above it, at angle a (Rodrigues' formula): upright + sin(a) sideways - cos(a) across.
        sideways, across = placed @ about, placed @ about @ about
        self._upright, self._sideways, self._across = map(_first, (placed + across, sideways, across))
        self._placement = _first(by_link(lambda joint: model.jointPlacements[joint].translation))
        self._axis = _first(axis)
        self._lever = _first(by_link(lambda joint: model.inertias[joint].lever))
        self._inertia = _first(by_link(lambda joint: model.inertias[joint].inertia))
        self.axes, self.reach = _axes_of_links(robot, axis)
        self.hips_apart = _no_rigid_motion(self._placement[:, 0, :, 0].T)
        self._down_to = np.tril(np.ones((self.joints.shape[1],) * 2))  # sums over a link and all above it
        self._foot = np.array([model.frames[leg.foot_frame_id].placement.translation for leg in legs]).T[..., None]

    @cached_property
    def level_directions(self) -> FloatArray:
        """Unit vectors (3, 2, 4, 1) across and along each leg, level in the nominal stance, in the lowest link's frame."""
        position = nominal_stance(self.robot).joint_position
        rotation = self.traced_posture(Traced(position[:, None])).rotation.value[:, :, -1, :, 0]
        up, across = rotation[2], self.axes[:, -1, :, 2].T  # the base is level
        across = across - up * (up * across).sum(axis=0)
        across = across / np.linalg.norm(across, axis=0)
        return np.stack([across, np.cross(across, up, axis=0)], axis=1)[..., None]

    @cached_property
    def middle_of_feet(self) -> FloatArray:
        """Mean (3, 1) of the feet's centres at the nominal stance, in the base frame [m]."""
        return nominal_stance(self.robot).feet_in_base.mean(axis=0)[:, None]

    @cached_property
    def end_of_trunk(self) -> FloatArray:
        """Point (3, 1) of the base above the rear feet of the nominal stance, in the base frame [m]."""
        return np.array([[nominal_stance(self.robot).feet_in_base[2:, 0].mean()], [0.0], [0.0]])

    @property
    def links(self) -> int:
        """Number of leg links of the robot."""
        return self.mass.size

    def feet(self, joint_position: FloatArray) -> FloatArray:
        """Return the (n, 4, 3) centres of the feet in the base frame [m], at (n, nj) joint positions [rad]."""
        return self.traced_posture(Traced(np.ascontiguousarray(joint_position.T))).foot.value.T

    def motion(
        self, joint_position: FloatArray, joint_velocity: FloatArray, angular_velocity_in_base: FloatArray
    ) -> LegMotion:
        """Compute the motion of the feet in n samples, by the recursion of velocities along each leg.

        Args:
            joint_position: (n, nj) joint positions [rad].
            joint_velocity: (n, nj) joint velocities [rad/s].
            angular_velocity_in_base: (n, 3) angular velocity of the base, in its own axes [rad/s].
        """
        position, velocity, turning = (
            Traced(np.ascontiguousarray(part.T)) for part in (joint_position, joint_velocity, angular_velocity_in_base)
        )
        posture = self.traced_posture(position)
        moving = self.traced_motion(posture, velocity, turning)
        velocities = moving.foot_velocity, moving.foot_angular_velocity
        return LegMotion(posture.foot.value.T, *(part.value.T for part in velocities))

    def traced_posture(self, joint_position: Traced, shape: LegShape | None = None) -> TracedPosture:
        """Return the leg postures at (nj, n) joint positions; by default with the model's shape."""
        # Tiled: products with a broadcast view take seven times as long.
        above = Traced(np.tile(np.eye(3)[..., None, None], (4, joint_position.value.shape[1])))
        arms: list[Traced] = []
        rotations: list[Traced] = []
        for link, joints in enumerate(self.joints.T):
            arms.append(turned(above, self._placement[:, link]))
            if shape is not None:
                arms[-1] = arms[-1] + (self._longer(above, link - 1, shape) if link else shape.hip)
            above = self._below(above, link, joint_position[joints])
            rotations.append(above)
        arm, rotation = stacked(arms, axis=1), stacked(rotations, axis=2)
        shank = turned(above, self._foot)
        if shape is not None:
            shank = shank + self._longer(above, -1, shape)
        lever, joint = turned(rotation, self._lever), contract(_SUM, self._down_to, arm)
        return TracedPosture(rotation, arm, lever, shank, joint + lever, joint[:, -1] + shank)

    def traced_motion(
        self, posture: TracedPosture, joint_velocity: Traced, angular_velocity_in_base: Traced
    ) -> TracedLegMotion:
        """Return the leg motion at (nj, n) joint velocities and (3, n) angular velocities of the base in its own axes."""
        own = turned(posture.rotation, self._axis) * joint_velocity[self.joints.T]
        below = angular_velocity_in_base[:, None, None] + contract(_SUM, self._down_to, own)
        of_joint = contract(_SUM, self._down_to, traced_cross(below - own, posture.arm))
        in_link = contract("ji...,j...->i...", posture.rotation, below)
        return TracedLegMotion(
            of_joint + traced_cross(below, posture.lever),
            turned(posture.rotation, turned(self._inertia, in_link)),
            below,
            of_joint[:, -1] + traced_cross(below[:, -1], posture.shank),
            below[:, -1],
            contract("ikl...,kl->i...", own, np.ones(self.joints.T.shape)),
        )

    def _longer(self, rotation: Traced, link: int, shape: LegShape) -> Traced | float:
        """Return the (3, 4, n) extension of a link beyond the model's; zero for hips, the first of three links."""
        number = link % self.joints.shape[1] - (self.joints.shape[1] - 2)
        down = np.moveaxis(self.axes[:, link, :, 0], 0, -1)[..., None]
        return turned(rotation, down) * shape.longer[number] if number >= 0 else 0.0

    def _below(self, rotation: Traced, link: int, angle: Traced) -> Traced:
        """Return (3, 3, 4, n) rotations of links below joints, from those above and (4, n) joint positions."""
        in_parent = (
            self._upright[:, :, link] + sin(angle) * self._sideways[:, :, link] - cos(angle) * self._across[:, :, link]
        )
        return contract("ij...,jk...->ik...", rotation, in_parent)


def _no_rigid_motion(places: FloatArray) -> FloatArray:
    """Return the (3 n, 3 n) projection that removes rigid-body motions from displacements of (n, 3) points."""
    turns = -cross_matrix(places - places.mean(axis=0)).reshape(-1, 3)
    rigid = np.hstack([np.tile(np.eye(3), (len(places), 1)), turns])
    return np.eye(places.size) - rigid @ np.linalg.pinv(rigid)


def _axes_of_links(robot: RobotModel, joint_axes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Compute (4, k, 3, 3) `LegChains.axes` and (4, k) `reach`, from (4, k, 3) joint axes in the links' frames."""
    model = robot.pinocchio
    down = np.zeros_like(joint_axes)
    reach = np.zeros(joint_axes.shape[:2])
    for number, leg in enumerate(robot.legs.values()):
        foot = pin.SE3(np.eye(3), np.array(model.frames[leg.foot_frame_id].placement.translation))
        below = [*(model.jointPlacements[joint] for joint in leg.joint_ids[1:]), foot]  # placement of each link's end
        further = joint_axes[number, -1]  # direction beyond the end of a link, in that link's frame
        for link in reversed(range(len(below))):
            axis, end = joint_axes[number, link], np.array(below[link].translation)
            reach[number, link] = np.linalg.norm(np.cross(axis, end))
            on_axis = reach[number, link] < _ON_AXIS * robot.leg_length
            further = _across(axis, below[link].rotation @ further if on_axis else end)
            down[number, link] = further
    return np.stack([down, np.cross(joint_axes, down), joint_axes], axis=-1), reach


def _across(axis: FloatArray, direction: FloatArray) -> FloatArray:
    """Compute the unit vector across an axis that is nearest to a direction; an arbitrary one if both are parallel."""
    across = direction - (direction @ axis) * axis
    if not np.linalg.norm(across) > _PARALLEL * np.linalg.norm(direction):
        unit = np.eye(3)[int(np.argmin(np.abs(axis)))]
        across = unit - (unit @ axis) * axis
    return np.asarray(across / np.linalg.norm(across), dtype=float)


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the cross product along the last axis; several times faster than numpy's on such arrays."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def cross_matrix(vector: FloatArray) -> FloatArray:
    """Return (..., 3, 3) matrices whose product with b is the cross product of (..., 3) vectors with b."""
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    zero = np.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _first(by_link: FloatArray) -> FloatArray:
    """Rearrange (4, k, ...) arrays to (..., k, 4, 1), components first."""
    return np.ascontiguousarray(np.moveaxis(by_link, (1, 0), (-2, -1))[..., None])
