"""Linear model of a robot on two rolling feet, and the controller designed on it."""

from types import SimpleNamespace

import numpy as np
import pytest

from equipoise import nominal_stance
from equipoise.errors import ReachError
from equipoise.lab.balance.balance_model import linear_model, residual
from equipoise.lab.balance.controller import BalanceLaw
from equipoise.lab.balance.two_foot_posture import contact_jacobian, line_through, posture_over_line, stance_legs
from equipoise.robot.kinematics import foot_positions
from equipoise.robot.model import DIAGONALS

PERIOD = 2e-3


@pytest.fixture(scope="module", params=DIAGONALS)
def case(request, a1):
    stance, diagonal = nominal_stance(a1), request.param
    posture = posture_over_line(a1, stance.feet_in_base, diagonal, 0.06, stance.joint_position)
    model = linear_model(a1, posture, diagonal, a1.gains(stance.hip_height), 0.01)
    return SimpleNamespace(robot=a1, stance=stance, diagonal=diagonal, posture=posture, model=model)


def test_support_lines_run_to_the_left_and_their_normals_point_forward(case):
    assert case.posture.left[1] > 0.5
    assert case.posture.forward[0] > 0.5
    right, left = stance_legs(case.diagonal)
    assert (right[1], left[1]) == ("R", "L")
    assert np.allclose(np.cross(case.posture.left, [0, 0, 1]), case.posture.forward, atol=1e-12)


def test_the_centre_of_mass_is_over_the_middle_of_the_line(case):
    assert np.abs(case.posture.com - case.posture.middle)[:2].max() < 1e-8


def test_the_posture_is_at_rest(case):
    at_rest = residual(case.robot, case.posture, case.diagonal, case.robot.configuration(case.posture.joint_position))
    assert np.abs(at_rest).max() < 1e-6  # [N, Nm], of 122 N


def test_the_lifted_feet_are_up(case):
    heights = dict(zip(case.robot.legs, foot_positions(case.robot, case.posture.joint_position)[:, 2], strict=True))
    standing = stance_legs(case.diagonal)
    for leg, height in heights.items():
        assert height - heights[standing[0]] == pytest.approx(0.0 if leg in standing else 0.06, abs=1e-3)


def test_motions_of_the_model_do_not_slip(case):
    configuration = case.robot.configuration(case.posture.joint_position)
    jacobian = contact_jacobian(case.robot, configuration, stance_legs(case.diagonal))
    motions = np.vstack([np.zeros((3, len(case.model.mass))), case.model.of_base, case.model.of_joints])
    motions[:3] = -np.linalg.lstsq(jacobian[:, :3], jacobian[:, 3:] @ motions[3:], rcond=None)[
        0
    ]  # the base's translation follows from the rest
    assert np.abs(jacobian @ motions).max() < 1e-9


def test_gravity_stiffness_is_symmetric(case):
    stiffness = case.model.stiffness
    assert np.abs(stiffness - stiffness.T).max() < 1e-9 * np.abs(stiffness).max()


def test_joint_torques_do_not_turn_the_robot_about_its_line(case):
    assert not case.model.of_joints[:, 0].any()
    _, b, _ = case.model.continuous()
    inputs = case.model.mass @ b[len(b) // 2 :]
    assert np.abs(inputs[0]).max() < 1e-9 * np.abs(inputs).max()


def test_a_rolling_foot_shortens_the_pendulum_by_its_radius(case):
    height = case.posture.com[2] - case.posture.middle[2]
    radius = case.robot.legs["FL"].foot_radius
    assert case.model.stiffness[0, 0] == pytest.approx(-case.robot.mass * 9.81 * (height - radius), rel=1e-9)


def test_the_robot_has_one_unstable_pole(case):
    assert 4.5 < case.model.unstable_pole < 5.5
    poles = np.linalg.eigvals(case.model.continuous()[0])
    assert poles.real.max() > 4
    assert (poles.real > 1e-6).sum() == 1


def test_a_centre_of_mass_that_is_farther_forward_tips_the_robot_forward(case):
    assert case.model.of_offset[0] == pytest.approx(case.robot.mass * 9.81, rel=1e-6)


def test_discrete_and_continuous_models_agree(case):
    a, b, e = case.model.continuous()
    da, db, de = case.model.discrete(1e-6)
    assert np.allclose((da - np.eye(len(a))) / 1e-6, a, rtol=0, atol=1e-2 * np.abs(a).max())
    assert np.allclose(db / 1e-6, b, rtol=0, atol=1e-2 * np.abs(b).max())
    assert np.allclose(de / 1e-6, e, rtol=0, atol=1e-2 * np.abs(e).max())


def test_legs_without_abduction_cannot_shift_the_body_over_the_line(two_jointed):
    stance = nominal_stance(two_jointed)
    feet = stance.feet_in_base + np.array([0, 0.01, 0])
    with pytest.raises(ReachError):
        posture_over_line(two_jointed, feet, "FL_RR", 0.05, stance.joint_position)


def test_a_line_through_feet_at_different_heights_has_a_level_normal():
    along, forward = line_through(np.array([-0.2, -0.1, 0.0]), np.array([0.2, 0.1, 0.02]))
    assert along[2] > 0
    assert forward[2] == 0
    assert forward[1] < 0 < along[1]


def closed_loop(model, law, delay, offset, seconds):
    """Return the (n, states) of the linear robot with the controller."""
    a, b, e = model.discrete(PERIOD)
    sense = np.vstack(
        [
            np.hstack([model.of_joints, 0 * model.of_joints]),
            np.hstack([model.of_base[:2], 0 * model.of_base[:2]]),
            np.hstack([0 * model.of_base, model.of_base]),
        ]
    )
    joints = len(model.of_joints)
    state, states = np.zeros(len(a)), []
    sent = [np.zeros(joints)] * delay
    for _ in range(round(seconds / PERIOD)):
        measured = sense @ state
        sent.append(law.update(measured[:joints], measured[joints : joints + 2], measured[joints + 2 :]))
        state = a @ state + b @ sent.pop(0) + e * offset
        states.append(state)
    return np.array(states)


@pytest.mark.parametrize("delay", [0, 1, 2])
def test_the_controller_balances_the_linear_robot_with_a_lean_per_millimetre_of_offset(case, delay):
    law = BalanceLaw(case.model, PERIOD, delay, 1.0)
    shape = closed_loop(case.model, law, delay, 1e-3, 6.0)[:, : len(case.model.mass)]
    assert np.abs(shape[-1] - shape[-500]).max() < 1e-4  # at rest
    assert case.model.stiffness[0] @ shape[-1] == pytest.approx(1e-3 * case.model.of_offset[0], rel=1e-3)
    assert 0.8 < np.degrees(np.linalg.norm(case.model.of_base @ shape[-1])) < 2.0
