"""RobotModel: legs, feet and limits from the kinematic tree alone, independent of names."""

import itertools
import re
import warnings

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from robots import (
    ARM,
    FOOT_RADIUS,
    FOUR_LEGS,
    HIPS,
    LINKS,
    REAR_TRUNK,
    SIX_LEGS,
    load_text,
    on_cylinders,
    plain_name,
    quadruped_urdf,
)

from equipoise.errors import ModelError, ModelWarning, SettingsError
from equipoise.robot.cleaning.urdf_joints import UNLIMITED_JOINT_RANGE
from equipoise.robot.description import LEG_NAMES, RobotDescription
from equipoise.robot.inertial import base_parameters, composite_parameters
from equipoise.robot.kinematics import foot_positions
from equipoise.robot.model import DIAGONALS, RobotModel
from equipoise.robot.tree import joint_axis

NAMINGS = {
    "plain": plain_name,
    "ANYmal": lambda leg, joint: f"{leg.replace('R', 'H', 1) if leg[0] == 'R' else leg}_{('HAA', 'HFE', 'KFE')[joint]}",
    "LF": lambda leg, joint: f"{leg[::-1]}_{('HAA', 'HFE', 'KFE')[joint]}",
    "numbers": lambda leg, joint: str(10 - 3 * FOUR_LEGS.index(leg) + joint + 10),
    "lying of joints": lambda leg, joint: f"{leg}_{('knee', 'ankle', 'hip')[joint]}",
    "other letters": lambda leg, joint: f"Gelenk_{joint}_für_{leg}",
    "as their links": lambda leg, joint: f"{leg}_link_{joint}",
}


@pytest.fixture
def load(tmp_path):
    return lambda text, description=None: load_text(tmp_path, text, description)


@pytest.fixture
def refusal(load, tmp_path):
    """Return the error message of a robot, without the file's folder."""

    def refusal(text, description=None, error=ModelError):
        with pytest.raises(error) as caught:
            load(text, description)
        return str(caught.value).replace(str(tmp_path / "robot"), "robot")

    return refusal


@pytest.fixture(scope="module")
def quadruped(tmp_path_factory):
    return load_text(tmp_path_factory.mktemp("quadruped"), quadruped_urdf())


def composite_at_zero(robot):
    return composite_parameters(robot, np.zeros(len(robot.joint_names)))


def rotation_of(rpy):
    return pin.rpy.rpyToMatrix(np.array(rpy))


# --- legs


@pytest.mark.parametrize("joints", [2, 3])
@pytest.mark.parametrize("naming", NAMINGS)
def test_legs_are_found_for_any_joint_names(load, naming, joints):
    name = NAMINGS[naming]
    robot = load(quadruped_urdf(joints_per_leg=joints, joint_name=name))
    assert list(robot.legs) == list(LEG_NAMES)
    for leg in robot.legs.values():
        assert leg.joint_names == tuple(name(leg.name, place) for place in range(joints))
        assert [robot.joint_names[joint] for joint in leg.joints] == list(leg.joint_names)
        assert [robot.pinocchio.names[joint] for joint in leg.joint_ids] == list(leg.joint_names)
    assert robot.locked_joints == {}


@settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(order=st.permutations(FOUR_LEGS), names=st.permutations(range(12)))
def test_neither_names_nor_order_of_legs_in_the_file_matter(load, quadruped, order, names):
    table = dict(zip(((leg, joint) for leg in FOUR_LEGS for joint in range(3)), names, strict=True))
    robot = load(quadruped_urdf(legs=order, joint_name=lambda leg, joint: f"j{table[leg, joint]}"))
    for leg in LEG_NAMES:
        assert robot.legs[leg].joint_names == tuple(f"j{table[leg, joint]}" for joint in range(3))
    zero = np.zeros(12)
    np.testing.assert_allclose(foot_positions(robot, zero), foot_positions(quadruped, zero), atol=1e-12)
    np.testing.assert_allclose(composite_at_zero(robot).inertia, composite_at_zero(quadruped).inertia, atol=1e-12)


