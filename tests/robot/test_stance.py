"""Nominal stance."""

import re
import warnings

import numpy as np
import pinocchio as pin
import pytest
from robots import LINKS, load_text, quadruped_mjcf, quadruped_urdf

from equipoise.errors import MissingDependencyError, ModelWarning, ReachError, SettingsError
from equipoise.robot.catalog import CATALOG, load_robot
from equipoise.robot.description import RobotDescription
from equipoise.robot.kinematics import foot_positions
from equipoise.robot.stance import nominal_stance, stance_at
from equipoise.robot.tree import joint_axis

LIMIT_MARGIN = 0.05
TURNED_HIP = ('<origin xyz="0.2 0.1 0.0" rpy="0 0 0"/>', '<origin xyz="0.2 0.1 0.0" rpy="0.4 0 0"/>')
SYNTHETIC = {
    "three joints": quadruped_urdf(),
    "two joints": quadruped_urdf(joints_per_leg=2),
    "no limits": quadruped_urdf(continuous=True),
    "knees back": quadruped_urdf(knee_range=(-2.7, -0.5)),
    "knees forward": quadruped_urdf(knee_range=(0.5, 2.7)),
    "an arm": quadruped_urdf(arm_joints=4),
    "MJCF": quadruped_mjcf(),
    "a hip that is turned in the file": quadruped_urdf().replace(*TURNED_HIP),
}


def load_named(name, folder):
    if name in SYNTHETIC:
        return load_text(folder, SYNTHETIC[name])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        try:
            return load_robot(name)
        except MissingDependencyError as error:
            pytest.skip(str(error))


def joint_origins(robot, joint_position, place):
    """Return the (4, 3) joints at this place in the legs, in the base frame."""
    data = robot.pinocchio.createData()
    pin.forwardKinematics(robot.pinocchio, data, robot.configuration(joint_position))
    return np.array([data.oMi[leg.joint_ids[place]].translation for leg in robot.legs.values()])


@pytest.mark.parametrize("name", [*SYNTHETIC, *CATALOG])
def test_feet_stand_under_the_hips_at_one_height_within_the_limits(tmp_path, name):
    robot = load_named(name, tmp_path)
    stance = nominal_stance(robot)
    tolerance = 1e-3 * robot.leg_length
    np.testing.assert_allclose(stance.feet_in_base, foot_positions(robot, stance.joint_position), atol=1e-12)
    hips = joint_origins(robot, stance.joint_position, -2)
    np.testing.assert_allclose(stance.feet_in_base[:, 0], hips[:, 0], atol=tolerance)
    np.testing.assert_allclose(stance.feet_in_base[:, 2], stance.feet_in_base[:, 2].mean(), atol=tolerance)
    margins = np.minimum(stance.joint_position - robot.lower_limit, robot.upper_limit - stance.joint_position)
    assert margins.min() >= LIMIT_MARGIN
    depth = hips[:, 2].mean() - stance.feet_in_base[:, 2].mean()
    assert 0.64 < depth / robot.leg_length < 0.86


@pytest.mark.parametrize("name", [*SYNTHETIC, *CATALOG])
def test_hip_pitch_axes_are_level(tmp_path, name):
    robot = load_named(name, tmp_path)
    data = robot.pinocchio.createData()
    pin.forwardKinematics(robot.pinocchio, data, robot.configuration(nominal_stance(robot).joint_position))
    for leg in robot.legs.values():
        hip = leg.joint_ids[-2]
        axis = data.oMi[hip].rotation @ joint_axis(robot.pinocchio, hip)
        assert abs(axis[2]) < 5e-3


def test_a_turned_hip_is_turned_back(tmp_path):
    straight = nominal_stance(load_text(tmp_path, quadruped_urdf()))
    robot = load_text(tmp_path, SYNTHETIC["a hip that is turned in the file"])
    stance = nominal_stance(robot)
    assert stance.joint_position[robot.joint_names.index("FL_0")] == pytest.approx(-0.4, abs=1e-2)
    np.testing.assert_allclose(stance.feet_in_base, straight.feet_in_base, atol=2e-3)


@pytest.mark.parametrize("name", ["three joints", "two joints", "no limits"])
def test_front_knees_point_backward_and_hind_knees_forward_where_both_may(tmp_path, name):
    robot = load_named(name, tmp_path)
    position = nominal_stance(robot).joint_position
    ahead = joint_origins(robot, position, -1)[:, 0] - joint_origins(robot, position, -2)[:, 0]
    assert (ahead[:2] < 0).all()
    assert (ahead[2:] > 0).all()


@pytest.mark.parametrize(("name", "ahead"), [("knees back", -1), ("knees forward", 1), ("unitree_a1", -1)])
def test_knees_bend_as_their_limits_make_them(tmp_path, name, ahead):
    robot = load_named(name, tmp_path)
    position = nominal_stance(robot).joint_position
    knees, hips = (joint_origins(robot, position, place)[:, 0] for place in (-1, -2))
    assert (np.sign(knees - hips) == ahead).all()


def test_left_and_right_stand_alike(a1):
    stance = nominal_stance(a1)
    mirrored = stance.feet_in_base[[1, 0, 3, 2]] * [1, -1, 1]
    np.testing.assert_allclose(stance.feet_in_base, mirrored, atol=1e-3 * a1.leg_length)


