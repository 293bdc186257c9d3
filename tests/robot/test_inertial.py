"""Inertial parameters of bodies, of joined bodies, and of the three bodies of results."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from robots import FOUR_LEGS, load_text, quadruped_urdf

from equipoise.errors import SettingsError
from equipoise.robot.inertial import (
    InertialParameters,
    base_parameters,
    composite_parameters,
    nominal_inertia,
    stance_effective_parameters,
)

POINTS = hnp.arrays(float, (6, 3), elements=st.floats(-1, 1))
SHARES = hnp.arrays(float, 12, elements=st.floats(0, 1))


@st.composite
def bodies(draw):
    """Draw six point masses, each with a ball around it, so that the result is physical."""
    points, masses = draw(POINTS), draw(hnp.arrays(float, 6, elements=st.floats(0.01, 5)))
    com = masses @ points / masses.sum()
    inertia = masses.sum() * 1e-3 * np.eye(3) + point_inertia(masses, points - com)
    return InertialParameters(float(masses.sum()), com, inertia)


def point_inertia(masses, positions):
    """Return the inertia about the origin, from the definition."""
    return sum(m * (r @ r * np.eye(3) - np.outer(r, r)) for m, r in zip(masses, positions, strict=True))


@pytest.fixture(scope="module")
def armed(tmp_path_factory):
    return load_text(tmp_path_factory.mktemp("robot"), quadruped_urdf(arm_joints=2))


@pytest.fixture(scope="module", params=["a1", "armed"])
def robot(request):
    return request.getfixturevalue(request.param)


def assert_same_body(found, expected, tolerance=1e-10):
    assert found.mass == pytest.approx(expected.mass, rel=1e-12)
    np.testing.assert_allclose(found.com, expected.com, atol=tolerance)
    np.testing.assert_allclose(found.inertia, expected.inertia, atol=tolerance)


def joined_by_hand(robot, joint_position, joints):
    """Return mass, CoM and inertia of joints' bodies by the parallel axis theorem, without Pinocchio's inertia algebra."""
    data = robot.pinocchio.createData()
    pin.forwardKinematics(robot.pinocchio, data, robot.configuration(joint_position))
    masses, coms, inertias = [], [], []
    for joint in joints:
        pose, body = data.oMi[joint], robot.pinocchio.inertias[joint]
        masses.append(body.mass)
        coms.append(pose.rotation @ body.lever + pose.translation)
        inertias.append(pose.rotation @ body.inertia @ pose.rotation.T)
    masses, coms = np.array(masses), np.array(coms)
    com = masses @ coms / masses.sum()
    return InertialParameters(float(masses.sum()), com, sum(inertias) + point_inertia(masses, coms - com))


# --- the robot's bodies


@given(shares=SHARES)
def test_the_composite_is_all_bodies_by_the_parallel_axis_theorem(robot, shares):
    position = robot.lower_limit + shares * (robot.upper_limit - robot.lower_limit)
    expected = joined_by_hand(robot, position, range(1, robot.pinocchio.njoints))
    assert_same_body(composite_parameters(robot, position), expected)
    assert expected.mass == pytest.approx(robot.mass)


@given(shares=SHARES)
def test_the_papers_body_excludes_links_below_the_knees(robot, shares):
    position = robot.lower_limit + shares * (robot.upper_limit - robot.lower_limit)
    shanks = {leg.joint_ids[-1] for leg in robot.legs.values()}
    expected = joined_by_hand(robot, position, [j for j in range(1, robot.pinocchio.njoints) if j not in shanks])
    assert_same_body(stance_effective_parameters(robot, position), expected)


def test_the_papers_body_does_not_depend_on_the_knees(a1):
    position = np.tile([0.1, 0.8, -1.6], 4)
    bent = position.copy()
    bent[2::3] = -2.4
    assert_same_body(stance_effective_parameters(a1, position), stance_effective_parameters(a1, bent), 1e-14)


@pytest.mark.parametrize("joints", [2, 3])
def test_the_base_includes_all_links_that_move_with_the_trunk(tmp_path, joints):
    robot = load_text(tmp_path, quadruped_urdf(joints_per_leg=joints))
    base = base_parameters(robot)
    assert base.mass == 6.0
    np.testing.assert_allclose(base.com, [0.01, 0.002, 0.005])
    np.testing.assert_allclose(np.diag(base.inertia), [0.02, 0.06, 0.065])
    np.testing.assert_allclose(base.inertia[np.triu_indices(3, 1)], [1e-4, 6e-4, 3e-5])


def test_nominal_inertia_is_the_three_of_them(a1):
    position = np.tile([0.0, 0.8, -1.6], 4)
    inertia = nominal_inertia(a1, position)
    assert_same_body(inertia.composite, composite_parameters(a1, position), 0)
    assert_same_body(inertia.base, base_parameters(a1), 0)
    assert_same_body(inertia.stance_effective, stance_effective_parameters(a1, position), 0)
    assert inertia.base.mass < inertia.stance_effective.mass < inertia.composite.mass == a1.mass


def test_symmetric_legs_keep_the_com_on_the_middle_plane(tmp_path):
    text = quadruped_urdf().replace('xyz="0.01 0.002 0.005"', 'xyz="0.01 0.0 0.005"')
    robot = load_text(tmp_path, text)
    position = np.tile([0.2, 0.8, -1.6], 4)
    for leg in ("FR", "RR"):
        position[robot.legs[leg].joints[0]] *= -1
    assert composite_parameters(robot, position).com[1] == pytest.approx(0, abs=1e-12)
    assert list(robot.legs) == list(FOUR_LEGS)


# --- bodies joined


@given(bodies())
def test_pinocchio_and_back_is_the_same_body(body):
    assert_same_body(InertialParameters.from_pinocchio(body.to_pinocchio()), body, 1e-12)


@given(bodies(), bodies(), bodies())
def test_joining_bodies_is_associative(first, second, third):
    assert_same_body(first + second, second + first)
    assert_same_body((first + second) + third, first + (second + third))


@given(bodies(), bodies())
def test_joined_bodies_weigh_their_sum_at_their_common_com(first, second):
    joined = first + second
    total = first.mass + second.mass
    assert joined.mass == pytest.approx(total)
    com = (first.mass * first.com + second.mass * second.com) / total
    np.testing.assert_allclose(joined.com, com, atol=1e-12)
    about = [point_inertia([b.mass], [b.com - com]) for b in (first, second)]
    np.testing.assert_allclose(joined.inertia, first.inertia + second.inertia + sum(about), atol=1e-10)
    assert joined.physical_defect() is None


# --- what a body can be


@given(bodies())
def test_matter_is_physical(body):
    assert body.physical_defect() is None
    assert (np.diff(body.principal_moments) >= 0).all()
    assert body.principal_moments.sum() == pytest.approx(np.trace(body.inertia))


def body(mass, moments):
    turned = pin.rpy.rpyToMatrix(np.array([0.3, 0.2, 0.1]))
    return InertialParameters(mass, np.zeros(3), turned @ np.diag(moments) @ turned.T)


DEFECTS = [
    (body(0.0, [1, 1, 1]), "its mass is 0 kg"),
    (body(-1.5, [1, 1, 1]), "its mass is -1.5 kg"),
    (body(1.0, [-0.1, 1, 1]), "a principal moment of inertia is -0.1 kg m2"),
    (body(1.0, [0.001, 0.002, 0.005]), "a principal moment, 0.005 kg m2, exceeds the sum of the others, 0.003"),
]


@pytest.mark.parametrize(("impossible", "defect"), DEFECTS, ids=[defect for _, defect in DEFECTS])
def test_unphysical_parameters_have_a_defect(impossible, defect):
    assert impossible.physical_defect() == defect


def test_a_plate_and_its_rounding_are_physical():
    assert body(1.0, [1, 2, 3]).physical_defect() is None
    assert body(1.0, [1, 2, 3.002]).physical_defect() is None


SHAPES = [
    ({"com": np.zeros(2)}, "com must be (3,) finite numbers, got [0.0, 0.0]"),
    ({"com": np.array([0, np.nan, 0])}, "com must be (3,) finite numbers, got [0.0, nan, 0.0]"),
    ({"inertia": np.ones(3)}, "inertia must be (3, 3) finite numbers, got [1.0, 1.0, 1.0]"),
    ({"mass": np.inf}, "mass must be finite, got inf"),
]


@pytest.mark.parametrize(("changes", "message"), SHAPES, ids=[message for _, message in SHAPES])
def test_invalid_parameters_are_refused(changes, message):
    with pytest.raises(SettingsError) as error:
        InertialParameters(**{"mass": 1.0, "com": np.zeros(3), "inertia": np.eye(3), **changes})
    assert str(error.value) == message


def test_parameters_are_a_copy_that_cannot_be_changed_by_accident():
    com = np.zeros(3)
    parameters = InertialParameters(1.0, com, np.eye(3))
    com[0] = 1
    assert parameters.com[0] == 0
    for array in (parameters.com, parameters.inertia):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1