def test_every_leg_joint_belongs_to_one_leg(quadruped):
    assert sorted(j for leg in quadruped.legs.values() for j in leg.joints) == list(range(12))


@pytest.mark.parametrize("joints", [2, 3])
def test_the_last_joint_is_the_knee_and_the_one_before_it_the_hip_pitch(load, joints):
    robot = load(quadruped_urdf(joints_per_leg=joints))
    for leg in robot.legs.values():
        for joint in leg.joint_ids[-2:]:
            np.testing.assert_array_equal(joint_axis(robot.pinocchio, joint), [0, 1, 0])
        knee = robot.pinocchio.jointPlacements[leg.joint_ids[-1]].translation
        np.testing.assert_allclose(knee, [0, 0, -0.2])


def test_diagonals_run_from_a_right_foot_to_the_left_one_across(quadruped):
    feet = dict(zip(quadruped.legs, foot_positions(quadruped, np.zeros(12)), strict=True))
    assert set(itertools.chain(*DIAGONALS.values())) == set(LEG_NAMES)
    for name, diagonal in DIAGONALS.items():
        assert set(name.split("_")) == set(diagonal)
        first, second = (feet[leg] for leg in diagonal)
        assert first[0] * second[0] < 0
        assert first[1] * second[1] < 0


def test_feet_are_at_the_places_of_their_names(quadruped):
    for leg, (x, y, _) in zip(quadruped.legs, foot_positions(quadruped, np.zeros(12)), strict=True):
        assert (x > 0) == (leg[0] == "F")
        assert (y > 0) == (leg[1] == "L")


LIMBS = [
    (quadruped_urdf(legs=FOUR_LEGS[:3]), "3 of 3 joints (FL_0, FL_1, FL_2)"),
    (quadruped_urdf(legs=SIX_LEGS), "6 of 3 joints (FL_0, FL_1, FL_2)"),
    (
        quadruped_urdf(legs=SIX_LEGS, joints_per_leg=2, arm_joints=5),
        "6 of 2 joints (FL_0, FL_1), 1 of 5 joints (arm_0, arm_1, arm_2, arm_3, arm_4)",
    ),
    (
        quadruped_urdf(legs=FOUR_LEGS[:3], spine=True),
        "2 of 3 joints (FL_0, FL_1, FL_2), 1 of 4 joints (spine, RL_0, RL_1, RL_2)",
    ),
    (quadruped_urdf(legs=[]), "none"),
]


@pytest.mark.parametrize(("text", "found"), LIMBS, ids=[found for _, found in LIMBS])
def test_robots_without_four_legs_are_refused_with_their_limbs(refusal, text, found):
    assert refusal(text) == (
        "robot model 'robot' is not a supported quadruped: it needs exactly four legs of two or three joints "
        f"each; limbs found: {found}"
    )


def test_legs_that_are_not_in_four_corners_are_refused(refusal):
    text = quadruped_urdf().replace('xyz="0.2 0.1 0.0"', 'xyz="0.2 -0.3 0.0"')
    assert refusal(text) == (
        "the four hips are not front left, front right, rear left and rear right of each other in the base frame (x "
        "forward, y left): (0.200, -0.220, 0.000); (0.200, -0.180, 0.000); (-0.200, 0.180, 0.000); (-0.200, -0.180, 0.000)"
    )


def in_units(text, lengths=1.0, masses=1.0):
    """Return a URDF with lengths and masses in smaller units."""
    text = re.sub(r'<origin xyz="([^"]+)"', lambda found: f'<origin xyz="{multiplied(found[1], lengths)}"', text)
    return re.sub(r'<mass value="([^"]+)"', lambda found: f'<mass value="{multiplied(found[1], masses)}"', text)


