"""Safety of a lift with an uncertain CoM: whether it may start, and the tilt at which it must end.

`com_covariance` is a (3, 3) covariance of the CoM in base axes, scaled to two standard deviations [m2]. Before any
measurement it allows for a payload of 30 % of the robot's mass. A lift of the search measures the CoM across its line.
The height of a payload is uncertain until the plan's first half is done.
"""

from __future__ import annotations

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import ReachError
from equipoise.experiments.lift import LiftSettings
from equipoise.experiments.tipping import Pendulum
from equipoise.robot.stance import Stance

_LEAST_UP = 0.18  # [s] on an A1: shortest time on two feet that is informative
# Uncertainty of the CoM (two standard deviations), as a fraction of the hip height.
_UNKNOWN, _FOUND = (0.05, 0.05, 0.12), (0.012, 0.012, 0.02)
_PAYLOAD_HEIGHT = 0.5  # largest distance of a payload above or below the base's origin, over the hip height


def initial_covariance(stance: Stance) -> FloatArray:
    """Return the covariance of the CoM before any measurement [m2]."""
    return np.diag(stance.hip_height * np.array(_UNKNOWN)) ** 2


def search_covariance(stance: Stance, payload: float = 0.0) -> FloatArray:
    """Return the covariance of the CoM after the search [m2].

    Args:
        payload: mass of the payload that the search found, as a fraction of the robot's.
    """
    return np.diag(stance.hip_height * np.array([*_FOUND[:2], _FOUND[2] + _PAYLOAD_HEIGHT * payload])) ** 2


def covariance_after_lift(stance: Stance, com_covariance: FloatArray, across: FloatArray) -> FloatArray:
    """Return the covariance of the CoM after a lift of the search [m2].

    Args:
        com_covariance: (3, 3) covariance of the CoM in the base frame before the lift [m2].
        across: (3,) horizontal vector across the lift's support line, in the base frame.
    """
    measured = np.outer(across, across) / float(across @ across)
    rest = np.eye(3) - measured
    return rest @ com_covariance @ rest + measured @ search_covariance(stance) @ measured


def safe_stop(
    tipping: Pendulum, settings: LiftSettings, stance: Stance, com_covariance: FloatArray
) -> tuple[float, float]:
    """Return the tilts, backward and forward, up to which the feet can catch the robot: x of `tipping` [rad].

    Raises:
        ReachError: the robot reaches them before the lift is informative.
    """
    margin = float(np.sqrt(tipping.normal_in_base @ com_covariance @ tipping.normal_in_base))
    stop = tipping.stop(settings.height, settings.lower_time, settings.stop_delay, margin)
    time, least = tipping.time_until(stop), _LEAST_UP * stance.scale.time
    if time < least:
        raise ReachError(
            f"the robot could tip over: its centre of mass is {abs(tipping.ahead) * 1000:.0f} mm from the support line, "
            f"uncertain by {margin * 1000:.0f} mm, so two feet may be up for {max(time, 0):.2f} s; a lift needs {least:.2f} s"
        )
    return stop
