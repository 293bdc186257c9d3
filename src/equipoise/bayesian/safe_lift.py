"""Whether a lift of the Bayesian method may be done with what is known of the CoM then, and when it has to end.

What is not known is a doubt: a (3, 3) matrix in base axes, as a covariance of two standard deviations [m2]. Before anything
is measured a payload of 30 % of the robot may be on it; a lift of the search tells where the CoM is across its line; how high
a payload is nobody knows before the plan's first half is done.
"""

from __future__ import annotations

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import ReachError
from equipoise.experiments.lift import LiftSettings
from equipoise.experiments.tipping import Pendulum
from equipoise.robot.stance import Stance

_LEAST_UP = 0.18  # [s] on an A1 that two feet must be up, or the lift tells nothing
# Of the CoM, over the hip height.
_UNKNOWN, _FOUND = (0.05, 0.05, 0.12), (0.012, 0.012, 0.02)
_PAYLOAD_HEIGHT = 0.5  # over the hip height: of a payload above the base's origin, or below


def unknown_doubt(stance: Stance) -> FloatArray:
    """Before anything is measured."""
    return np.diag(stance.hip_height * np.array(_UNKNOWN)) ** 2


def found_doubt(stance: Stance, payload: float = 0.0) -> FloatArray:
    """After a search.

    Args:
        payload: mass of the payload that the search found, as a fraction of the robot's.
    """
    return np.diag(stance.hip_height * np.array([*_FOUND[:2], _FOUND[2] + _PAYLOAD_HEIGHT * payload])) ** 2


def doubt_after_a_lift(stance: Stance, doubt: FloatArray, across: FloatArray) -> FloatArray:
    """After a lift of the search.

    Args:
        doubt: (3, 3) covariance of the CoM in the base frame before the lift [m2].
        across: (3,) horizontal vector across the lift's support line, in the base frame.
    """
    measured = np.outer(across, across) / float(across @ across)
    rest = np.eye(3) - measured
    return rest @ doubt @ rest + measured @ found_doubt(stance) @ measured


def safe_stop(tipping: Pendulum, settings: LiftSettings, stance: Stance, doubt: FloatArray) -> tuple[float, float]:
    """How far a robot may be about to tip, backward and forward, for the feet to catch it: x of `tipping` [rad].

    Raises:
        ReachError: it is there before the lift tells anything.
    """
    farther = float(np.sqrt(tipping.normal_in_base @ doubt @ tipping.normal_in_base))
    stop = tipping.stop(settings.height, settings.lower_time, settings.stop_delay, farther)
    time, least = tipping.time_until(stop), _LEAST_UP * stance.scale.time
    if time < least:
        raise ReachError(
            f"the robot could tip over: with its centre of mass {abs(tipping.ahead) * 1000:.0f} mm beside the line, and "
            f"perhaps {farther * 1000:.0f} mm more, two feet may be up for {max(time, 0):.2f} s of the {least:.2f} s that a "
            "lift takes to tell anything"
        )
    return stop