def multiplied(numbers, factor):
    return " ".join(str(factor * float(number)) for number in numbers.split())


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            in_units(quadruped_urdf(), lengths=1000),
            "has legs of 400 m: its lengths look like millimetres; give them in metres, inertias in kg m2",
        ),
        (
            in_units(quadruped_urdf(), lengths=100),
            "has legs of 40 m: its lengths are in another unit; give them in metres, inertias in kg m2",
        ),
        (
            in_units(quadruped_urdf(), masses=1000),
            "weighs 13600 kg: its masses look like grams; give them in kg, inertias in kg m2",
        ),
    ],
    ids=["millimetres", "centimetres", "grams"],
)
def test_files_in_other_units_are_refused(refusal, text, said):
    assert refusal(text) == f"robot model 'robot' {said}"


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("prismatic", "prismatic"),
        ("planar", "of more than one axis (planar)"),
        ("floating", "floating"),
    ],
)
def test_a_leg_joint_that_does_not_turn_about_one_axis_is_refused(refusal, kind, said):
    text = quadruped_urdf().replace('name="FL_0" type="revolute"', f'name="FL_0" type="{kind}"')
    assert refusal(text) == (
        f"robot model 'robot': leg joint 'FL_0' is {said}, and legs need joints that turn about one axis (revolute, "
        "continuous or hinge); if it does not move, make it fixed in a copy of the file"
    )


# --- joints that are no leg's


@pytest.mark.parametrize("kind", ["revolute", "continuous", "prismatic"])
@pytest.mark.parametrize("joints", [1, 2, 4, 6])
def test_an_arm_is_locked_and_belongs_to_the_base(load, quadruped, joints, kind):
    robot = load(quadruped_urdf(arm_joints=joints, arm_type=kind))
    assert robot.joint_names == quadruped.joint_names
    assert robot.locked_joints == {f"arm_{i}": 0.0 for i in range(joints)}
    assert base_parameters(robot).mass == pytest.approx(6.0 + joints * ARM[0])
    assert robot.mass == pytest.approx(quadruped.mass + joints * ARM[0])
    assert robot.full_pinocchio.nq == robot.pinocchio.nq + joints


def test_an_arm_of_two_joints_is_not_a_leg(load):
    assert list(load(quadruped_urdf(arm_joints=2)).locked_joints) == ["arm_0", "arm_1"]
    assert list(load(quadruped_urdf(joints_per_leg=2, arm_joints=3)).locked_joints) == ["arm_0", "arm_1", "arm_2"]


def test_the_position_of_a_locked_arm_moves_the_com_of_the_base(load):
    angle = 0.5
    straight = base_parameters(load(quadruped_urdf(arm_joints=1)))
    bent = base_parameters(load(quadruped_urdf(arm_joints=1), RobotDescription(locked_joints={"arm_0": angle})))
    shoulder = rotation_of([0.3, -0.2, 0.4])  # of the arm's joint in the trunk, as the file has it
    moved = shoulder @ (rotation_of([0, angle, 0]) - np.eye(3)) @ np.array(ARM[1])
    np.testing.assert_allclose(bent.com - straight.com, moved * ARM[0] / (6.0 + ARM[0]), atol=1e-12)
    assert bent.mass == straight.mass


def test_a_spine_is_locked_and_the_rear_trunk_belongs_to_the_base(load):
    robot = load(quadruped_urdf(spine=True))
    assert robot.locked_joints == {"spine": 0.0}
    assert base_parameters(robot).mass == pytest.approx(6.0 + REAR_TRUNK[0])
    bent = load(quadruped_urdf(spine=True), RobotDescription(locked_joints={"spine": 0.3}))
    feet, feet_bent = (foot_positions(r, np.zeros(12)) for r in (robot, bent))
    np.testing.assert_allclose(feet_bent[:2], feet[:2], atol=1e-12)
    pivot = np.array([-0.05, 0, 0])
    np.testing.assert_allclose(feet_bent[2:], (feet[2:] - pivot) @ rotation_of([0, 0, 0.3]).T + pivot, atol=1e-12)


