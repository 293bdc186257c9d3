"""Heading of a robot that is rotated half-way through a run, and vectors fixed in the world.

The rotation reverses a cable's force and the floor's slope in base axes, but not the accelerometer's bias, and so separates
them. The gyroscope, integrated from rest to rest, measures the angle to a degree or two. A nominal angle of 180 degrees would
not suffice: an error of ten degrees would leave a sixth of a force across.
"""

from __future__ import annotations

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.estimator.measurements.lift_samples import attitudes
from equipoise.estimator.measurements.traced import Traced, stacked
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.robot.model import RobotModel


def angle_turned(robot: RobotModel, recording: Recording) -> float:
    """Return the rotation to the left about the vertical, from a recording's phase "before" to its end [-pi to pi rad]."""
    rest, rotation = recording.phase(Phase.BEFORE).imu, np.array(robot.imu_in_base.rotation)
    imu = recording.between(rest.time[0], np.inf).imu
    angular_velocity = imu.angular_velocity_in_imu - rest.angular_velocity_in_imu.mean(axis=0)
    forward: FloatArray = attitudes(imu.time, angular_velocity @ rotation.T).as_matrix()[-1, :, 0]
    up: FloatArray = rotation @ rest.acceleration_in_imu.mean(axis=0)
    up = up / np.linalg.norm(up)
    ahead = np.cross([0.0, 1.0, 0.0], up)
    return float(np.arctan2(forward @ np.cross(up, ahead), forward @ ahead))


def facing(in_room: Traced, heading: FloatArray) -> Traced:
    """Return (2, n) horizontal vectors fixed in the world, in base axes: forward and left.

    Args:
        in_room: (2, n) vectors in the base axes at the start of the run.
        heading: (n,) rotation of the robot to its left since then [rad].
    """
    cos, sin = np.cos(heading), np.sin(heading)
    return stacked([cos * in_room[0] + sin * in_room[1], cos * in_room[1] - sin * in_room[0]], axis=0)
