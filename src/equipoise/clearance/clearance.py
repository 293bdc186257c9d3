"""Distances between a robot's links along a motion, computed only when contact is possible.

A body's displacement is at most the joint's rotation times the body's reach from it. Two shapes at a distance d cannot
touch before their displacements add up to d; until then no distance is computed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from equipoise.clearance.pairs import Distances, pairs_of
from equipoise.conventions import FloatArray
from equipoise.robot.model import RobotModel
from equipoise.small_arrays import any_of
from equipoise.thread_memory import ThreadMemory

FLOOR = "the floor"
_ROUNDING = 1e-4  # [m] by which shapes that are too near initially may come nearer
_PART = 60  # number of postures processed at once


@dataclass(frozen=True)
class Contact:
    """Two links, or a link and the floor, below the smallest allowed distance.

    Attributes:
        links: names of the links, one of which may be `FLOOR`.
        distance: distance between them [m]; negative: they overlap.
    """

    links: tuple[str, str]
    distance: float

    def __str__(self) -> str:
        first, second = (link if link == FLOOR else f"link {link!r}" for link in self.links)
        if self.distance <= 0:
            return f"{first} would touch {second}"
        return f"{first} would come within {self.distance * 1000:.1f} mm of {second}"


def _distances_of(robot: RobotModel) -> Distances:
    return Distances(robot, pairs_of(robot).shapes)


_distances = ThreadMemory(_distances_of)


def contact_in(robot: RobotModel, joint_position: FloatArray) -> Contact | None:
    """Return the nearest two links at (nj,) joint positions [rad] if they are below the smallest allowed distance."""
    pairs = pairs_of(robot)
    found = _distances.of(robot).nearest(joint_position, pairs.least)
    return None if found is None else Contact(pairs.links[found[0]], found[1])


class Clearance:
    """Contact checker along a motion. Links that are too near initially may not come nearer.

    It is not thread-safe.

    Args:
        robot: model of the robot; raises as `pairs_of`.
        joint_position: (nj,) initial joint positions [rad].
    """

    def __init__(self, robot: RobotModel, joint_position: FloatArray) -> None:
        self._pairs = pairs_of(robot)
        self._distances = Distances(robot, self._pairs.shapes)
        self.begin(joint_position)

    def begin(self, joint_position: FloatArray) -> None:
        """Restart at other joint positions."""
        distance, pairs = self._distances.all(joint_position), self._pairs
        self._here, self._travelled = joint_position, np.zeros(len(pairs.first))  # [m] along each route
        self._allowed = np.minimum(distance - _ROUNDING, pairs.least)  # [m] of each pair
        self._due = np.maximum(distance, pairs.least)  # [m] travelled before each pair is checked again
        self._soonest = self._soonest_of_routes()

    def first_contact(self, joint_positions: FloatArray) -> Contact | None:
        """Return the first contact along (n, nj) postures [rad], or None.

        Joints move linearly between postures. Between checks, shapes may come nearer than the smallest allowed distance,
        but do not touch.
        """
        parts = (joint_positions[start : start + _PART] for start in range(0, len(joint_positions), _PART))
        return next((contact for part in parts if (contact := self._go(part)) is not None), None)

    def next_contact(self, joint_position: FloatArray) -> Contact | None:
        """Return `first_contact` of the next (nj,) posture [rad], for a control loop."""
        travelled = self._travelled + np.abs(joint_position - self._here) @ self._pairs.reach
        if any_of(travelled > self._soonest):
            return self._check_due(joint_position, travelled)
        self._here, self._travelled = joint_position, travelled
        return None

    def _go(self, joint_positions: FloatArray) -> Contact | None:
        turned = np.abs(joint_positions - np.concatenate([self._here[None], joint_positions[:-1]]))
        travelled = self._travelled + np.cumsum(turned @ self._pairs.reach, axis=0)
        index = 0
        while (late := (travelled[index:] > self._soonest).any(axis=1)).any():
            index += int(np.argmax(late))
            if (contact := self._check_due(joint_positions[index], travelled[index])) is not None:
                return contact
        self._here, self._travelled = joint_positions[-1], travelled[-1]
        return None

    def _soonest_of_routes(self) -> FloatArray:
        """Return the (routes,) distance travelled before a pair of each route is checked again [m]."""
        return np.minimum.reduceat(self._due, self._pairs.first)

    def _check_due(self, joint_position: FloatArray, travelled: FloatArray) -> Contact | None:
        """Return a contact among the pairs that are due, or None."""
        self._here, self._travelled = joint_position, travelled
        self._distances.place(joint_position)
        least, along = self._pairs.least, travelled[self._pairs.route]
        for pair in np.flatnonzero(self._due < along):
            distance = self._distances.of(int(pair))
            if distance < self._allowed[pair]:
                return Contact(self._pairs.links[pair], distance)
            self._allowed[pair] = min(max(self._allowed[pair], distance - _ROUNDING), least)
            self._due[pair] = along[pair] + max(distance, least)
        self._soonest = self._soonest_of_routes()
        return None