def test_only_other_joints_can_be_locked(refusal):
    held = RobotDescription(locked_joints={"FL_0": 0.1})
    assert refusal(quadruped_urdf(arm_joints=2), held, SettingsError) == (
        "locked_joints names 'FL_0', which is a leg joint or does not exist; others are arm_0, arm_1"
    )


def test_a_joint_is_locked_within_its_limits(refusal):
    assert refusal(quadruped_urdf(arm_joints=2), RobotDescription(locked_joints={"arm_1": -1.6}), SettingsError) == (
        "locked_joints puts joint 'arm_1' at -1.600 rad, outside its limits -1.500 to 1.500; give its angle during the "
        "calibration, in radians"
    )


def test_a_joint_of_several_axes_cannot_be_locked_elsewhere(load, refusal):
    ball = quadruped_urdf(arm_joints=1, arm_type="floating")
    assert base_parameters(load(ball)).mass == pytest.approx(6.0 + ARM[0])
    message = refusal(ball, RobotDescription(locked_joints={"arm_0": 0.1}), SettingsError)
    assert message == "locked_joints names 'arm_0', which has more than one axis"


def test_a_locked_joint_may_have_its_links_name(load):
    sphere = '<collision><geometry><sphere radius="0.1"/></geometry></collision></link>'
    text = re.sub(r'(<link name="arm_link_0">.*)</link>', rf"\1{sphere}", quadruped_urdf(arm_joints=1))
    robot = load(text.replace('"arm_link_0"', '"arm_0"'), RobotDescription(locked_joints={"arm_0": 0.2}))
    assert robot.locked_joints == {"arm_0": 0.2}


# --- feet


def test_a_foot_is_at_its_sphere(quadruped):
    assert {leg.foot_radius for leg in quadruped.legs.values()} == {FOOT_RADIUS}
    for name, leg in quadruped.legs.items():
        assert (leg.foot_body, leg.foot_in_body) == (f"{name}_link_2", (0.0, 0.0, -0.2))


def test_a_foot_is_at_the_farthest_sphere_below_the_knee(load, quadruped):
    others = "".join(
        f'<collision><origin xyz="0 0 {z}"/><geometry><sphere radius="{radius}"/></geometry></collision>'
        for z, radius in ((0, 0.03), (-0.15, 0.025))
    )
    text = quadruped_urdf()
    for leg in LEG_NAMES:
        text = text.replace(f'<link name="{leg}_link_2">', f'<link name="{leg}_link_2">{others}')
    assert load(text).legs == quadruped.legs


def test_a_sphere_at_the_knee_is_not_a_foot(load):
    knee = '<collision><geometry><sphere radius="0.03"/></geometry></collision>'
    text = quadruped_urdf(foot_radius=None)
    for leg in LEG_NAMES:
        text = text.replace(f'<link name="{leg}_link_2">', f'<link name="{leg}_link_2">{knee}')
    assert {leg.foot_in_body for leg in load(text).legs.values()} == {(0.0, 0.0, -0.2)}


def test_cylinders_along_the_knees_axes_are_feet_with_a_width(load):
    legs = load(on_cylinders("1.5708 0 0")).legs.values()
    assert {(leg.foot_radius, leg.foot_half_width, leg.foot_in_body) for leg in legs} == {
        (0.018, 0.006, (0.0, 0.0, -0.2))
    }
    assert {leg.foot_half_width for leg in load(quadruped_urdf()).legs.values()} == {0.0}


def test_cylinders_along_the_shank_are_not_feet(load):
    robot = load(on_cylinders("0 0 0"))
    assert {(leg.foot_radius, leg.foot_half_width) for leg in robot.legs.values()} == {(0.05 * robot.leg_length, 0.0)}


