"""Limit of motions on two feet, from gyroscope and encoders."""

import numpy as np
import pytest

from equipoise.platform.tilt_limit import TiltLimit, TiltTest

PERIOD = 0.002
STILL = np.zeros((50, 12))


def first_reached(limit, angular_velocity_in_imu, joint_position=STILL, at_once=1):
    """Number of samples, in portions, after which a limit is reached; None if it never is."""
    test = TiltTest(limit, PERIOD)
    for begin in range(0, len(angular_velocity_in_imu), at_once):
        part = slice(begin, begin + at_once)
        if test.reached(angular_velocity_in_imu[part], joint_position[part]):
            return begin + at_once
    return None


def turning(axis, rate, count=50):
    return np.tile(np.array(axis) * rate, (count, 1))


@pytest.mark.parametrize(
    ("axis", "rate", "after"),
    [([0, 1, 0], 1.0, 25), ([0, -1, 0], 1.0, 25), ([0, 1, 0], 0.4, None), ([1, 0, 1], 9.0, None)],
)
def test_an_angle_counts_both_ways_about_its_own_axis_only(axis, rate, after):
    assert first_reached(TiltLimit(0.05 - 1e-9, (0.0, 1.0, 0.0)), turning(axis, rate)) == after


def test_no_limit_is_never_reached():
    assert first_reached(None, turning([1, 1, 1], 1e3)) is None


def test_joints_that_move_the_com_back_take_the_lean_of_the_base_away():
    """A body that is turned by its legs, and one that topples: the same gyroscope."""
    weights = tuple(np.full(12, 1 / 12))
    limit = TiltLimit(0.03, (0.0, 1.0, 0.0), weights)
    path = -np.cumsum(np.full(50, PERIOD))[:, None] * np.ones(12) + 0.7  # where joints start does not matter
    assert first_reached(limit, turning([0, 1, 0], 1.0)) == 15
    assert first_reached(limit, turning([0, 1, 0], 1.0), path) is None
    assert first_reached(limit, np.zeros((50, 3)), path) == 16


@pytest.mark.parametrize("sign", [1, -1])
def test_a_fast_robot_is_stopped_before_a_slow_one_that_leans_as_much(sign):
    bounds = (-0.1, 0.3) if sign < 0 else (-0.3, 0.1)
    limit = TiltLimit(1.0, (0.0, 1.0, 0.0), horizon=0.2, bounds=bounds)
    assert first_reached(limit, turning([0, sign, 0], 0.6)) == 1
    # 0.2 s times 0.4 rad/s leave 0.02 rad: 25 samples.
    assert first_reached(limit, turning([0, sign, 0], 0.4 + 1e-9)) == 25
    assert first_reached(limit, turning([0, -sign, 0], 0.6)) is None


def test_the_rate_is_shared_between_the_com_and_the_turning_body():
    """The base turns, the CoM stays: only the share of the body's own momentum counts."""
    generator = np.random.default_rng(0)
    turn = np.cumsum(generator.standard_normal(50))
    angular_velocity_in_imu = np.outer(turn, [0, 1, 0])
    weights = (1.0, *np.zeros(11))
    path = np.zeros((50, 12))
    path[:, 0] = -np.cumsum(turn) * PERIOD
    path[:, 0] -= path[0, 0]
    for spin in (0.3, 0.6):
        largest = 0.1 * np.abs(turn).max() * spin
        limit = TiltLimit(1.0, (0.0, 1.0, 0.0), weights, 0.1, spin, (-0.9 * largest, 0.9 * largest), PERIOD)
        assert first_reached(limit, angular_velocity_in_imu, path) is not None
        wider = TiltLimit(1.0, (0.0, 1.0, 0.0), weights, 0.1, spin, (-1.1 * largest, 1.1 * largest), PERIOD)
        assert first_reached(wider, angular_velocity_in_imu, path) is None


@pytest.mark.parametrize("at_once", [2, 5, 25])
def test_samples_by_the_portion_are_samples_one_by_one(at_once):
    generator = np.random.default_rng(3)
    angular_velocity_in_imu = 0.5 * generator.standard_normal((50, 3)) + np.linspace(0, 2, 50)[:, None]
    joints = 0.01 * generator.standard_normal((50, 12))
    weights = tuple(generator.standard_normal(12))
    for bound in (0.1, 0.2, 0.4):
        limit = TiltLimit(1.0, (0.3, -0.5, 0.8), weights, 0.2, 0.2, (-bound, bound), 4 * PERIOD)
        one_by_one = first_reached(limit, angular_velocity_in_imu, joints)
        assert first_reached(limit, angular_velocity_in_imu, joints, at_once) == -(-one_by_one // at_once) * at_once
