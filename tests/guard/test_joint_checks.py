"""Joints and motors held against the limits, sample by sample: each check has its fault and its words."""

from dataclasses import replace

import numpy as np
import pytest
from guarded import PERIOD, at_rest, look

from equipoise import nominal_stance
from equipoise.errors import MotionError, SettingsError, StoppedError
from equipoise.guard.joint_checks import JointChecks
from equipoise.guard.limits import Limits
from equipoise.platform.platform import Health, JointCommand

LASTING = round(0.15 / PERIOD)  # control periods that an excess may last


@pytest.fixture(scope="module")
def stance(a1):
    return nominal_stance(a1)


@pytest.fixture
def checks(a1, stance):
    return JointChecks(Limits(), a1, stance.hip_height, PERIOD, uses_gains=True)


@pytest.fixture
def hold(stance):
    return JointCommand(stance.joint_position)


def with_one(values, joint, value):
    values = np.array(values)
    values[joint] = value
    return values


def run_checks(checks, states, command):
    """The error that states raise, and how many passed before."""
    for count, state in enumerate(states):
        try:
            look((*checks.in_motion, *checks.health), command, state)
        except MotionError as error:
            return error, count
    return None, count + 1


def lasting(robot, change, count=1000):
    return [change(at_rest(robot, index)) for index in range(count)]


def test_a_sound_robot_passes(a1, checks, hold):
    assert run_checks(checks, lasting(a1, lambda state: state), hold)[0] is None


def test_an_encoder_far_beyond_a_joints_limits_is_no_joint(a1, checks, hold):
    def change(state):
        return replace(state, joint_position=with_one(state.joint_position, 2, 0.5))

    error, count = run_checks(checks, lasting(a1, change), hold)
    assert type(error) is MotionError
    assert str(error) == (
        "joint 'FL_calf_joint' is at 0.500 rad; its limits are -2.697 to -0.916 rad. Check the joint map and the offsets"
    )
    assert count == 0


@pytest.mark.parametrize(
    ("change", "kind", "message"),
    [
        (
            lambda state: replace(state, joint_velocity=with_one(state.joint_velocity, 4, -30.0), joint_torque=None),
            MotionError,
            "joint 'FR_thigh_joint' turns at -30.0 rad/s; its limit is 21.0 rad/s",
        ),
        (
            lambda state: replace(state, joint_torque=with_one(state.joint_torque, 11, 45.0)),
            MotionError,
            "joint 'RR_calf_joint' gives 45.0 Nm; its limit is 33.5 Nm",
        ),
        (
            lambda state: replace(state, joint_position=with_one(state.joint_position, 1, 1.4), joint_torque=None),
            MotionError,
            "joint 'FL_thigh_joint' is 0.68 rad from its target: is it stuck, or has its motor lost power?",
        ),
    ],
)
def test_what_lasts_too_long_ends_the_run(a1, stance, hold, change, kind, message):
    checks = JointChecks(Limits(), a1, stance.hip_height, PERIOD, uses_gains=False)
    error, count = run_checks(checks, lasting(a1, change), hold)
    assert type(error) is kind
    assert str(error) == message
    assert count == pytest.approx(LASTING, abs=1)


def test_what_is_over_soon_does_not(a1, checks, hold):
    states = []
    for index in range(1000):
        state = at_rest(a1, index)
        fast = with_one(state.joint_velocity, 4, -30.0 if index % LASTING else 0.0)
        states.append(replace(state, joint_velocity=fast, joint_torque=None))
    assert run_checks(checks, states, hold)[0] is None


def test_a_joint_that_runs_away_is_not_waited_for(a1, checks, hold):
    away = replace(at_rest(a1), joint_position=with_one(hold.position, 1, 2.0))
    error, count = run_checks(checks, [away], hold)
    assert str(error).startswith("joint 'FL_thigh_joint' is 1.28 rad from its target")
    assert count == 0