def test_feet_without_spheres_are_at_the_farthest_frames_with_a_warning(tmp_path):
    path = tmp_path / "spot.urdf"
    path.write_text(quadruped_urdf(foot_radius=None), encoding="utf-8")
    with pytest.warns(ModelWarning) as caught:
        robot = RobotModel.from_file(path)
    assert str(caught[-1].message) == (
        "spot: no sphere or cylinder at the feet; a radius of 20 mm is assumed (set foot_radius in the robot configuration)"
    )
    assert {leg.foot_radius for leg in robot.legs.values()} == {0.05 * robot.leg_length}
    assert {leg.foot_in_body for leg in robot.legs.values()} == {(0.0, 0.0, -0.2)}


def test_a_described_radius_gives_no_warning(tmp_path):
    path = tmp_path / "spot.urdf"
    path.write_text(quadruped_urdf(foot_radius=None), encoding="utf-8")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        robot = RobotModel.from_file(path, description=RobotDescription(foot_radius=0.03))
    assert not any("no sphere" in str(warning.message) for warning in caught)
    assert {leg.foot_radius for leg in robot.legs.values()} == {0.03}


def test_a_described_radius_wins_over_the_sphere(load):
    assert load(quadruped_urdf(), RobotDescription(foot_radius=0.03)).legs["FL"].foot_radius == 0.03


def test_a_described_radius_is_no_larger_than_a_leg(refusal):
    said = refusal(quadruped_urdf(), RobotDescription(foot_radius=25), SettingsError)
    assert "foot_radius is 25 m, and the legs of 'robot' are 0.40 m long; metres, not millimetres?" in said


def test_a_described_foot_frame_wins_over_the_farthest_frame(load):
    toe = '<link name="toe"/><joint name="toe_joint" type="fixed"><origin xyz="0.01 0 -0.18"/>'
    toe += '<parent link="FL_link_2"/><child link="toe"/></joint>'
    robot = load(quadruped_urdf(extra=toe), RobotDescription(foot_frames={"FL": "toe"}))
    assert robot.legs["FL"].foot_in_body == pytest.approx((0.01, 0.0, -0.18))
    assert robot.legs["FR"].foot_in_body == (0.0, 0.0, -0.2)
    assert robot.legs["FR"].foot_radius == FOOT_RADIUS


def test_a_foot_frame_may_have_its_joints_name(load):
    text = quadruped_urdf().replace('"FL_foot_joint"', '"FL_foot"')
    robot = load(text, RobotDescription(foot_frames={"FL": "FL_foot"}))
    assert robot.legs["FL"].foot_in_body == (0.0, 0.0, -0.2)
    assert robot.legs["FL"].foot_radius == FOOT_RADIUS


def test_a_foot_frame_must_exist_and_be_below_the_legs_own_knee(refusal):
    described = RobotDescription(foot_frames={"FL": "FL_toe"})
    assert refusal(quadruped_urdf(), described, SettingsError) == (
        "foot frame 'FL_toe' of leg FL is not in robot model 'robot'"
    )
    for frame in ("FR_foot", "trunk"):
        described = RobotDescription(foot_frames={"FL": frame})
        assert refusal(quadruped_urdf(), described, SettingsError) == (
            f"foot frame {frame!r} is not below the knee of leg FL"
        )


def test_a_leg_that_ends_at_its_knee_needs_a_foot(refusal):
    assert refusal(quadruped_urdf(foot_links=False)) == (
        "robot model 'robot': nothing marks the foot of leg FL: below joint 'FL_2' there is neither a frame nor a "
        "sphere away from its axis; "
        'add a fixed link at the foot\'s centre in a copy of the file (a <link> and a <joint type="fixed"> whose origin is '
        "there, or a site in MJCF)"
    )


