"""Foot positions, Jacobians and inverse kinematics."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from robots import load_text, quadruped_urdf

from equipoise.errors import MotionError, ReachError
from equipoise.robot.kinematics import (
    REACH_TOLERANCE_RATIO,
    feet_under_base,
    foot_forces_from_torques,
    foot_jacobians,
    foot_positions,
    inverse_kinematics,
    inverse_kinematics_best_effort,
)
from equipoise.robot.stance import nominal_stance

SHARES = hnp.arrays(float, 12, elements=st.floats(0, 1))
SHIFTS = hnp.arrays(float, 12, elements=st.floats(-0.3, 0.3))
VECTORS = hnp.arrays(float, 3, elements=st.floats(-1, 1))


@pytest.fixture(scope="module")
def three_joints(tmp_path_factory):
    return load_text(tmp_path_factory.mktemp("robot"), quadruped_urdf())


@pytest.fixture(scope="module")
def two_joints(tmp_path_factory):
    return load_text(tmp_path_factory.mktemp("robot"), quadruped_urdf(joints_per_leg=2, knee_range=(-2.6, -0.2)))


@pytest.fixture(scope="module", params=["a1", "three_joints", "two_joints"])
def robot(request):
    return request.getfixturevalue(request.param)


def within_limits(robot, shares):
    """Return joint positions at these shares of their ranges."""
    return robot.lower_limit + shares[: len(robot.joint_names)] * (robot.upper_limit - robot.lower_limit)


def walking(robot, shares):
    """Return joint positions with feet within half a radian of the points below the hips, knees bent by 0.5 to 2.2.

    At straight knees, and with a foot level with its hip, several solutions exist; inverse kinematics picks one.
    """
    position = np.zeros(len(robot.joint_names))
    for leg, (abduction, swing, bend) in zip(robot.legs.values(), shares.reshape(4, 3), strict=True):
        knee = -0.5 - 1.7 * bend
        position[list(leg.joints)] = [abduction - 0.5, swing - 0.5 - knee / 2, knee][-len(leg.joints) :]
    return np.clip(position, robot.lower_limit, robot.upper_limit)


# --- forward


@given(shares=SHARES)
def test_jacobians_are_the_derivative_of_foot_positions(robot, shares):
    position = within_limits(robot, shares)
    step = 1e-6
    for index, (leg, jacobian) in enumerate(zip(robot.legs.values(), foot_jacobians(robot, position), strict=True)):
        for joint, column in zip(leg.joints, jacobian.T, strict=True):
            moved = step * np.eye(len(position))[joint]
            change = foot_positions(robot, position + moved) - foot_positions(robot, position - moved)
            np.testing.assert_allclose(column, change[index] / (2 * step), atol=1e-8)
            others = np.delete(change, index, axis=0)
            np.testing.assert_allclose(others, 0, atol=1e-12)  # a joint moves no other leg's foot


def test_shapes_are_feet_by_axes_by_the_legs_joints(robot):
    count = len(robot.joint_names)
    assert foot_positions(robot, np.zeros(count)).shape == (4, 3)
    assert foot_jacobians(robot, np.zeros(count)).shape == (4, 3, count // 4)


def test_a_straight_leg_hangs_below_its_hip(three_joints):
    expected = [[x, y, -0.4] for x, y in ((0.2, 0.18), (0.2, -0.18), (-0.2, 0.18), (-0.2, -0.18))]
    np.testing.assert_allclose(foot_positions(three_joints, np.zeros(12)), expected, atol=1e-12)


def test_positive_pitch_swings_a_foot_backward(three_joints):
    position = np.zeros(12)
    position[[leg.joints[1] for leg in three_joints.legs.values()]] = 0.3
    swung = foot_positions(three_joints, position) - foot_positions(three_joints, np.zeros(12))
    np.testing.assert_allclose(swung[:, 0], -0.4 * np.sin(0.3))


# --- inverse


@given(shares=SHARES, shifts=SHIFTS)
def test_feet_are_brought_where_joints_can_bring_them(robot, shares, shifts):
    position = walking(robot, shares)
    wanted = foot_positions(robot, position)
    start = position + shifts[: len(position)]
    found = inverse_kinematics(robot, wanted, start)
    misses = np.linalg.norm(foot_positions(robot, found) - wanted, axis=1)
    assert misses.max() <= REACH_TOLERANCE_RATIO * robot.leg_length
    assert (found >= robot.lower_limit).all()
    assert (found <= robot.upper_limit).all()


@given(shares=SHARES)
def test_reachable_targets_are_reached_to_a_micrometre(robot, shares):
    position = walking(robot, shares)
    wanted = foot_positions(robot, position)
    found = inverse_kinematics(robot, wanted, position + 0.05)
    np.testing.assert_allclose(foot_positions(robot, found), wanted, atol=1e-6)


@given(wanted=hnp.arrays(float, (4, 3), elements=st.floats(-2, 2)), shares=SHARES)
def test_joint_limits_hold_for_any_targets(robot, wanted, shares):
    found = inverse_kinematics_best_effort(robot, wanted, within_limits(robot, shares))
    assert np.isfinite(found).all()
    assert (found >= robot.lower_limit).all()
    assert (found <= robot.upper_limit).all()


def test_the_start_determines_the_bending_side_of_knees(three_joints):
    stance = nominal_stance(three_joints)
    for sign in (-1, 1):
        start = np.tile([0, -0.7 * sign, 1.4 * sign], 4)
        knees = inverse_kinematics(three_joints, stance.feet_in_base, start)[2::3]
        assert (np.sign(knees) == sign).all()


def test_a_foot_out_of_reach_is_named_with_what_it_misses(a1):
    stance = nominal_stance(a1)
    wanted = stance.feet_in_base.copy()
    wanted[2, 2] -= 0.2
    with pytest.raises(ReachError) as error:
        inverse_kinematics(a1, wanted, stance.joint_position)
    best = inverse_kinematics_best_effort(a1, wanted, stance.joint_position)
    miss = np.linalg.norm(foot_positions(a1, best)[2] - wanted[2]) * 1000
    assert 50 < miss < 200
    assert str(error.value) == (
        f"the RL foot misses its place by {miss:.1f} mm (allowed 0.4 mm): joint RL_calf_joint is at its limit"
    )
    assert isinstance(error.value, MotionError)
    assert error.value.exit_code == 4


def test_a_foot_off_the_plane_of_a_two_joint_leg_is_out_of_reach(two_joints):
    stance = nominal_stance(two_joints)
    wanted = stance.feet_in_base.copy()
    wanted[1, 1] += 0.01
    with pytest.raises(ReachError) as error:
        inverse_kinematics(two_joints, wanted, stance.joint_position)
    assert str(error.value) == (
        "the FR foot misses its place by 10.0 mm (allowed 0.4 mm): the leg is too short or lacks a joint"
    )
    found = inverse_kinematics(two_joints, wanted, stance.joint_position, tolerance=0.011)
    np.testing.assert_allclose(foot_positions(two_joints, found)[:, [0, 2]], wanted[:, [0, 2]], atol=1e-6)


def test_nan_targets_are_not_reached(a1):
    stance = nominal_stance(a1)
    wanted = stance.feet_in_base.copy()
    wanted[0, 0] = np.nan
    with pytest.raises(ReachError, match="the FL foot misses its place by nan mm"):
        inverse_kinematics(a1, wanted, stance.joint_position)


# --- base motion


@given(translation=VECTORS, turn=VECTORS)
def test_standing_feet_stay_where_they_are_in_the_world(translation, turn):
    feet = np.random.default_rng(0).normal(size=(4, 3))
    pose = pin.SE3(pin.exp3(turn), translation)
    moved = feet_under_base(feet, translation, pose.rotation)
    np.testing.assert_allclose([pose.act(foot) for foot in moved], feet, atol=1e-12)
    distances = [np.linalg.norm(f[:, None] - f, axis=2) for f in (feet, moved)]
    np.testing.assert_allclose(distances[0], distances[1], atol=1e-12)


@given(first=VECTORS, second=VECTORS)
def test_base_motions_follow_one_another(first, second):
    feet = np.random.default_rng(1).normal(size=(4, 3))
    a, b = pin.SE3(pin.exp3(first), second), pin.SE3(pin.exp3(second), first)
    in_steps = feet_under_base(feet_under_base(feet, a.translation, a.rotation), b.translation, b.rotation)
    both = a * b
    np.testing.assert_allclose(in_steps, feet_under_base(feet, both.translation, both.rotation), atol=1e-12)


def test_a_base_that_rises_has_its_feet_farther_below():
    np.testing.assert_array_equal(feet_under_base(np.zeros((4, 3)), np.array([0, 0, 0.1]), np.eye(3))[:, 2], -0.1)


# --- forces


@given(forces=hnp.arrays(float, (4, 3), elements=st.floats(-100, 100)), shares=SHARES)
def test_forces_of_three_joint_legs_are_found_from_their_torques(a1, forces, shares):
    position = walking(a1, shares)
    torques = np.zeros(12)
    for leg, jacobian, force in zip(a1.legs.values(), foot_jacobians(a1, position), forces, strict=True):
        torques[list(leg.joints)] = -jacobian.T @ force
    np.testing.assert_allclose(foot_forces_from_torques(a1, position, torques), forces, atol=1e-7)


@given(forces=hnp.arrays(float, (4, 3), elements=st.floats(-100, 100)), shares=SHARES)
def test_two_joint_legs_determine_forces_in_their_plane(two_joints, forces, shares):
    position = walking(two_joints, shares)
    torques = np.zeros(8)
    for leg, jacobian, force in zip(
        two_joints.legs.values(), foot_jacobians(two_joints, position), forces, strict=True
    ):
        torques[list(leg.joints)] = -jacobian.T @ force
    found = foot_forces_from_torques(two_joints, position, torques)
    np.testing.assert_allclose(found[:, [0, 2]], forces[:, [0, 2]], atol=1e-7)
    np.testing.assert_allclose(found[:, 1], 0, atol=1e-9)  # their joints turn about y
