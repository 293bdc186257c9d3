"""Contact point of a foot on the floor: under the centre of a spherical foot, nearer to an edge of a wide or worn one.

n is the floor's normal, R the radius, and u a direction of the foot that is level in the nominal stance. The vector from the
contact point to the foot's centre is

    e = R n + sum of w tanh(n . u / s) u.

w is the half-width of the foot along u: zero for a sphere, half the length for a cylinder across the leg. A foot inclined by
more than about s stands on its edge. Below that the load is spread over its width.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.estimator.measurements.leg_motion import LegChains, TracedPosture
from equipoise.estimator.measurements.traced import Traced, contract, cross, tanh

_LEAN: Final = 0.005  # [rad] s; a softer cylinder behaves more like a sphere, whose width has no effect
_ALONG_EACH, _SUM = "i...,ij...->j...", "j...,ij...->i..."


def foot_directions(legs: LegChains, posture: TracedPosture) -> Traced:
    """Return (3, 2, 4, n) `LegChains.level_directions` of the feet, in base axes."""
    return contract("ij...,jk...->ik...", posture.rotation[:, :, -1], legs.level_directions)


def _side(normal: Traced, directions: Traced) -> Traced:
    """Return the (2, ...) contact position in each direction over the half-width, -1 to 1, from (3, ...) normals."""
    return tanh(contract(_ALONG_EACH, normal, directions) * (1 / _LEAN))


class FootContact:
    """Contact of a foot with the floor in n samples, in base axes.

    Attributes:
        to_centre: (3, n) vector from the contact point to the foot's centre [m].
    """

    def __init__(self, radius: Traced, normal: Traced, width: Traced, directions: Traced) -> None:
        """Take (n,) radii [m], (3, n) floor normals, (2, n) half-widths [m] and (3, 2, n) directions."""
        self._ball, self._normal, self._width, self._directions = radius * normal, normal, width, directions
        self._side = _side(normal, directions)
        self.to_centre = self._ball + contract(_SUM, width * self._side, directions)

    def contact_velocity(self, turning: Traced) -> Traced:
        """Return the (3, n) contact velocity over the floor [m/s] at (3, n) angular velocities of the foot [rad/s]."""
        leaning = contract(_ALONG_EACH, self._normal, cross(turning[:, None], self._directions))
        shifted = self._width * (1.0 - self._side * self._side) * leaning * (1 / _LEAN)
        return cross(turning, self._ball) - contract(_SUM, shifted, self._directions)


def to_centre_by_width(legs: LegChains, joint_position: FloatArray, up: FloatArray) -> FloatArray:
    """Return (n, 2, 4, 3) shifts of the feet's centres relative to spherical feet, divided by the half-widths.

    Args:
        joint_position: (n, nj) joint positions [rad].
        up: (n, 3) floor's normal, in base axes.
    """
    position, normal = (Traced(np.ascontiguousarray(part.T)) for part in (joint_position, up))
    directions = foot_directions(legs, legs.traced_posture(position))
    return (_side(normal[:, None], directions) * directions).value.transpose(3, 1, 2, 0)