def test_feet_on_their_bodies_are_where_the_kinematics_have_them(quadruped):
    position = np.random.default_rng(0).uniform(-1, 1, 12)
    feet = foot_positions(quadruped, position)
    data = quadruped.pinocchio.createData()
    pin.framesForwardKinematics(quadruped.pinocchio, data, quadruped.configuration(position))
    for leg, expected in zip(quadruped.legs.values(), feet, strict=True):
        body = data.oMf[quadruped.pinocchio.getFrameId(leg.foot_body)]
        np.testing.assert_allclose(body.act(np.array(leg.foot_in_body)), expected, atol=1e-12)


@pytest.mark.parametrize("joints", [2, 3])
def test_the_leg_length_is_thigh_plus_shank_whatever_the_offsets_along_the_axes(load, joints):
    text = quadruped_urdf(joints_per_leg=joints)
    assert load(text).leg_length == pytest.approx(0.4)
    assert load(text.replace('xyz="0.0 0.0 -0.2"', 'xyz="0.0 0.07 -0.2"')).leg_length == pytest.approx(0.4)


# --- limits, gains, frames


def test_limits_are_those_of_the_file(quadruped):
    np.testing.assert_array_equal(quadruped.lower_limit, np.tile([-0.9, -2.5, -2.7], 4))
    np.testing.assert_array_equal(quadruped.upper_limit, np.tile([0.9, 2.5, 2.7], 4))
    np.testing.assert_array_equal(quadruped.effort_limit, np.full(12, 30.0))
    np.testing.assert_array_equal(quadruped.velocity_limit, np.full(12, 20.0))


def test_continuous_joints_are_bounded_by_two_turns(load):
    robot = load(quadruped_urdf(continuous=True))
    np.testing.assert_allclose(robot.upper_limit, np.tile([0.9, UNLIMITED_JOINT_RANGE, 2.7], 4))
    np.testing.assert_allclose(robot.lower_limit, -robot.upper_limit)


def test_limits_of_torque_and_speed_of_zero_mean_none(load):
    robot = load(quadruped_urdf().replace('effort="30" velocity="20"', 'effort="0" velocity="0"'))
    assert np.isinf(robot.effort_limit).all()
    assert np.isinf(robot.velocity_limit).all()


def test_described_limits_win(load, refusal):
    robot = load(quadruped_urdf(), RobotDescription(joint_limits={"FL_1": (-0.4, 0.6)}))
    joint = robot.joint_names.index("FL_1")
    assert (robot.lower_limit[joint], robot.upper_limit[joint]) == (-0.4, 0.6)
    assert refusal(quadruped_urdf(), RobotDescription(joint_limits={"knee": (0, 1)}), SettingsError) == (
        "joint_limits names 'knee', which is not a leg joint of 'robot'; those are " + ", ".join(robot.joint_names)
    )


@pytest.mark.parametrize(
    ("joint", "limits", "said"),
    [
        ("FL_1", (-2.5, 2.502), "-2.5 to 2.502 rad, beyond the model's -2.500 to 2.500 rad"),
        ("FL_1", (-2.502, 0.0), "-2.502 to 0 rad, beyond the model's -2.500 to 2.500 rad"),
        ("FL_2", (-155.0, -52.0), "-155 to -52 rad, beyond the model's -2.700 to 2.700 rad"),
    ],
)
def test_described_limits_that_are_wider_are_refused(refusal, joint, limits, said):
    degrees = "; rad, not degrees?" if joint == "FL_2" else ""
    assert refusal(quadruped_urdf(), RobotDescription(joint_limits={joint: limits}), SettingsError) == (
        f"joint_limits of {joint!r} are {said}; they may be narrower, not wider{degrees}"
    )


def test_described_limits_may_be_the_files_with_fewer_digits(load):
    robot = load(quadruped_urdf(), RobotDescription(joint_limits={"FL_1": (-2.5009, 2.5009)}))
    joint = robot.joint_names.index("FL_1")
    assert (robot.lower_limit[joint], robot.upper_limit[joint]) == (-2.5, 2.5)


