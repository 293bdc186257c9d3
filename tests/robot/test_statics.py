"""Forces and torques of a robot at rest."""

import itertools

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from robots import load_text, quadruped_urdf

from equipoise.experiments.motion import Motion, Target
from equipoise.experiments.posture import feet_in_posture
from equipoise.robot.description import LEG_NAMES
from equipoise.robot.floor import floor_normal_by_diagonals
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.kinematics import foot_positions, inverse_kinematics
from equipoise.robot.model import DIAGONALS
from equipoise.robot.posture import BodyPosture
from equipoise.robot.stance import nominal_stance
from equipoise.robot.statics import foot_forces, static_torques
from equipoise.simulation.simulation import simulate

WEIGHT = 9.81
SHIFTS = hnp.arrays(float, 12, elements=st.floats(-0.3, 0.3))
STANDING = [legs for count in (2, 3, 4) for legs in itertools.combinations(LEG_NAMES, count)]


@pytest.fixture(scope="module")
def two_joints(tmp_path_factory):
    return load_text(tmp_path_factory.mktemp("robot"), quadruped_urdf(joints_per_leg=2))


@pytest.fixture(scope="module")
def armed(tmp_path_factory):
    return load_text(tmp_path_factory.mktemp("robot"), quadruped_urdf(arm_joints=4))


@pytest.fixture(scope="module", params=["a1", "armed", "two_joints"])
def robot(request):
    return request.getfixturevalue(request.param)


def near_stance(robot, shifts):
    position = nominal_stance(robot).joint_position + shifts[: len(robot.joint_names)]
    return np.clip(position, robot.lower_limit, robot.upper_limit)


def moment_about_com(robot, position, forces):
    arms = foot_positions(robot, position) - composite_parameters(robot, position).com
    return np.cross(arms, forces).sum(axis=0)


def weight(robot, position, legs=LEG_NAMES):
    """Return the (3,) force that carries the robot, in base axes: the normal is that of the standing feet."""
    feet = dict(zip(LEG_NAMES, foot_positions(robot, position), strict=True))
    if len(legs) == 3:
        first, second, third = (feet[leg] for leg in legs)
        up = np.cross(second - first, third - first)
    else:
        up = np.cross(feet["FL"] - feet["RR"], feet["RL"] - feet["FR"])
    return robot.mass * WEIGHT * up / np.linalg.norm(up) * np.sign(up[2])


def torques_by_newton_and_euler(robot, position, forces, legs):
    """Return (6 + nj,) base and joint forces against gravity and foot forces, by recursive Newton-Euler."""
    model, configuration = pin.Model(robot.pinocchio), robot.configuration(position)
    model.gravity.linear = -weight(robot, position, legs) / robot.mass
    data = model.createData()
    pin.framesForwardKinematics(model, data, configuration)
    external = [pin.Force.Zero() for _ in range(model.njoints)]
    for leg, force in zip(robot.legs.values(), forces, strict=True):
        joint = leg.joint_ids[-1]
        in_joint = data.oMi[joint].rotation.T @ force
        arm = model.frames[leg.foot_frame_id].placement.translation
        external[joint] = pin.Force(in_joint, np.cross(arm, in_joint))
    zero = np.zeros(model.nv)
    return pin.rnea(model, data, configuration, zero, zero, external)


@given(shifts=SHIFTS)
def test_four_feet_carry_the_weight_and_no_moment(robot, shifts):
    position = near_stance(robot, shifts)
    forces = foot_forces(robot, position, LEG_NAMES)
    np.testing.assert_allclose(forces.sum(axis=0), weight(robot, position), atol=1e-8)
    np.testing.assert_allclose(moment_about_com(robot, position, forces), 0, atol=1e-8)


@given(shifts=SHIFTS, legs=st.sampled_from([legs for legs in STANDING if len(legs) == 3]))
def test_three_feet_carry_the_weight_and_no_moment(robot, shifts, legs):
    position = near_stance(robot, shifts)
    forces = foot_forces(robot, position, legs)
    np.testing.assert_allclose(forces.sum(axis=0), weight(robot, position, legs), atol=1e-8)
    np.testing.assert_allclose(moment_about_com(robot, position, forces), 0, atol=1e-8)
    for leg, force in zip(robot.legs, forces, strict=True):
        if leg not in legs:
            assert not force.any()