def test_a_joint_that_does_not_move_is_stuck(a1, checks, stance):
    def sent(index):
        swing = 0.1 * np.sin(2 * np.pi * index * PERIOD)
        return JointCommand(with_one(stance.joint_position, 7, stance.joint_position[7] + swing))

    errors = [run_checks(checks, [replace(at_rest(a1, i), joint_torque=None)], sent(i))[0] for i in range(600)]
    (error,) = (error for error in errors if error is not None)
    assert type(error) is MotionError
    assert str(error) == (
        "joint 'RL_thigh_joint' moved by 0.00 rad while its target moved by 0.18 rad: is it stuck, "
        "or has its motor lost power?"
    )


def test_a_motor_that_gives_nothing_is_noticed(a1, checks, stance):
    """It stays where it is, as a lightly loaded joint does, and still is not what it was sent."""
    torque = with_one(np.zeros(12), 5, 8.0)
    error, count = run_checks(
        checks, lasting(a1, lambda state: state), JointCommand(stance.joint_position, torque=torque)
    )
    assert type(error) is MotionError
    assert str(error) == (
        "the motor of joint 'FR_calf_joint' gives 0.0 Nm; its position and its command require 8.0 Nm: is the "
        "motor on, and does it use the commanded gains?"
    )
    assert count * PERIOD < 0.3


def test_a_motor_at_its_limit_gives_what_it_can(a1, checks, stance):
    """Sent twice what it can give, it is not to blame."""
    torque = with_one(np.zeros(12), 5, 60.0)
    states = lasting(a1, lambda state: replace(state, joint_torque=with_one(state.joint_torque, 5, 33.0)))
    assert run_checks(checks, states, JointCommand(stance.joint_position, torque=torque))[0] is None


def test_unknown_gains_predict_no_torque(a1, stance):
    checks = JointChecks(Limits(), a1, stance.hip_height, PERIOD, uses_gains=False)
    torque = with_one(np.zeros(12), 5, 8.0)
    states = lasting(a1, lambda state: state)
    assert run_checks(checks, states, JointCommand(stance.joint_position, torque=torque))[0] is None


def test_a_robot_that_reports_neither_speed_nor_torque_is_watched_all_the_same(a1, checks, hold):
    def change(state):
        return replace(state, joint_velocity=None, joint_torque=None)

    assert run_checks(checks, lasting(a1, change), hold)[0] is None
    away = lasting(a1, lambda state: replace(change(state), joint_position=state.joint_position + 0.6))
    assert type(run_checks(checks, away, hold)[0]) is MotionError


def test_limp_joints_are_asked_for_nothing(a1, checks, stance):
    limp = JointCommand(stance.joint_position, kp=np.zeros(12), kd=np.ones(12))
    states = lasting(a1, lambda state: replace(state, joint_position=state.joint_position + 0.3))
    assert run_checks(checks, states, limp)[0] is None


@pytest.mark.parametrize(
    ("health", "message"),
    [
        (
            Health(motor_temperature=with_one(np.full(12, 40.0), 8, 81.0)),
            "the motor of joint 'RL_calf_joint' is at 81 deg C; 75 deg C is allowed. Let it cool down",
        ),
        (Health(fault="motor 3 lost"), "the robot reports a fault: motor 3 lost"),
        (Health(battery_charge=0.08), "the battery charge is 8%; at least 10% is needed. Charge it"),
    ],
)
def test_faults_that_the_robot_reports_are_raised(a1, checks, hold, health, message):
    error, _ = run_checks(checks, lasting(a1, lambda state: replace(state, health=health)), hold)
    assert (type(error), error.exit_code) == (StoppedError, 12)
    assert str(error) == message


def test_one_hot_reading_is_a_glitch(a1, checks, hold):
    hot = Health(motor_temperature=with_one(np.full(12, 40.0), 8, 255.0))
    states = lasting(a1, lambda state: replace(state, health=hot if round(state.time / PERIOD) == 50 else Health()))
    assert run_checks(checks, states, hold)[0] is None


def test_before_anything_moves_joints_are_within_their_limits(a1, checks, hold):
    look(checks.at_rest, hold, at_rest(a1))
    with pytest.raises(MotionError, match="Check the joint map and the offsets"):
        look(checks.at_rest, hold, at_rest(a1, joint_position=np.full(12, 1.0)))


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan")])
def test_a_limit_is_a_positive_number(value):
    with pytest.raises(SettingsError, match=rf"^limit speed is {value}; it must be a positive number$"):
        Limits(speed=value)
