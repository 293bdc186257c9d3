"""The guard's idea of up, and of how far a base leans from where it should."""

import numpy as np
import pytest
from guarded import PERIOD, at_rest
from scipy.spatial.transform import Rotation

from equipoise.guard.tilt_filter import TiltFilter

LEVEL = (0.0, 0.0, 1.0)


def turning(robot, rate, duration, acceleration_factor=1.0):
    """Samples of a base that turns about its y axis from upright, the accelerometer feeling gravity."""
    for index in range(round(duration / PERIOD) + 1):
        angle = rate * index * PERIOD
        up = 9.81 * np.array([-np.sin(angle), 0.0, np.cos(angle)]) * (acceleration_factor if index else 1.0)
        yield at_rest(robot, index, angular_velocity_in_imu=np.array([0.0, rate, 0.0]), acceleration_in_imu=up)


def filtered(samples, rotation=None):
    up = TiltFilter(np.eye(3) if rotation is None else rotation)
    for sample in samples:
        up.update(sample)
    return up


@pytest.mark.parametrize("factor", [1.0, 2.0])
def test_it_follows_a_base_that_turns_also_while_it_is_being_pushed(a1, factor):
    up = filtered(turning(a1, 1.5, 0.4, factor))
    assert up.tilt == pytest.approx(0.6, abs=0.01)
    assert up.largest == pytest.approx(0.6, abs=0.01)


def test_a_gyroscope_that_drifts_is_corrected(a1):
    samples = [at_rest(a1, index, angular_velocity_in_imu=np.array([0.03, 0.0, 0.0])) for index in range(5000)]
    assert filtered(samples).tilt < 0.02


def test_an_imu_that_is_mounted_turned_is_turned_back(a1):
    rotation = Rotation.from_rotvec([0.3, -0.5, 1.0]).as_matrix()
    samples = [
        at_rest(a1, index, acceleration_in_imu=rotation.T @ sample.acceleration_in_imu,
                angular_velocity_in_imu=rotation.T @ sample.angular_velocity_in_imu)
        for index, sample in enumerate(turning(a1, 1.0, 0.3))
    ]  # fmt: skip
    assert filtered(samples, rotation).tilt == pytest.approx(0.3, abs=0.01)


def test_an_accelerometer_that_reads_zero_causes_no_tilt(a1):
    up = filtered([at_rest(a1, index, acceleration_in_imu=np.zeros(3)) for index in range(5)])
    assert up.tilt == 0.0
    assert up.lean(LEVEL) == 0.0


def test_a_base_in_a_posture_does_not_lean(a1):
    """It turned by 0.3 rad, and that is what it was sent to do."""
    up = filtered(turning(a1, 1.0, 0.3))
    floor = (-np.sin(0.3), 0.0, np.cos(0.3))
    assert up.tilt == pytest.approx(0.3, abs=0.01)
    assert up.lean(floor) == pytest.approx(0.0, abs=0.01)
    assert up.lean((np.sin(0.3), 0.0, np.cos(0.3))) == pytest.approx(0.3, abs=0.01)


def test_a_robot_that_lies_level_does_not_lean_however_its_feet_are(a1):
    assert filtered([at_rest(a1)]).lean((0.0, np.sin(0.9), np.cos(0.9))) == 0.0
