"""Soft start: commands of the first second are smooth."""

from dataclasses import replace

import numpy as np
import pytest
from guarded import PERIOD, at_rest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from equipoise import nominal_stance, simulate
from equipoise.experiments.motion import Target
from equipoise.guard.soft_start import SOFT_START, soft_start
from equipoise.platform.platform import JointCommand

COUNT = round(SOFT_START / PERIOD)
NO_LIMITS = np.array([[-10.0], [10.0]]) * np.ones(12)


@pytest.fixture(scope="module")
def gains(a1):
    kp, kd = a1.gains(nominal_stance(a1).hip_height)
    return np.full(12, kp), np.full(12, kd)


@pytest.fixture(scope="module")
def first(a1):
    target = Target.standing(a1, nominal_stance(a1).joint_position)
    return JointCommand(target.joint_position, torque=target.torque)


def pull(command, state, gains):
    """(nj,) what joints at rest are made to give [Nm]."""
    kp = gains[0] if command.kp is None else command.kp
    return kp * (command.position - state.joint_position) + (0 if command.torque is None else command.torque)


@given(
    offset=arrays(float, 12, elements=st.floats(-0.1, 0.1)), measured=arrays(float, 12, elements=st.floats(-30, 30)),
    limp=st.booleans(), has_gains=st.booleans(),
)  # fmt: skip
def test_it_begins_where_the_robot_is_and_never_jumps(a1, gains, first, offset, measured, limp, has_gains):
    state = at_rest(a1, joint_position=first.position + offset, joint_torque=measured)
    commands = list(soft_start(first, state, gains if has_gains else None, limp, PERIOD, NO_LIMITS))
    assert len(commands) == COUNT
    torques = np.array([pull(command, state, gains) for command in commands])
    positions = np.array([command.position for command in commands])
    steps = np.abs(np.diff(torques, axis=0)).max()
    assert steps < 0.2  # [Nm] from one control period to the next
    assert np.abs(np.diff(positions, axis=0)).max() < 0.5e-3
    # What it begins with lies between nothing and what the joint gives by itself: no torque that is new to it.
    begin = torques[0]
    assert (np.abs(begin) <= np.abs(measured) + 0.1).all()
    assert (begin * measured >= -0.1).all()
    last = commands[-1]
    assert np.allclose(last.position, first.position)
    assert np.allclose(last.torque, first.torque)


def test_a_limp_robot_gets_its_stiffness_by_and_by(a1, gains, first):
    state = at_rest(a1, joint_torque=np.zeros(12))
    commands = list(soft_start(first, state, gains, True, PERIOD, NO_LIMITS))
    stiffness = np.array([command.kp for command in commands])
    assert stiffness[0].max() < 0.01 * gains[0].max()
    assert (np.diff(stiffness, axis=0) >= 0).all()
    assert np.allclose(stiffness[-1], gains[0])
    assert all(np.array_equal(command.kd, gains[1]) for command in commands)


def test_a_limp_robot_that_hangs_in_its_stops_is_not_held_beyond_its_limits(a1, gains, first):
    allowed = np.stack([a1.lower_limit, a1.upper_limit])
    beyond = np.array(first.position)
    beyond[2] = a1.lower_limit[2] - 0.02
    commands = soft_start(first, at_rest(a1, joint_position=beyond), gains, True, PERIOD, allowed)
    assert all(command.position[2] >= a1.lower_limit[2] for command in commands)


def test_a_platform_without_gains_is_sent_none(a1, first):
    for command in soft_start(first, at_rest(a1), None, True, PERIOD, NO_LIMITS):
        assert command.kp is None
        assert command.kd is None


def test_gains_of_the_first_command_are_what_a_limp_robot_grows_into(a1, gains, first):
    own = replace(first, kp=np.full(12, 40.0), kd=np.full(12, 1.0))
    *_, last = soft_start(own, at_rest(a1), gains, True, PERIOD, NO_LIMITS)
    assert np.array_equal(last.kp, own.kp)
    assert np.array_equal(last.kd, own.kd)


@pytest.mark.parametrize("reported", [True, False])
def test_a_standing_robot_hardly_notices(a1, gains, reported):
    """It sinks where its torques are not known: by what they then lack at first."""
    with simulate(a1, "realistic", "1,0.05,0.02,0.08", seed=3) as simulation:
        platform, ground_truth = simulation.platform, simulation.ground_truth
        state = platform.read()
        target = Target.standing(a1, np.array(state.joint_position))
        first = JointCommand(target.joint_position, torque=target.torque)
        before = ground_truth().com[2]
        sunk = 0.0
        seen = state if reported else replace(state, joint_torque=None)
        for command in soft_start(first, seen, gains, False, PERIOD, NO_LIMITS):
            platform.step(command)
            sunk = max(sunk, before - ground_truth().com[2])
    assert sunk < (0.004 if reported else 0.03)