@pytest.mark.parametrize("diagonal", DIAGONALS.values(), ids=DIAGONALS)
def test_two_feet_leave_only_a_moment_about_the_line_between_them(a1, diagonal):
    position = near_stance(a1, 0.1 * np.sin(np.arange(12)))
    forces = foot_forces(a1, position, diagonal)
    feet = dict(zip(a1.legs, foot_positions(a1, position), strict=True))
    line = feet[diagonal[1]] - feet[diagonal[0]]
    line /= np.linalg.norm(line)
    moment = moment_about_com(a1, position, forces)
    assert abs(moment @ line) > 1e-3  # the CoM is off the line
    np.testing.assert_allclose(np.cross(moment, line), 0, atol=1e-8)
    # The least squares leave a little of the weight too: the moment times the CoM's distance from the line, in m.
    arm = feet[diagonal[0]] - composite_parameters(a1, position).com
    distance = np.linalg.norm(np.cross(arm, line))
    force_left = forces.sum(axis=0) - weight(a1, position)
    assert np.linalg.norm(force_left) == pytest.approx(abs(moment @ line) * distance)


def test_forces_are_the_smallest_solution(a1):
    position = nominal_stance(a1).joint_position
    forces = foot_forces(a1, position, LEG_NAMES)
    feet = foot_positions(a1, position)
    # Two feet that pull at each other along the line between them carry nothing: none of that is in the forces.
    for i, j in itertools.combinations(range(4), 2):
        line = (feet[i] - feet[j]) / np.linalg.norm(feet[i] - feet[j])
        assert (forces[i] - forces[j]) @ line == pytest.approx(0, abs=1e-8)


def test_a_robot_that_is_heavier_in_front_presses_more_with_its_front_feet(armed):
    position = nominal_stance(armed).joint_position
    com = composite_parameters(armed, position).com
    forces = foot_forces(armed, position, LEG_NAMES)[:, 2]
    assert com[0] > 0.01
    assert forces[:2].sum() > forces[2:].sum()
    assert (forces > 0).all()


@given(shifts=SHIFTS, legs=st.sampled_from([legs for legs in STANDING if len(legs) >= 3]))
def test_torques_agree_with_newton_euler(robot, shifts, legs):
    position = near_stance(robot, shifts)
    expected = torques_by_newton_and_euler(robot, position, foot_forces(robot, position, legs), legs)
    np.testing.assert_allclose(static_torques(robot, position, legs), expected[6:], atol=1e-8)
    np.testing.assert_allclose(expected[:6], 0, atol=1e-8)  # no force acts on the base


def test_torques_of_a_tipping_robot_agree_at_the_joints(a1):
    position = nominal_stance(a1).joint_position
    expected = torques_by_newton_and_euler(a1, position, foot_forces(a1, position, ("FL", "RR")), ("FL", "RR"))
    np.testing.assert_allclose(static_torques(a1, position, ("FL", "RR")), expected[6:], atol=1e-8)


def test_legs_in_the_air_carry_only_themselves(a1):
    position = nominal_stance(a1).joint_position
    hanging = list(a1.legs["FR"].joints)
    torques = static_torques(a1, position, ("FL", "RL", "RR"))
    alone = pin.computeGeneralizedGravity(a1.pinocchio, a1.pinocchio.createData(), a1.configuration(position))[6:]
    np.testing.assert_allclose(torques[hanging], alone[hanging], atol=1e-12)


@pytest.mark.parametrize("lifted", [0.0, 0.03])
def test_a_rotated_base_is_held_against_gravity_along_the_floor_normal(a1, lifted):
    posture, stance = BodyPosture(roll=0.2, pitch=-0.2, yaw=0.1), nominal_stance(a1)
    feet = feet_in_posture(stance, composite_parameters(a1, stance.joint_position).com, posture)
    feet[[1, 2]] += lifted * posture.rotation[2]
    np.testing.assert_allclose(floor_normal_by_diagonals(feet), posture.rotation[2], atol=1e-12)
    position = inverse_kinematics(a1, feet, stance.joint_position)
    forces = foot_forces(a1, position, LEG_NAMES)
    np.testing.assert_allclose(forces.sum(axis=0), a1.mass * WEIGHT * posture.rotation[2], rtol=1e-3)


def test_soft_drives_with_static_torques_hold_a_rotated_base(a1):
    posture, stance = BodyPosture(roll=0.22, pitch=-0.22, crouch=0.12), nominal_stance(a1)
    com = composite_parameters(a1, stance.joint_position).com
    with simulate(a1, "ideal") as simulation:
        period = simulation.platform.control_period
        motion = Motion(a1, period, Target.standing(a1, stance.joint_position))
        motion.move_feet(feet_in_posture(stance, com, posture), 0.5).hold(1.0)
        simulation.platform.play(motion.build())
        tilt = simulation.ground_truth().tilt
    assert tilt == pytest.approx(np.arccos(posture.rotation[2, 2]), abs=np.radians(0.3))


def test_a_standing_a1_stays_within_its_torque_limits(a1):
    assert (np.abs(static_torques(a1, nominal_stance(a1).joint_position, LEG_NAMES)) < a1.effort_limit / 2).all()
