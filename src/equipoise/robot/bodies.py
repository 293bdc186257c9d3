"""Rigid bodies of a robot, and the links of the file that compose them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.robot.inertial import InertialParameters
from equipoise.robot.legs import Leg
from equipoise.robot.links import file_links, link_names, radius_of_gyration_of
from equipoise.robot.model import RobotModel

# A hip's two joints can be 14 mm apart (Solo) and its motors are far larger: no leg link counts as smaller than this
# fraction of the leg length.
_SMALLEST_EXTENT_RATIO = 0.25


@dataclass(frozen=True, eq=False)
class RigidBody:
    """Rigid body: the base or a leg link, with all links fixed to it.

    Attributes:
        name: name of its link.
        mass: mass [kg].
        com_in_link: (3,) centre of mass in the link's own frame (base: base frame) [m].
        principal_moments: (3,) principal moments of inertia about the CoM, ascending [kg m2].
        extent: approximate length, from its joint to the next one or the foot, or from hip to opposite hip [m].
    """

    COMPUTED: ClassVar = ("radius_of_gyration",)
    name: str
    mass: float
    com_in_link: FloatArray
    principal_moments: FloatArray
    extent: float

    def __post_init__(self) -> None:
        self.com_in_link.setflags(write=False)
        self.principal_moments.setflags(write=False)

    @property
    def radius_of_gyration(self) -> float:
        """Root mean square distance of its mass from its CoM, sqrt(tr(I) / 2m) [m]; 0 without mass."""
        return radius_of_gyration_of(self.mass, self.principal_moments)


@dataclass(frozen=True, eq=False)
class LinkInertial:
    """Link of the file that has mass, and its rigid body."""

    name: str
    body: RigidBody
    parameters: InertialParameters

    @property
    def mass_share(self) -> float:
        """Fraction of its body's mass."""
        return self.parameters.mass / self.body.mass if self.body.mass > 0 else 1.0

    @property
    def inertia_share(self) -> float:
        """Fraction of its body's moments, each about its own CoM."""
        total = float(self.body.principal_moments.sum())
        return float(np.trace(self.parameters.inertia)) / total if total > 0 else 1.0


def bodies_of(robot: RobotModel) -> dict[int, RigidBody]:
    """Return the base and the leg links, by Pinocchio joint."""
    ends = {joint: end for leg in robot.legs.values() for joint, end in link_ends(robot, leg).items()}
    return {joint: _body(robot, joint, ends) for joint in range(1, robot.pinocchio.njoints)}


def _body(robot: RobotModel, joint: int, ends: dict[int, FloatArray]) -> RigidBody:
    inertia = robot.pinocchio.inertias[joint]
    com = np.array(inertia.lever)
    if joint == 1:
        name, extent = robot.base_link, _hip_diagonal(robot)
    else:
        name = link_names(robot.full_pinocchio)[robot.full_pinocchio.getJointId(robot.pinocchio.names[joint])]
        # Mass is balanced about the CoM, so a body reaches about as far past it as its joint is before it.
        reach = 2 * float(np.linalg.norm(com))
        extent = max(float(np.linalg.norm(ends[joint])), reach, _SMALLEST_EXTENT_RATIO * robot.leg_length)
    return RigidBody(
        name, float(inertia.mass), com, np.asarray(np.linalg.eigvalsh(np.array(inertia.inertia)), dtype=float), extent
    )


def _hip_diagonal(robot: RobotModel) -> float:
    """Return the mean distance from a leg's first joint to the diagonally opposite one [m]."""
    hips = hip_positions(robot)
    return 2 * float(np.linalg.norm(hips - hips.mean(axis=0), axis=1).mean())


def hip_positions(robot: RobotModel) -> FloatArray:
    """Return the (4, 3) first joints of the legs FL FR RL RR in the base frame [m]."""
    return np.array([robot.pinocchio.jointPlacements[leg.joint_ids[0]].translation for leg in robot.legs.values()])


def link_ends(robot: RobotModel, leg: Leg) -> dict[int, FloatArray]:
    """Return by joint of a leg the (3,) end of its link, the next joint or the foot, in the joint's frame [m]."""
    following = [robot.pinocchio.jointPlacements[joint] for joint in leg.joint_ids[1:]]
    ends = [*following, robot.pinocchio.frames[leg.foot_frame_id].placement]
    return {joint: np.array(end.translation) for joint, end in zip(leg.joint_ids, ends, strict=True)}


def links_of(robot: RobotModel, bodies: dict[int, RigidBody]) -> Iterator[LinkInertial]:
    """Yield every link of the file that has mass; links behind locked joints belong to the base."""
    body_of = {robot.pinocchio.names[joint]: body for joint, body in bodies.items()}
    model = robot.full_pinocchio
    for link in file_links(model):
        body = body_of.get(model.names[link.joint], bodies[1])
        yield LinkInertial(link.name, body, InertialParameters.from_pinocchio(link.inertia))
