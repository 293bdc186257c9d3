"""Limit at which a motion on two feet is stopped: the robot has tipped far enough, or is about to tip too far.

The lean of the CoM about the line between the feet, since the motion began, is linear in the sensor readings:

    a = axis . (integral of w) + joints . (q - q0),     r = (1 - spin) da/dt + spin (axis . w),

with w the gyroscope's angular velocity and q the joint positions. r is the angular momentum about the line over the moment
of inertia about it: a body that turns about its own CoM has momentum, and no lean. On two feet a + horizon r grows
exponentially, whatever the body's motion; with bounds on it, the feet come down in time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.small_arrays import any_of


@dataclass(frozen=True)
class TiltLimit:
    """Limit that stops a motion once the robot has leaned far enough about an axis, or is about to.

    Attributes:
        angle: largest lean since the motion began, either way [rad].
        axis_in_imu: (3,) axis of the lean in the IMU frame. On two feet a robot also yaws on its soft legs; that is not a
            tilt.
        joints: (nj,) share of each joint's motion in the lean; empty: none.
        horizon: time by which the rate is multiplied [s].
        spin: share of the base's own angular velocity in the rate.
        bounds: limits of lean plus horizon times rate [rad].
        window: time over which the lean is differentiated [s].
        stop_requested: function that returns whether the operator has ended the motion; None: no operator.
    """

    angle: float
    axis_in_imu: tuple[float, ...]
    joints: tuple[float, ...] = ()
    horizon: float = 0.0
    spin: float = 1.0
    bounds: tuple[float, float] = (-np.inf, np.inf)
    window: float = 0.0
    stop_requested: Callable[[], bool] | None = None


class TiltTest:
    """Test of a limit during a motion, sample by sample or for many samples at once.

    Args:
        limit: limit to test; None is never reached.
        control_period: time between samples [s].
    """

    def __init__(self, limit: TiltLimit | None, control_period: float) -> None:
        self._limit, self._period = limit, control_period
        self._turned = 0.0
        self._start: FloatArray | None = None
        if limit is not None:
            self._axis, self._joints = np.array(limit.axis_in_imu), np.array(limit.joints)
            self._past = np.zeros(max(1, round(limit.window / control_period)))

    def reached(self, angular_velocity_in_imu: FloatArray, joint_position: FloatArray) -> bool:
        """Return whether the limit is reached in any of the next samples.

        Args:
            angular_velocity_in_imu: (n, 3) angular velocity in the IMU frame [rad/s].
            joint_position: (n, nj) joint positions [rad].
        """
        if self._limit is None:
            return False
        if self._limit.stop_requested is not None and self._limit.stop_requested():
            return True
        turning = angular_velocity_in_imu @ self._axis
        lean = self._turned + np.cumsum(turning) * self._period
        self._turned = float(lean[-1])
        if self._joints.size:
            start = self._start = joint_position[0] if self._start is None else self._start
            lean = lean + (joint_position - start) @ self._joints
        leans = np.concatenate([self._past, lean])
        width = len(self._past)
        self._past = leans[-width:]
        rate = (lean - leans[: len(lean)]) / (width * self._period)
        ahead = lean + self._limit.horizon * (rate + self._limit.spin * (turning - rate))
        least, most = self._limit.bounds
        return any_of((np.abs(lean) >= self._limit.angle) | (ahead <= least) | (ahead >= most))
