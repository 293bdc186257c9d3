"""Checks of commands before they are sent."""

from dataclasses import replace

import numpy as np
import pytest
from guarded import at_rest, look
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from equipoise import nominal_stance
from equipoise.errors import MotionError, SettingsError
from equipoise.guard.command_checks import CommandChecks
from equipoise.guard.limits import Limits
from equipoise.platform.platform import JointCommand

PERIOD = 2e-3


@pytest.fixture(scope="module")
def stance(a1):
    return nominal_stance(a1)


@pytest.fixture(scope="module")
def check(a1, stance):
    checks = CommandChecks(Limits(), a1, a1.gains(stance.hip_height), PERIOD).in_motion

    def check(command, before=stance.joint_position, here=stance.joint_position):
        look(checks, command, at_rest(a1, joint_position=here), JointCommand(before))

    return check


def with_one(values, joint, value):
    values = np.array(values)
    values[joint] = value
    return values


def test_a_sound_command_passes(check, stance, a1):
    kp, kd = a1.gains(stance.hip_height)
    ones = np.ones(12)
    check(JointCommand(stance.joint_position))
    check(JointCommand(stance.joint_position, 0.5 * ones, 20 * ones, kp * ones, kd * ones))
    check(JointCommand(stance.joint_position, kp=0 * ones, kd=0 * ones))


@pytest.mark.parametrize(
    ("field", "joint", "value", "message"),
    [
        ("position", 0, np.nan, "the commanded position of joint 'FL_hip_joint' is not finite"),
        ("position", 2, -np.inf, "the commanded position of joint 'FL_calf_joint' is not finite"),
        ("velocity", 3, np.nan, "the commanded velocity of joint 'FR_hip_joint' is not finite"),
        ("torque", 11, np.inf, "the commanded torque of joint 'RR_calf_joint' is not finite"),
        ("kp", 4, np.nan, "the commanded kp of joint 'FR_thigh_joint' is not finite"),
        ("kd", 5, np.nan, "the commanded kd of joint 'FR_calf_joint' is not finite"),
        (
            "velocity", 3, 26.0,
            "the commanded velocity of joint 'FR_hip_joint' is 26.00 rad/s; it must be from -25.20 to 25.20",
        ),
        ("torque", 11, -50.0, "the commanded torque of joint 'RR_calf_joint' is -50.00 Nm; it must be from -38.52 to 38.52"),
        ("kp", 4, -1.0, "the commanded kp of joint 'FR_thigh_joint' is -1.00 Nm/rad; it must be from 0.00 to 308.75"),
        ("kp", 4, 500.0, "the commanded kp of joint 'FR_thigh_joint' is 500.00 Nm/rad; it must be from 0.00 to 308.75"),
        ("kd", 5, 10.0, "the commanded kd of joint 'FR_calf_joint' is 10.00 Nm s/rad; it must be from 0.00 to 9.26"),
    ],
)  # fmt: skip
def test_a_command_that_no_joint_should_get_is_refused(check, stance, field, joint, value, message):
    sound = JointCommand(stance.joint_position, np.zeros(12), np.zeros(12), np.zeros(12), np.zeros(12))
    command = replace(sound, **{field: with_one(getattr(sound, field), joint, value)})
    with pytest.raises(MotionError) as caught:
        check(command)
    assert str(caught.value) == message


def test_a_joint_is_not_sent_beyond_its_limits(check, stance):
    target = with_one(stance.joint_position, 2, -2.8)
    with pytest.raises(MotionError) as caught:
        check(JointCommand(target), before=target)
    assert str(caught.value) == (
        "the target of joint 'FL_calf_joint' is -2.800 rad; its limits are -2.697 to -0.916 rad"
    )


def test_a_joint_that_is_beyond_its_limits_by_itself_may_stay_there(check, stance):
    target = with_one(stance.joint_position, 2, -2.8)
    check(JointCommand(target), before=target, here=target)
    farther = with_one(target, 2, -2.81)
    with pytest.raises(MotionError, match=r"is -2\.810 rad"):
        check(JointCommand(farther), before=farther, here=target)


def test_a_jump_is_refused(check, stance):
    with pytest.raises(MotionError) as caught:
        check(JointCommand(with_one(stance.joint_position, 1, stance.joint_position[1] + 0.1)))
    assert str(caught.value) == (
        "the target of joint 'FL_thigh_joint' jumps by 0.100 rad, at 50 rad/s; its limit is 21.0 rad/s"
    )


@pytest.mark.parametrize("field", ["position", "velocity", "torque", "kp", "kd"])
def test_a_command_for_another_number_of_joints_is_refused(check, stance, field):
    command = replace(JointCommand(stance.joint_position), **{field: np.zeros(3)})
    with pytest.raises(SettingsError, match=r"^commands for 3 joints; 'unitree_a1' has 12$"):
        check(command)


@given(
    arrays(float, 12, elements=st.floats(width=64)),
    st.sampled_from(["position", "velocity", "torque", "kp", "kd"]),
)
def test_whatever_passes_is_within_all_limits(check, stance, a1, values, field):
    command = replace(JointCommand(stance.joint_position), **{field: values})
    try:
        check(command)
    except MotionError:
        return
    kp, kd = a1.gains(stance.hip_height)
    most = {
        "position": np.inf, "velocity": 1.2 * a1.velocity_limit, "torque": 1.15 * a1.effort_limit, "kp": 3 * kp, "kd": 3 * kd,
    }  # fmt: skip
    assert (np.abs(values) <= most[field]).all()
    assert field not in ("kp", "kd") or (values >= 0).all()
    if field == "position":
        assert (np.abs(values - stance.joint_position) <= a1.velocity_limit * PERIOD).all()
        assert (values >= a1.lower_limit - 1e-3).all()
        assert (values <= a1.upper_limit + 1e-3).all()