def test_heights_are_above_the_floor_under_the_feet(a1):
    stance = nominal_stance(a1)
    radius = a1.legs["FL"].foot_radius
    assert stance.base_height == pytest.approx(-(stance.feet_in_base[:, 2].mean() - radius))
    # The A1's hips are at the height of its base frame.
    assert stance.hip_height == pytest.approx(stance.base_height)
    assert stance.hip_height == pytest.approx(0.75 * a1.leg_length + radius, abs=1e-3)


def test_a_stance_on_uneven_feet_has_its_floor_in_the_middle(a1):
    position = np.array(nominal_stance(a1).joint_position)
    position[a1.legs["FL"].joints[-1]] += 0.2
    stance = stance_at(a1, position)
    np.testing.assert_array_equal(stance.joint_position, position)
    assert stance.base_height == pytest.approx(0.02 - stance.feet_in_base[:, 2].mean())
    assert np.ptp(stance.feet_in_base[:, 2]) > 0.01


@pytest.mark.parametrize("array", ["joint_position", "feet_in_base"])
def test_a_stance_cannot_be_changed_by_accident(a1, array):
    with pytest.raises(ValueError, match="read-only"):
        getattr(nominal_stance(a1), array)[0] = 1


def test_the_stance_is_the_same_every_time(a1):
    np.testing.assert_array_equal(nominal_stance(a1).joint_position, nominal_stance(a1).joint_position)


# --- described stances


@pytest.mark.parametrize("ratio", [0.6, 0.9])
def test_a_described_height_is_kept(tmp_path, ratio):
    robot = load_text(tmp_path, quadruped_urdf(), RobotDescription(stance_height=ratio))
    assert nominal_stance(robot).hip_height == pytest.approx(ratio * 0.4 + 0.02, abs=1e-3)


def test_a_height_out_of_reach_is_refused_with_the_remedy(tmp_path):
    description = RobotDescription(stance_height=0.99, joint_limits={f"{leg}_2": (-2.7, -1.0) for leg in ("FL", "RR")})
    robot = load_text(tmp_path, quadruped_urdf(), description)
    with pytest.raises(ReachError) as error:
        nominal_stance(robot)
    assert re.fullmatch(
        r"no stance of 'robot' with the feet under the hips at 99% of the leg length lies within its joint limits "
        r"\(the (FL|RR) foot misses its place by \d+\.\d mm \(allowed 0\.4 mm\): joint (FL|RR)_2 is at its limit\); give "
        r"one under \[stance\] in a robot configuration",
        str(error.value),
    )
    assert error.value.exit_code == 4


def test_a_stance_at_a_joint_limit_is_rejected(tmp_path):
    free = nominal_stance(load_text(tmp_path, quadruped_urdf(knee_range=(-2.7, -0.5))))
    knee = float(free.joint_position[2])
    tight = {f"{leg}_2": (-2.7, knee + 0.02) for leg in ("FL", "FR", "RL", "RR")}
    ratio = (free.hip_height - 0.02) / 0.4
    description = RobotDescription(joint_limits=tight, stance_height=ratio)
    with pytest.raises(ReachError, match=r"\w+ is 0\.0\d\d rad from its limit"):
        nominal_stance(load_text(tmp_path, quadruped_urdf(knee_range=(-2.7, -0.5)), description))
    # Without a wish for the height another one is found.
    lower = nominal_stance(load_text(tmp_path, quadruped_urdf(), RobotDescription(joint_limits=tight)))
    assert lower.hip_height < free.hip_height


def described(**changes):
    joints = {f"{leg}_{i}": q for leg in ("FL", "FR", "RL", "RR") for i, q in enumerate((0.0, 0.7, -1.4))}
    return {**joints, **changes}


def test_a_described_stance_is_taken_as_it_is(tmp_path):
    robot = load_text(tmp_path, quadruped_urdf(), RobotDescription(stance=described()))
    stance = nominal_stance(robot)
    np.testing.assert_array_equal(stance.joint_position, np.tile([0.0, 0.7, -1.4], 4))
    assert stance.hip_height == pytest.approx(2 * 0.2 * np.cos(0.7) + 0.02)


def test_a_described_stance_at_its_limit_is_allowed(tmp_path):
    robot = load_text(tmp_path, quadruped_urdf(), RobotDescription(stance=described(FL_2=-2.7)))
    assert nominal_stance(robot).joint_position[2] == -2.7


REFUSED = [
    (described(FL_0=1.0), "stance puts joint 'FL_0' at 1.000 rad, outside its limits -0.900 to 0.900"),
    (
        {"FL_0": 0.0},
        "stance lacks FL_1, FL_2, FR_0, FR_1, FR_2, RL_0, RL_1, RL_2, RR_0, RR_1, RR_2; it needs every leg joint",
    ),
    (
        described(tail=0.0),
        "stance names 'tail', which is not a leg joint of 'robot'; those are "
        "FL_0, FL_1, FL_2, FR_0, FR_1, FR_2, RL_0, RL_1, RL_2, RR_0, RR_1, RR_2",
    ),
]


@pytest.mark.parametrize(("stance", "message"), REFUSED, ids=["limit", "incomplete", "unknown joint"])
def test_an_invalid_described_stance_is_refused(tmp_path, stance, message):
    robot = load_text(tmp_path, quadruped_urdf(), RobotDescription(stance=stance))
    with pytest.raises(SettingsError) as error:
        nominal_stance(robot)
    assert str(error.value) == message


def test_the_links_of_the_synthetic_robot_are_physical():
    """Check an assumption of other tests."""
    for _, _, (xx, yy, zz, *_) in LINKS:
        assert max(xx, yy, zz) < (xx + yy + zz) / 2
