"""Support line of a robot on two feet, and its motion as the feet roll on the floor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from equipoise.estimator.measurements.foot_contact import FootContact
from equipoise.estimator.measurements.leg_motion import TracedLegMotion, TracedPosture
from equipoise.estimator.measurements.traced import Traced, cross, dot, length

Feet = Sequence[NDArray[np.intp]]
"""Indices (n,) of the left stance foot, and of the right one."""


@dataclass(frozen=True, eq=False)
class ContactLine:
    """Support line of n samples, in base axes.

    Attributes:
        left: (3, n) direction, from the right foot to the left.
        point: (3, n) contact point of the right foot, in the base frame [m].
        length: (n,) distance of the contact points [m].
    """

    left: Traced
    point: Traced
    length: Traced

    @classmethod
    def of(cls, posture: TracedPosture, feet: Feet, contacts: Sequence[FootContact]) -> ContactLine:
        """Compute the line of two stance feet from their contacts."""
        sample = np.arange(len(feet[0]))
        both = zip(feet, contacts, strict=True)
        left, right = (posture.foot[:, foot, sample] - contact.to_centre for foot, contact in both)
        between = left - right
        return cls(between / length(between), right, length(between))


@dataclass(frozen=True, eq=False)
class RollingLine:
    """Motion of the support line, in base axes; rates are inertial.

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
    def of(cls, line: ContactLine, motion: TracedLegMotion, feet: Feet, contacts: Sequence[FootContact]) -> RollingLine:
        """Compute the motion of feet that roll without slipping: contact points are at rest, centres turn about them."""
        sample = np.arange(len(feet[0]))
        turning = [motion.foot_angular_velocity[:, foot, sample] for foot in feet]
        both = list(zip(turning, contacts, strict=True))
        left, right = (contact.contact_velocity(of_foot) for of_foot, contact in both)
        centres = [cross(of_foot, contact.to_centre) for of_foot, contact in both]
        of_feet = motion.foot_velocity[:, feet[0], sample] + motion.foot_velocity[:, feet[1], sample]
        rate = (left - right) / line.length
        along = (dot(line.left, of_foot) for of_foot in turning)
        base = 0.5 * (centres[0] + centres[1] - of_feet)
        return cls(right, rate - line.left * dot(line.left, rate), base, *along)
