"""The line that a robot on two feet topples about, and how it moves: the feet roll on the floor as spheres."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from equipoise.estimator.measurements.leg_motion import TracedLegMotion, TracedPosture
from equipoise.estimator.measurements.traced import Traced, cross, dot, length

Feet = Sequence[NDArray[np.intp]]
"""(n,) indices of the left stance foot, and of the right one."""


@dataclass(frozen=True, eq=False)
class ContactLine:
    """The support line of n samples, in base axes.

    Attributes:
        left: (3, n) direction, from the right foot to the left.
        point: (3, n) contact point of the right foot, in the base frame [m].
        length: (n,) distance of the contact points [m].
    """

    left: Traced
    point: Traced
    length: Traced

    @classmethod
    def of(cls, posture: TracedPosture, feet: Feet, to_centre: Sequence[Traced]) -> ContactLine:
        """Of two stance feet.

        Args:
            to_centre: (3, n) from the contact point of each to its centre, along the floor's normal [m].
        """
        sample = np.arange(len(feet[0]))
        left, right = (posture.foot[:, foot, sample] - up for foot, up in zip(feet, to_centre, strict=True))
        between = left - right
        return cls(between / length(between), right, length(between))


@dataclass(frozen=True, eq=False)
class RollingLine:
    """How the line moves, in base axes; rates are inertial ones.

    Attributes:
        velocity: (3, n) velocity of its point, as the contact travels over the floor [m/s].
        left_rate: (3, n) rate of change of its direction [1/s].
        base_velocity: (3, n) velocity of the base's origin [m/s].
        left_turning, right_turning: (n,) angular velocity of the stance feet along the line [rad/s].
    """

    velocity: Traced
    left_rate: Traced
    base_velocity: Traced
    left_turning: Traced
    right_turning: Traced

    @classmethod
    def of(cls, line: ContactLine, motion: TracedLegMotion, feet: Feet, to_centre: Sequence[Traced]) -> RollingLine:
        """A sphere that rolls without slipping: its centre moves with its angular velocity x (radius normal)."""
        sample = np.arange(len(feet[0]))
        turning = [motion.foot_angular_velocity[:, foot, sample] for foot in feet]
        left, right = (cross(of_foot, up) for of_foot, up in zip(turning, to_centre, strict=True))
        of_feet = motion.foot_velocity[:, feet[0], sample] + motion.foot_velocity[:, feet[1], sample]
        rate = (left - right) / line.length
        along = (dot(line.left, of_foot) for of_foot in turning)
        return cls(right, rate - line.left * dot(line.left, rate), 0.5 * (left + right - of_feet), *along)
