"""Checks of the base before the first command and in motion, and their messages."""

import numpy as np
import pytest
from guarded import at_rest, look

from equipoise import nominal_stance
from equipoise.errors import FallError, MotionError
from equipoise.guard.base_checks import BaseChecks
from equipoise.guard.check_context import CheckContext
from equipoise.guard.limits import Limits
from equipoise.guard.tilt_filter import TiltFilter
from equipoise.platform.platform import JointCommand
from equipoise.robot.stance import lying_posture


@pytest.fixture
def checks(a1):
    return BaseChecks(Limits(), a1, nominal_stance(a1))


@pytest.fixture(scope="module")
def hold(a1):
    return JointCommand(nominal_stance(a1).joint_position)


def leaning(robot, angle, **changes):
    """A robot at rest whose base is turned about its y axis [rad]."""
    return at_rest(robot, acceleration_in_imu=9.81 * np.array([-np.sin(angle), 0.0, np.cos(angle)]), **changes)


def test_before_anything_moves_gravity_is_measured(a1, checks, hold):
    look(checks.at_rest, hold, at_rest(a1))
    with pytest.raises(MotionError) as caught:
        look(checks.at_rest, hold, at_rest(a1, acceleration_in_imu=np.array([0.0, 0.0, 1.0])))
    assert str(caught.value) == (
        "the accelerometer reads 1.0 m/s2 before the first command; gravity is 9.8 m/s2. Check its units, and "
        "keep the robot still"
    )


def test_before_anything_moves_the_base_is_upright(a1, checks, hold):
    look(checks.at_rest, hold, leaning(a1, 0.34))
    with pytest.raises(FallError) as caught:
        look(checks.at_rest, hold, leaning(a1, 0.36))
    assert str(caught.value) == (
        "the base leans by 21 deg before the first command. If the robot has fallen, set it upright. If the IMU is rotated: "
        "--imu-rpy 0.000 0.360 0.000 (imu_rpy in a robot configuration) brings gravity upright; it leaves yaw open"
    )


def test_on_four_feet_the_base_does_not_lean(a1, checks, hold):
    look(checks.in_motion, hold, leaning(a1, 0.34))
    with pytest.raises(FallError) as caught:
        look(checks.in_motion, hold, leaning(a1, 0.36))
    assert str(caught.value) == ("the base leans by 21 deg from its commanded posture: the robot is falling")


def test_on_two_feet_it_may_lean_farther_and_for_a_second_after_them(a1, checks, hold):
    raised = np.array(hold.position)
    raised[[2, 11]] -= 0.1  # the knees of FL and RR
    look(checks.in_motion, JointCommand(raised), leaning(a1, 0.59, time=1.0), standing=hold)
    look(checks.in_motion, hold, leaning(a1, 0.59, time=1.9))
    with pytest.raises(FallError):
        look(checks.in_motion, hold, leaning(a1, 0.61, time=1.9))
    with pytest.raises(FallError):
        look(checks.in_motion, hold, leaning(a1, 0.59, time=2.1))


def test_on_three_feet_it_may_lean_no_farther_than_on_four(a1, checks, hold):
    """Nor does the foot in the air turn the floor, which is where the others stand."""
    raised = np.array(hold.position)
    raised[2] -= 0.5  # the knee of FL
    look(checks.in_motion, JointCommand(raised), leaning(a1, 0.34, time=1.0), standing=hold)
    for angle in (-0.36, 0.36):
        with pytest.raises(FallError):
            look(checks.in_motion, JointCommand(raised), leaning(a1, angle, time=1.1), standing=hold)


def test_a_robot_that_lies_has_no_feet_lifted(a1, checks, hold):
    lying, _ = lying_posture(a1, nominal_stance(a1))
    for position, lifted in ((hold.position, True), (lying, False)):
        raised = np.array(position)
        raised[[2, 11]] += 0.2  # the knees of FL and RR
        context = CheckContext(at_rest(a1), JointCommand(raised), JointCommand(raised), hold, TiltFilter(np.eye(3)))
        for check in checks.in_motion:
            check(context.sent, context)
        assert context.lifted == lifted