def test_described_limits_apply_without_limits_of_the_file(load, refusal):
    described = RobotDescription(joint_limits={"FL_1": (-3.0, 6.0)})
    robot = load(quadruped_urdf(continuous=True), described)
    joint = robot.joint_names.index("FL_1")
    assert (robot.lower_limit[joint], robot.upper_limit[joint]) == (-3.0, 6.0)
    degrees = RobotDescription(joint_limits={"FL_1": (-90.0, 90.0)})
    assert refusal(quadruped_urdf(continuous=True), degrees, SettingsError).endswith("rad, not degrees?")


@pytest.mark.parametrize("name", ["lower_limit", "upper_limit", "velocity_limit", "effort_limit"])
def test_limits_cannot_be_changed_by_accident(quadruped, name):
    with pytest.raises(ValueError, match="read-only"):
        getattr(quadruped, name)[0] = 1.0


def test_gains_grow_with_mgh_and_described_ones_win(load, a1, quadruped):
    kp, kd = a1.gains(0.3)
    assert (kp, kd) == pytest.approx((100 * a1.mass * 9.81 * 0.3 / 38, 3 * a1.mass * 9.81 * 0.3 / 38))
    assert quadruped.gains(0.6)[0] == pytest.approx(2 * quadruped.gains(0.3)[0])
    described = load(quadruped_urdf(), RobotDescription(kp=80.0))
    assert described.gains(0.3) == (80.0, quadruped.gains(0.3)[1])


IMU = """<link name="imu_link"/><joint name="imu_joint" type="fixed"><origin xyz="0.1 -0.02 0.03" rpy="0.1 0.2 0.3"/>
  <parent link="trunk"/><child link="imu_link"/></joint>"""


def test_the_imu_is_at_a_frame_named_imu_or_the_base_frame(load, quadruped):
    np.testing.assert_array_equal(quadruped.imu_in_base.homogeneous, np.eye(4))
    found = load(quadruped_urdf(extra=IMU)).imu_in_base
    np.testing.assert_allclose(found.translation, [0.1, -0.02, 0.03])
    np.testing.assert_allclose(found.rotation, rotation_of([0.1, 0.2, 0.3]), atol=1e-12)


def test_an_imu_on_a_leg_is_not_the_bases(load):
    on_leg = load(quadruped_urdf(extra=IMU.replace('"trunk"', '"FL_link_1"')))
    np.testing.assert_array_equal(on_leg.imu_in_base.homogeneous, np.eye(4))


def test_a_described_imu_pose_wins_part_by_part(load):
    turned = load(quadruped_urdf(extra=IMU), RobotDescription(imu_rpy=(0.0, 0.0, np.pi))).imu_in_base
    np.testing.assert_allclose(turned.translation, [0.1, -0.02, 0.03])
    np.testing.assert_allclose(turned.rotation, np.diag([-1, -1, 1]), atol=1e-12)
    moved = load(quadruped_urdf(extra=IMU), RobotDescription(imu_position=(0.1, 0.2, 0.3))).imu_in_base
    np.testing.assert_allclose(moved.translation, [0.1, 0.2, 0.3])
    np.testing.assert_allclose(moved.rotation, rotation_of([0.1, 0.2, 0.3]), atol=1e-12)


def test_a_described_imu_is_no_farther_than_the_robot_is_large(load, refusal):
    hips = np.array(list(HIPS.values()))[[0, 1, 4, 5]] * (1, 1.8)  # pitch axes are 0.08 m outwards
    size = 2 * np.hypot(*hips[0]) + 0.4
    load(quadruped_urdf(), RobotDescription(imu_position=(0.0, 0.0, size - 0.01)))
    assert refusal(quadruped_urdf(), RobotDescription(imu_position=(0.0, 0.0, size + 0.01)), SettingsError) == (
        f"imu_position is 0, 0, {size + 0.01:g} m in the base frame, 0.948 m from the middle of the hips, and 'robot' is "
        "0.94 m large; metres, not millimetres?"
    )


