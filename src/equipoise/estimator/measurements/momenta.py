"""Momenta of a whole robot, linear in its inertial parameters.

These are the base's ten, a factor on each leg link's, and each link's additional first moment about its model CoM, in the
link's frame. A CoM error d is a moment m d; the resulting change of inertia, m d^2, is neglected.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.estimator.measurements.leg_motion import LegChains, TracedLegMotion, TracedPosture
from equipoise.estimator.measurements.traced import Traced, contract, cross, turned
from equipoise.robot.inertial import base_parameters
from equipoise.robot.model import RobotModel

BASE = 10  # parameters in Pinocchio's order, about the base's origin
_TENSOR = np.zeros((3, 3, 6))  # from six numbers, in the order below, to a symmetric matrix
for _number, (_row, _column) in enumerate(((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))):
    _TENSOR[_row, _column, _number] = _TENSOR[_column, _row, _number] = 1.0
_ALL_LINKS = "ikln,kln->in"


def model_parameters(robot: RobotModel) -> FloatArray:
    """Return the (10 + 4 links,) inertial parameters of the model."""
    links = sum(len(leg.joint_ids) for leg in robot.legs.values())
    return np.concatenate([base_parameters(robot).vector, np.ones(links), np.zeros(3 * links)])


@dataclass(frozen=True, eq=False)
class Momenta:
    """Momenta of all bodies together in n samples, in base axes.

    Attributes:
        linear: (3, n) linear momentum [kg m/s].
        angular: (3, n) angular momentum about a point [kg m2/s].
        first: (3, n) first moment of mass about that point [kg m].
        mass: (n,) mass [kg].
    """

    linear: Traced
    angular: Traced
    first: Traced
    mass: Traced

    @classmethod
    def about(
        cls, point: Traced, legs: LegChains, inertial: Traced, posture: TracedPosture, motion: TracedLegMotion,
        angular_velocity_in_base: Traced, velocity: Traced,
    ) -> Momenta:  # fmt: skip
        """Compute the momenta about a point in the base frame.

        Args:
            inertial: (10 + 4 links, n) inertial parameters.
            velocity: (3, n) velocity of the base's origin, in base axes [m/s].
        """
        mass, first, tensor = inertial[0], inertial[1:4], contract("ijk,k...->ij...", _TENSOR, inertial[4:BASE])
        linear = mass * velocity + cross(angular_velocity_in_base, first)
        angular = turned(tensor, angular_velocity_in_base) + cross(first, velocity) - cross(point, linear)
        number = np.arange(legs.links).reshape(legs.mass.shape).T  # (k, 4)
        factor, moment = inertial[BASE + number], inertial[BASE + legs.links + 3 * number + np.arange(3)[:, None, None]]
        masses, arm = legs.mass.T[..., None] * factor, posture.com - point[:, None, None]
        of_links = motion.com_velocity + velocity[:, None, None]
        spins = contract(_ALL_LINKS, motion.spin, factor) + contract(_ALL_LINKS, cross(arm, of_links), masses)
        moments, ones = turned(posture.rotation, moment), np.ones(legs.mass.T.shape)
        swung = cross(motion.angular_velocity, moments)
        return cls(
            linear + contract(_ALL_LINKS, of_links, masses) + contract("ikln,kl->in", swung, ones),
            angular + spins + contract("ikln,kl->in", cross(arm, swung) + cross(moments, of_links), ones),
            first - mass * point + contract(_ALL_LINKS, arm, masses) + contract("ikln,kl->in", moments, ones),
            mass + contract("kl,kln->n", ones, masses),
        )
