"""Pairs of a robot's shapes whose distance is checked.

Pairs are excluded if their links are adjacent, or are the trunk and a part above the knees (separated by joint limits).
Pairs that are closer than the smallest allowed distance in the standing or lying posture are excluded too: their shapes are
larger than the links, or rest on each other.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from equipoise.clearance.shapes import Spheres, link_of, locked_links, robot_shapes
from equipoise.clearance.stand_ins import BASE_JOINT
from equipoise.conventions import FloatArray
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import lying_posture, nominal_stance

_LEAST = 0.005  # [m] between two shapes on an A1, whose feet may be that far from their targets


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs of shapes whose distance is checked.

    Attributes:
        shapes: shapes, attached to the joints of the robot's model; its collision pairs are these pairs.
        links: names of the two links of each pair.
        least: smallest allowed distance between the shapes of a pair [m].
        route: (pairs,) index of the route (pair of parent joints) of each pair, a column of `reach`, ascending.
        first: (routes,) index of the first pair of each route.
        reach: (nj, routes) largest approach of a route's shapes per rotation of each joint [m/rad].
    """

    shapes: pin.GeometryModel
    links: tuple[tuple[str, str], ...]
    least: float
    route: NDArray[np.intp]
    first: NDArray[np.intp]
    reach: FloatArray


class Distances:
    """Distances between the shapes of pairs; owns the memory that they are computed in, as `Kinematics` does."""

    def __init__(self, robot: RobotModel, shapes: pin.GeometryModel) -> None:
        self._robot, self._shapes = robot, shapes
        self._data, self._placed = robot.create_data(), shapes.createData()
        self._spheres = Spheres.around(shapes.geometryObjects)
        self._pairs = np.array([[pair.first, pair.second] for pair in shapes.collisionPairs])

    def place(self, joint_position: FloatArray) -> None:
        """Place the shapes at (nj,) joint positions [rad]."""
        model, configuration = self._robot.pinocchio, self._robot.configuration(joint_position)
        pin.updateGeometryPlacements(model, self._data, self._shapes, self._placed, configuration)

    def of(self, pair: int) -> float:
        """Return the distance between the shapes of a pair [m]; negative: they overlap."""
        return float(pin.computeDistance(self._shapes, self._placed, pair).min_distance)

    def all(self, joint_position: FloatArray) -> FloatArray:
        """Return the (pairs,) distances at (nj,) joint positions [rad]."""
        self.place(joint_position)
        return np.array([self.of(pair) for pair in range(len(self._pairs))])

    def nearest(self, joint_position: FloatArray, least: float) -> tuple[int, float] | None:
        """Return the nearest pair at (nj,) joint positions [rad] and its distance if that is below `least` [m]."""
        self.place(joint_position)
        centre, (first, second) = self._spheres.placed(list(self._data.oMi)), self._pairs.T
        apart = np.linalg.norm(centre[first] - centre[second], axis=1)
        may_be = np.flatnonzero(apart < self._spheres.radius[first] + self._spheres.radius[second] + least)
        found = min(((self.of(int(pair)), int(pair)) for pair in may_be), default=(least, -1))
        return (found[1], found[0]) if found[0] < least else None


@lru_cache(maxsize=16)
def pairs_of(robot: RobotModel) -> Pairs:
    """Return the pairs of a robot; raises as `nominal_stance`."""
    shapes, stance = robot_shapes(robot), nominal_stance(robot)
    least = _LEAST * stance.scale.length
    _pair_up(robot, shapes)
    usual, postures = Distances(robot, shapes), (stance.joint_position, lying_posture(robot, stance)[0])
    touch = np.min([usual.all(position) for position in postures], axis=0) < least
    pairs = list(shapes.collisionPairs)
    shapes.removeAllCollisionPairs()
    for index in np.flatnonzero(~touch):
        shapes.addCollisionPair(pairs[index])
    names = [link_of(shape) for shape in shapes.geometryObjects]
    links = tuple((names[pair.first], names[pair.second]) for pair in shapes.collisionPairs)
    return Pairs(shapes, links, least, *_routes(robot, shapes))


def _pair_up(robot: RobotModel, shapes: pin.GeometryModel) -> None:
    """Add the collision pairs, sorted by route, without adjacent links."""
    found, near, arms = shapes.geometryObjects, _near(robot), locked_links(robot)
    by_joints = sorted(range(len(found)), key=lambda index: found[index].parentJoint)
    routes = sorted((found[a].parentJoint, found[b].parentJoint, a, b) for a, b in combinations(by_joints, 2))
    for upper, lower, first, second in routes:
        if upper != lower and ((upper, lower) not in near or link_of(found[first]) in arms):
            shapes.addCollisionPair(pin.CollisionPair(first, second))


def _near(robot: RobotModel) -> set[tuple[int, int]]:
    """Return pairs of joints, the upper first, with adjacent links, or with the trunk and a part of a leg above its knee."""
    neighbours = {(int(robot.pinocchio.parents[joint]), joint) for joint in range(2, robot.pinocchio.njoints)}
    return neighbours | {(BASE_JOINT, joint) for leg in robot.legs.values() for joint in leg.joint_ids[:-1]}


def _routes(robot: RobotModel, shapes: pin.GeometryModel) -> tuple[NDArray[np.intp], NDArray[np.intp], FloatArray]:
    """Return `route`, `first` and `reach` of the pairs."""
    found, reaches = shapes.geometryObjects, _joint_reaches(robot, shapes)
    joints = np.array([[found[p.first].parentJoint, found[p.second].parentJoint] for p in shapes.collisionPairs])
    routes, first, route = np.unique(joints, axis=0, return_index=True, return_inverse=True)
    return route.reshape(-1), first, np.array([reaches[a] + reaches[b] for a, b in routes]).T


def _joint_reaches(robot: RobotModel, shapes: pin.GeometryModel) -> dict[int, FloatArray]:
    """Return, for each joint, the (nj,) largest displacements of its shapes per rotation of each joint up to it [m/rad]."""
    reaches = {joint: np.zeros(len(robot.joint_names)) for joint in range(robot.pinocchio.njoints)}
    spheres = Spheres.around(shapes.geometryObjects)
    for parent, centre, radius in zip(spheres.joint, spheres.centre, spheres.radius, strict=True):
        extent = float(np.linalg.norm(centre)) + float(radius)
        for joint, above in _above(robot, int(parent)):
            row = reaches[int(parent)]
            row[joint - 2] = max(row[joint - 2], above + extent)
    return reaches


def _above(robot: RobotModel, joint: int) -> Iterator[tuple[int, float]]:
    """Generate a joint and those above it in its leg, with the largest distance of the first from each [m]."""
    model, distance = robot.pinocchio, 0.0
    while joint > 1:
        yield joint, distance
        distance += float(np.linalg.norm(model.jointPlacements[joint].translation))
        joint = model.parents[joint]
