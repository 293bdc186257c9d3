"""Clearance of legs in the air from the floor, the trunk and each other."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import combinations

import coal
import numpy as np
import pinocchio as pin

from equipoise.clearance.pairs import Distances
from equipoise.clearance.shapes import robot_shapes
from equipoise.clearance.stand_ins import BASE_JOINT
from equipoise.conventions import FloatArray
from equipoise.robot.model import LEG_NAMES, RobotModel
from equipoise.robot.stance import BELLY_RATIO, Stance

_FLOOR = 0  # id of the floor among joint ids
_VAST = 10.0  # [m] edge length of the floor
_BOTH_SWING = 5.0  # factor on the room between two legs


class LegsInTheAir:
    """Clearance of swinging legs of a robot that lies on its belly or stands on the other legs.

    Adjacent links are not checked. For two links that are near each other in the nominal stance, a quarter of that
    distance is sufficient; links that overlap there are ignored.

    Args:
        robot: model of the robot.
        stance: nominal stance of the robot.
        room: smallest allowed distance; a multiple of it between legs, which all swing [m].
        legs: names of the checked legs.
        floor: height of the floor in the base frame; default: at the belly [m].
    """

    def __init__(
        self,
        robot: RobotModel,
        stance: Stance,
        room: float,
        legs: Iterable[str] = LEG_NAMES,
        floor: float | None = None,
    ) -> None:
        shapes = robot_shapes(robot)
        carried = [int(shape.parentJoint) for shape in shapes.geometryObjects]
        lying = stance.hip_height - stance.base_height - BELLY_RATIO * robot.leg_length
        below = pin.SE3(np.eye(3), np.array([0.0, 0.0, (lying if floor is None else floor) - _VAST / 2]))
        shapes.addGeometryObject(pin.GeometryObject("floor", BASE_JOINT, below, coal.Box(_VAST, _VAST, _VAST)))
        carried.append(_FLOOR)
        pairs = _pairs(robot, carried, tuple(legs))
        for first, second in pairs:
            shapes.addCollisionPair(pin.CollisionPair(first, second))
        self._distances = Distances(robot, shapes)
        of_floor = [carried[second] == _FLOOR for _, second in pairs]
        usual = np.where(of_floor, np.inf, self._distances.all(stance.joint_position))
        both = [min(carried[first], carried[second]) > BASE_JOINT for first, second in pairs]
        rooms = np.where(both, _BOTH_SWING * room, room)
        self._room = np.where(usual > 0, np.minimum(rooms, usual / 4), -np.inf)

    def kept(self, joint_position: FloatArray) -> bool:
        """Return True if all distances are kept at (nj,) joint positions [rad], for a level base on a level floor."""
        return bool((self._distances.all(joint_position) > self._room).all())


def _pairs(robot: RobotModel, carried: list[int], legs: tuple[str, ...]) -> list[tuple[int, int]]:
    """Return the indices of pairs of shapes that must not touch, without those of adjacent links."""
    chains = {name: robot.legs[name].joint_ids for name in legs}
    of_leg = {joint: name for name, chain in chains.items() for joint in chain}
    on_base = {BASE_JOINT, *(chain[0] for chain in chains.values())}
    hips = {_FLOOR, *(joint for chain in chains.values() for joint in chain[:-2])}  # hips rotate about their own axes
    return [
        (first, second)
        for (first, one), (second, other) in combinations(enumerate(carried), 2)
        if of_leg.get(one) != of_leg.get(other) and not {one, other} <= on_base and not {one, other} <= hips
    ]
