"""Where a robot faces in the room: somebody turns it half-way through a run, and what is fixed in the room stays.

A cable's force and the floor's slope are then the other way round in base axes, the accelerometer's bias is not: that tells
them apart. An IMU does not know where north is, but its gyroscope, integrated from the rest before to the rest after, says by
how much it was turned, to a degree or two. With that angle nothing is assumed of how well somebody turns: taken for 180
degrees, ten degrees less would leave a sixth of a force across.
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
    """Angle by which a robot was turned about the vertical from a recording's phase "before" to its end, to its left [rad].

    It is between -pi and pi.
    """
    rest, rotation = recording.phase(Phase.BEFORE).imu, np.array(robot.imu_in_base.rotation)
    imu = recording.between(rest.time[0], np.inf).imu
    angular_velocity = imu.angular_velocity_in_imu - rest.angular_velocity_in_imu.mean(axis=0)
    forward: FloatArray = attitudes(imu.time, angular_velocity @ rotation.T).as_matrix()[-1, :, 0]
    up: FloatArray = rotation @ rest.acceleration_in_imu.mean(axis=0)
    up = up / np.linalg.norm(up)
    ahead = np.cross([0.0, 1.0, 0.0], up)
    return float(np.arctan2(forward @ np.cross(up, ahead), forward @ ahead))


def facing(in_room: Traced, heading: FloatArray) -> Traced:
    """(2, n) horizontal vectors in base axes, forward and to the left, that are fixed in the room.

    Args:
        in_room: (2, n) the same in the base axes of the run's beginning.
        heading: (n,) angle by which the robot was turned since then, to its left [rad].
    """
    cos, sin = np.cos(heading), np.sin(heading)
    return stacked([cos * in_room[0] + sin * in_room[1], cos * in_room[1] - sin * in_room[0]], axis=0)