LIGHTEST_BASE = 0.05 / 0.95 * 4 * sum(mass for mass, _, _ in LINKS)  # [kg]


def test_a_base_with_hardly_any_mass_gives_a_warning(tmp_path):
    path = tmp_path / "spot.urdf"
    path.write_text(quadruped_urdf(trunk_mass=0.99 * LIGHTEST_BASE), encoding="utf-8")
    with pytest.warns(ModelWarning) as caught:
        RobotModel.from_file(path)
    assert str(caught[-1].message) == (
        "spot: the base 'trunk' has hardly any mass, 0.396 kg of the robot's 7.996 kg, although it holds motors and battery: "
        "give its link an <inertial> with mass, centre of mass and inertia"
    )


def test_a_base_without_mass_is_refused(refusal):
    assert refusal(quadruped_urdf(trunk_mass=0.0)) == (
        "robot model 'robot': the base 'trunk' has hardly any mass, 0 kg of the robot's 7.6 kg, although it holds motors and "
        "battery: give its link an <inertial> with mass, centre of mass and inertia"
    )


def test_a_base_may_be_light(load):
    assert load(quadruped_urdf(trunk_mass=1.01 * LIGHTEST_BASE)).defect_of_base is None


def test_the_base_is_the_first_link_with_mass_or_the_described_one(load, quadruped):
    assert quadruped.base_link == "trunk"
    below_world = load(quadruped_urdf(world=True))
    assert below_world.base_link == "trunk"
    np.testing.assert_allclose(composite_at_zero(below_world).com, composite_at_zero(quadruped).com, atol=1e-12)
    at_world = load(quadruped_urdf(world=True), RobotDescription(base_link="world"))
    assert at_world.base_link == "world"
    shift = composite_at_zero(at_world).com - composite_at_zero(quadruped).com
    np.testing.assert_allclose(shift, [0, 0, 0.5], atol=1e-12)


def test_the_mass_is_that_of_all_links(quadruped):
    assert quadruped.mass == pytest.approx(6.0 + 4 * sum(mass for mass, _, _ in LINKS))


def test_the_name_of_a_robot_is_that_of_its_file_by_default(tmp_path):
    path = tmp_path / "spot.urdf"
    path.write_text(quadruped_urdf(), encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        assert RobotModel.from_file(path).name == "spot"
        assert RobotModel.from_file(path, "mine").name == "mine"


def test_a_name_that_is_not_utf8_can_be_written(tmp_path):
    robot = load_text(tmp_path, quadruped_urdf(), name="caf\udce9")  # how Python reads Latin-1
    assert robot.name == "caf\\udce9"


def test_joint_vectors_by_name_are_in_the_robots_order_and_complete(quadruped):
    by_name = {name: float(index) for index, name in enumerate(quadruped.joint_names)}
    reversed_order = dict(reversed(by_name.items()))
    np.testing.assert_array_equal(quadruped.joint_vector(reversed_order, "stance"), np.arange(12.0))
    with pytest.raises(SettingsError) as error:
        quadruped.joint_vector(dict.fromkeys(quadruped.joint_names[2:], 0.0), "stance")
    assert str(error.value) == "stance lacks FL_0, FL_1; it needs every leg joint"


def test_the_base_frame_of_a_configuration_is_the_worlds(quadruped):
    configuration = quadruped.configuration(np.arange(12.0))
    np.testing.assert_array_equal(configuration[:7], [0, 0, 0, 0, 0, 0, 1])
    np.testing.assert_array_equal(configuration[7:], np.arange(12.0))


def test_hips_of_the_file_are_where_the_robot_has_them(quadruped):
    for leg in LEG_NAMES:
        hip = quadruped.pinocchio.jointPlacements[quadruped.legs[leg].joint_ids[0]].translation
        np.testing.assert_allclose(hip, [*HIPS[leg], 0])
