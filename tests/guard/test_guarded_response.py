"""The response test under the guard, which it must not trip; and an IMU that is rotated."""

import numpy as np
import pytest
from guarded import simulated
from miswired import Miswired
from scipy.spatial.transform import Rotation

from equipoise import nominal_stance
from equipoise.errors import FallError
from equipoise.experiments.response import check_base, check_joints
from equipoise.experiments.stand import stand_up
from equipoise.guard.guard import Guard


def respond(platform, robot, confirm=None):
    """The result of the whole response test on a guarded robot."""
    stance = nominal_stance(robot)
    with Guard(platform, robot) as guard:
        joints = check_joints(guard, robot, stance)
        standing, _ = stand_up(guard, robot, stance)
        return check_base(standing, stance, joints, confirm)


@pytest.mark.parametrize(("start", "preset", "joints"), [("lying", "realistic", 12), ("standing", "stress", 0)])
def test_the_guard_lets_the_response_test_pass(a1, start, preset, joints):
    test = respond(simulated(a1, start, preset)[0], a1)
    assert test.joints == joints
    assert test.axes == ("roll", "pitch", "yaw")
    assert np.degrees(test.angle) < 2
    assert not test.uses_measurement


def test_an_imu_turned_about_the_vertical_is_measured_under_the_guard(a1):
    mounted = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    test = respond(Miswired(simulated(a1)[0], imu=mounted.T), a1, lambda question: True)
    assert np.degrees(test.measured_rpy[2]) == pytest.approx(90, abs=1.5)
    assert test.uses_measurement


def test_an_imu_turned_otherwise_is_refused_with_the_orientation_to_try(a1):
    mounted = Rotation.from_euler("x", 90, degrees=True).as_matrix()
    with pytest.raises(FallError, match=r"--imu-rpy 1\.5\d\d -?0\.0\d\d -?0\.0\d\d ") as caught:
        respond(Miswired(simulated(a1)[0], imu=mounted.T), a1)
    assert "it leaves yaw open" in str(caught.value)
