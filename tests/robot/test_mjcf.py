"""Cleaning of MJCF files: supported and refused elements."""

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from robots import FOOT_RADIUS, FOUR_LEGS, load_text, quadruped_mjcf
from scipy.spatial.transform import Rotation

from equipoise.errors import ModelError
from equipoise.robot.cleaning.mjcf_poses import orientation
from equipoise.robot.cleaning.urdf_joints import UNLIMITED_JOINT_RANGE
from equipoise.robot.inertial import base_parameters
from equipoise.robot.model import RobotModel
from equipoise.robot.source import read_model_source

RADIAN = '<compiler angle="radian"/>'


@pytest.fixture
def read(tmp_path):
    def read(text, base_link=None):
        path = tmp_path / "robot.xml"
        path.write_text(text, encoding="utf-8")
        return read_model_source(path, base_link)

    return read


@pytest.fixture
def robot(tmp_path):
    def robot(**changes):
        return load_text(tmp_path, quadruped_mjcf(**changes))

    return robot


@pytest.fixture
def refusal(read, tmp_path):
    """Return the error message of a text, without the file's folder."""

    def refusal(text, base_link=None):
        with pytest.raises(ModelError) as error:
            read(text, base_link)
        return str(error.value).replace(str(tmp_path / "robot.xml"), "robot.xml")

    return refusal


def trunk_of(source):
    return ET.fromstring(source.xml).find("worldbody/body")


# --- default classes


CLASSES = f"""{RADIAN}<default>
  <geom density="300"/><joint range="-0.1 0.1"/>
  <default class="part"><geom type="box" size="0.1 0.1 0.1" pos="0.1 0 0" quat="1 0 0 1"/>
    <default class="small"><geom size="0.05 0.05 0.05"/></default></default>
  <default class="ball"><geom type="sphere" size="0.03"/></default>
</default>"""


def part_attributes(read, part, head=CLASSES):
    """Return the attributes of the geom of the body "part" after cleaning."""
    source = read(quadruped_mjcf(head=head, trunk_extra=part))
    return trunk_of(source).find("body[@name='part']/geom").attrib


def test_a_geom_takes_values_of_its_class_and_its_parents(read):
    attributes = part_attributes(read, '<body name="part"><geom class="small"/></body>')
    assert attributes == {
        "density": "300",
        "type": "box",
        "size": "0.05 0.05 0.05",
        "pos": "0.1 0 0",
        "quat": "1 0 0 1",
    }


def test_a_childclass_holds_for_what_is_below_it_until_another(read):
    outer = '<body name="part" childclass="part"><geom/><body name="inner"><geom/></body></body>'
    assert part_attributes(read, outer)["pos"] == "0.1 0 0"
    source = read(quadruped_mjcf(head=CLASSES, trunk_extra=outer.replace('"inner"', '"inner" childclass="ball"')))
    assert trunk_of(source).find("body/body[@name='inner']/geom").get("type") == "sphere"


def test_an_elements_own_class_and_own_values_win(read):
    assert part_attributes(read, '<body name="part" childclass="part"><geom class="ball"/></body>')["type"] == "sphere"
    own = part_attributes(read, '<body name="part" childclass="part"><geom size="1 1 1" density="1"/></body>')
    assert (own["size"], own["density"]) == ("1 1 1", "1")


@pytest.mark.parametrize("own", ['xyaxes="0 1 0 -1 0 0"', 'zaxis="0 1 0"', 'fromto="0 0 0 1 0 0"'])
def test_an_own_orientation_replaces_an_inherited_one_written_otherwise(read, own):
    attributes = part_attributes(read, f'<body name="part" childclass="part"><geom {own}/></body>')
    assert "quat" not in attributes
    assert own.split("=")[0] in attributes


def test_several_default_sections_add_up(read):
    head = RADIAN + '<default><geom density="300"/></default><default><geom group="2"/></default>'
    attributes = part_attributes(read, '<body name="part"><geom size="0.1"/></body>', head)
    assert (attributes["density"], attributes["group"]) == ("300", "2")


def test_a_foot_that_only_a_class_places_is_found(robot):
    legs = robot(head=RADIAN + '<default><geom type="sphere" size="0.02" pos="0 0 -0.2"/></default>').legs
    assert {leg.foot_in_body for leg in legs.values()} == {(0.0, 0.0, -0.2)}
    assert {leg.foot_radius for leg in legs.values()} == {FOOT_RADIUS}


def test_a_class_may_limit_joints_that_have_no_range_of_their_own(tmp_path):
    text = quadruped_mjcf(head=CLASSES).replace('name="FL_0" axis="1 0 0" range="-0.9 0.9"', 'name="FL_0" axis="1 0 0"')
    limits = dict(zip((robot := load_text(tmp_path, text)).joint_names, robot.upper_limit, strict=True))
    assert limits["FL_0"] == pytest.approx(0.1)
    assert limits["FR_0"] == pytest.approx(0.9)


# --- included files


def test_included_files_are_put_in_place(tmp_path):
    whole = quadruped_mjcf(arm=True)
    inner = re.search(r'<body name="arm_link_0".*</body></body>', whole).group()
    inner = inner[: inner.index("</body></body>") + len("</body></body>")]
    (tmp_path / "arm.xml").write_text(f"<mujocoinclude>{inner}</mujocoinclude>", encoding="utf-8")
    split = load_text(tmp_path, whole.replace(inner, '<include file="arm.xml"/>'), name="split.xml")
    assert split.mass == pytest.approx(load_text(tmp_path, whole).mass)
    assert set(split.locked_joints) == {"arm_0", "arm_1"}


def test_a_scene_may_include_the_robot_after_its_own_world(tmp_path):
    (tmp_path / "robot.xml").write_text(quadruped_mjcf(), encoding="utf-8")
    scene = """<mujoco><compiler autolimits="true"/><worldbody><light pos="0 0 3"/>
      <geom type="plane" size="1 1 1"/></worldbody>
      <include file="robot.xml"/></mujoco>"""
    robot = load_text(tmp_path, scene, name="scene.xml")
    alone = load_text(tmp_path, quadruped_mjcf())
    assert robot.mass == alone.mass
    np.testing.assert_array_equal(robot.upper_limit, alone.upper_limit)  # radians, as the robot's own file says
    assert robot.source.repairs == ("other elements of the world are ignored: geom, light",)


def test_nested_includes_are_relative_to_the_main_file_or_the_including_one(tmp_path):
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "head.xml").write_text('<mujoco><include file="angles.xml"/></mujoco>', encoding="utf-8")
    angles = tmp_path / "parts" / "angles.xml"
    angles.write_text(f"<mujoco>{RADIAN}</mujoco>", encoding="utf-8")
    text = quadruped_mjcf(head='<include file="parts/head.xml"/>')
    assert load_text(tmp_path, text).upper_limit[0] == pytest.approx(0.9)
    (tmp_path / "angles.xml").write_text('<mujoco><compiler angle="degree"/></mujoco>', encoding="utf-8")
    degrees = in_degrees(tmp_path, head='<include file="parts/head.xml"/>')
    assert degrees.upper_limit[0] == pytest.approx(np.deg2rad(90))


def test_files_that_include_each_other_are_refused(refusal, tmp_path):
    (tmp_path / "other.xml").write_text('<mujoco><include file="robot.xml"/></mujoco>', encoding="utf-8")
    assert refusal(quadruped_mjcf(head='<include file="other.xml"/>')) == (
        "robot model 'robot.xml' includes files more than 8 deep; is there a loop?"
    )


def test_a_missing_included_file_is_named(refusal):
    message = refusal(quadruped_mjcf(head='<include file="assets.xml"/>'))
    assert message.startswith("robot model 'robot.xml' includes 'assets.xml', which cannot be read: [Errno 2]")


# --- torque limits


ACTUATORS = [
    ("a motor's control range", '<motor joint="FL_0" ctrlrange="-23 23"/>', 23),
    ("times the gear", '<motor joint="FL_0" ctrlrange="-1 1" gear="40"/>', 40),
    ("the smaller side", '<motor joint="FL_0" ctrlrange="-20 30"/>', 20),
    ("a servo's force range", '<position joint="FL_0" ctrlrange="-1 1" forcerange="-17 17"/>', 17),
    ("not a servo's control range", '<position joint="FL_0" ctrlrange="-1 1"/>', np.inf),
    ("force range before control range", '<motor joint="FL_0" ctrlrange="-9 9" forcerange="-5 5"/>', 5),
    ("no limit", '<motor joint="FL_0"/>', np.inf),
    ("another joint's", '<motor joint="FL_1" ctrlrange="-23 23"/>', np.inf),
    ("a tendon's", '<motor tendon="t" ctrlrange="-23 23"/>', np.inf),
    ("of the class", '<motor class="strong" joint="FL_0"/>', 45),
    ("of a class that names another kind", '<general class="strong" joint="FL_0" forcerange="-7 7"/>', 7),
]


@pytest.mark.parametrize(("actuator", "limit"), [case[1:] for case in ACTUATORS], ids=[case[0] for case in ACTUATORS])
def test_the_actuator_determines_the_torque_limit(robot, actuator, limit):
    head = RADIAN + '<default><default class="strong"><motor ctrlrange="-45 45"/></default></default>'
    found = robot(head=head, tail=f"<actuator>{actuator}</actuator>")
    assert found.effort_limit[found.joint_names.index("FL_0")] == limit


def test_all_kinds_of_actuators_share_their_defaults(robot):
    head = RADIAN + '<default><general forcerange="-12 12"/></default>'
    found = robot(head=head, tail='<actuator><position joint="FL_0"/></actuator>')
    assert found.effort_limit[found.joint_names.index("FL_0")] == 12


@pytest.mark.parametrize(("own", "limit"), [("-10 10", 10), ("-30 30", 23)])
def test_the_smaller_of_the_joints_and_the_actuators_limit_holds(robot, own, limit):
    head = RADIAN + f'<default><joint actuatorfrcrange="{own}"/></default>'
    found = robot(head=head, tail='<actuator><motor joint="FL_0" ctrlrange="-23 23"/></actuator>')
    assert found.effort_limit[found.joint_names.index("FL_0")] == limit
    assert found.effort_limit[found.joint_names.index("FR_0")] == float(own.split()[1])


# --- joints


@pytest.mark.parametrize(
    "free", ["<freejoint/>", '<joint type="free"/>', '<freejoint name="root"/>', '<joint class="f"/>']
)
def test_a_trunk_may_have_any_form_of_free_joint(robot, free):
    head = RADIAN + '<default><default class="f"><joint type="free"/></default></default>'
    assert len(robot(head=head, free=free).joint_names) == 12


def in_degrees(folder, **changes):
    """Return the robot with the limits of its hip pitch joints and knees in degrees."""
    text = quadruped_mjcf(**changes).replace('"-2.7 2.7"', '"-150 150"').replace('"-0.9 0.9"', '"-90 90"')
    return load_text(folder, text)


def test_angles_are_degrees_by_default(robot, tmp_path):
    assert in_degrees(tmp_path, head="").upper_limit[0] == pytest.approx(np.deg2rad(90))
    assert robot(head='<compiler autolimits="true"/>' + RADIAN).upper_limit[0] == pytest.approx(0.9)


def test_a_joint_without_a_range_or_with_one_switched_off_is_bounded_by_two_turns(tmp_path):
    text = quadruped_mjcf().replace('"FL_0"', '"FL_0" limited="false"')
    text = text.replace('name="FR_0" axis="1 0 0" range="-0.9 0.9"', 'name="FR_0" axis="1 0 0"')
    robot = load_text(tmp_path, text)
    for name in ("FL_0", "FR_0"):
        joint = robot.joint_names.index(name)
        assert (robot.lower_limit[joint], robot.upper_limit[joint]) == (-UNLIMITED_JOINT_RANGE, UNLIMITED_JOINT_RANGE)


def test_bodies_and_joints_need_no_names(tmp_path):
    named = load_text(tmp_path, quadruped_mjcf())
    text = re.sub(r'<(body|joint) name="[^"]*"', r"<\1", quadruped_mjcf())
    nameless = load_text(tmp_path, text)
    assert len(set(nameless.joint_names)) == 12
    assert nameless.mass == pytest.approx(named.mass)
    assert [leg.joints for leg in nameless.legs.values()] == [leg.joints for leg in named.legs.values()]


# --- the world, and what is left of it


def test_where_the_file_starts_the_robot_does_not_matter(robot):
    here, there = robot(), robot(attributes='pos="1 2 3" euler="0.3 0.2 1"')
    np.testing.assert_array_equal(there.pinocchio.jointPlacements[1].homogeneous, np.eye(4))
    assert there.legs == here.legs


def test_what_belongs_to_a_simulation_is_dropped(read):
    source = read(
        quadruped_mjcf(
            head=RADIAN + '<asset><mesh file="a.obj"/></asset><visual/><statistic extent="1"/><size njmax="9"/>',
            trunk_extra='<camera name="c"/><light pos="0 0 1"/><geom mesh="a" type="mesh" mass="0"/>',
            tail='<actuator><motor joint="FL_0"/></actuator><sensor><gyro site="s"/></sensor><contact/><keyframe/>',
        )
    )
    tags = {element.tag for element in ET.fromstring(source.xml).iter()}
    assert tags <= {"mujoco", "compiler", "worldbody", "body", "joint", "freejoint", "inertial", "geom", "site"}
    assert "a.obj" not in source.xml
    assert source.repairs == ("1 mesh geoms are ignored: the feet are modelled as spheres",)


def test_other_bodies_in_the_world_are_ignored_with_a_note(read):
    text = quadruped_mjcf().replace(
        "<worldbody>", '<worldbody><body name="box"><geom size="1"/></body><site name="s"/>'
    )
    source = read(text)
    assert source.repairs == ("other elements of the world are ignored: body, site",)
    assert trunk_of(source).get("name") == "trunk"
    assert len(ET.fromstring(source.xml).find("worldbody")) == 1


def test_the_base_link_may_only_be_the_free_body(read, refusal):
    assert read(quadruped_mjcf(), "trunk").format == "mjcf"
    assert refusal(quadruped_mjcf(), "torso") == (
        "robot model 'robot.xml': base link 'torso' is not the body with the free joint, 'trunk'"
    )


# --- masses


def test_masses_of_shapes_follow_from_volume_and_density(robot):
    foot, cylinder = 4 / 3 * np.pi * FOOT_RADIUS**3, np.pi * 0.03**2 * 0.04
    capsule, box = np.pi * 0.02**2 * (0.2 + 4 / 3 * 0.02), 0.04 * 0.04 * 0.16
    expected = 6 + 4 * (1500 * foot + 1000 * (cylinder + capsule + box))
    assert robot(explicit_inertia=False).mass == pytest.approx(expected)


def test_the_compiler_may_replace_inertials_by_shapes(robot):
    head = '<compiler angle="radian" inertiafromgeom="true"/>'
    shaped = robot(head=head, trunk_extra='<geom type="box" size="0.2 0.1 0.05" mass="3"/>')
    assert base_parameters(shaped).mass == pytest.approx(3)
    assert shaped.pinocchio.inertias[shaped.legs["FL"].joint_ids[0]].mass == 0.7  # has no shape


@pytest.mark.parametrize(
    "harmless", ['settotalmass="-1"', 'boundmass="0"', 'inertiagrouprange="0 5"', 'balanceinertia="true"']
)
def test_compiler_settings_that_change_no_mass_are_accepted(robot, harmless):
    assert robot(head=f'<compiler angle="radian" {harmless}/>').mass == pytest.approx(robot().mass)


@pytest.mark.parametrize(
    "setting", ["settotalmass='20'", "boundmass='0.1'", "boundinertia='1'", "inertiagrouprange='0 2'"]
)
def test_compiler_settings_that_change_masses_are_refused(refusal, setting):
    assert refusal(quadruped_mjcf(head=f"<compiler angle='radian' {setting}/>")) == (
        f"robot model 'robot.xml': <compiler {setting}> changes the masses of bodies; give every body an "
        "<inertial> with its mass and remove the setting"
    )


@pytest.mark.parametrize(
    "mesh", ['<geom mesh="m"/>', '<geom type="mesh" mesh="m"/><geom size="0.1"/>', '<geom mesh="m" density="200"/>']
)
def test_a_body_with_its_mass_from_a_mesh_is_refused(refusal, mesh):
    assert refusal(quadruped_mjcf(trunk_extra=f'<body name="shell">{mesh}</body>')) == (
        "robot model 'robot.xml': body 'shell' takes its mass from a mesh; give it an <inertial> element"
    )


@pytest.mark.parametrize("weightless", ['mass="0"', 'density="0"'])
def test_a_massless_mesh_is_ignored(robot, weightless):
    extra = f'<body name="shell"><geom mesh="m" {weightless}/><geom size="0.1" mass="2"/></body>'
    assert robot(trunk_extra=extra).mass == pytest.approx(robot().mass + 2)


# --- refusals


@pytest.mark.parametrize("tag", ["replicate", "attach", "composite", "flexcomp"])
def test_generated_bodies_are_refused(refusal, tag):
    assert refusal(quadruped_mjcf(trunk_extra=f'<body name="b"><{tag} count="3"/></body>')) == (
        f"robot model 'robot.xml' has a <{tag}>, which only MuJoCo can expand; load the file there, save it "
        "with mujoco.mj_saveLastXML and use that file"
    )


REFUSED = [
    (
        quadruped_mjcf(free=""),
        "robot model 'robot.xml' has no floating base: give the trunk's body a <freejoint/>",
    ),
    ("<mujoco/>", "robot model 'robot.xml' has no <body> in its <worldbody>"),
    (
        quadruped_mjcf(trunk_extra='<body><inertial pos="0 0 0" mass="nan" diaginertia="1 1 1"/></body>'),
        "robot model 'robot.xml': <inertial> of 'unnamed_body_1' has mass='nan'; every number must be finite",
    ),
    (
        quadruped_mjcf(trunk_extra='<body euler="a b c"/>'),
        "robot model 'robot.xml': <body> has euler='a b c'; every number must be finite",
    ),
    (
        quadruped_mjcf(trunk_extra='<body axisangle="0 0 0 1"/>'),
        "robot model 'robot.xml': <body> has an orientation whose axes or quaternion have no direction",
    ),
    (
        quadruped_mjcf(trunk_extra='<body axisangle="0 0 1"/>'),
        "robot model 'robot.xml': <body> has axisangle='0 0 1'; it must have 4 numbers",
    ),
    (
        quadruped_mjcf(tail='<actuator><motor joint="FL_0" ctrlrange="weak strong"/></actuator>'),
        "robot model 'robot.xml': could not convert string to float: 'weak'",
    ),
]


@pytest.mark.parametrize(
    ("text", "message"),
    REFUSED,
    ids=["no freejoint", "no body", "nan", "words", "no axis", "no angle", "words in range"],
)
def test_invalid_files_are_refused_with_the_reason(refusal, text, message):
    assert refusal(text) == message


def test_a_joint_of_more_than_one_axis_in_a_leg_is_refused(tmp_path):
    text = quadruped_mjcf().replace('<joint name="FL_0" axis="1 0 0" range="-0.9 0.9"/>', '<joint type="ball"/>')
    with pytest.raises(ModelError, match=r"leg joint 'unnamed_joint_1_0' is of more than one axis \(spherical\)"):
        load_text(tmp_path, text)


# --- orientations


finite = st.floats(-10, 10, allow_nan=False)
vectors = hnp.arrays(float, 3, elements=finite).filter(lambda v: np.linalg.norm(v) > 1e-3)


def read_orientation(key, numbers, angle="radian", sequence="xyz"):
    root = ET.fromstring(f'<mujoco><compiler angle="{angle}" eulerseq="{sequence}"/></mujoco>')
    element = ET.Element("body", {key: " ".join(repr(float(number)) for number in numbers)})
    return orientation(element, root)


@given(hnp.arrays(float, 4, elements=finite).filter(lambda q: np.linalg.norm(q) > 1e-3))
def test_a_quaternion_is_read_real_part_first(quat_wxyz):
    expected = Rotation.from_quat(quat_wxyz, scalar_first=True).as_matrix()
    np.testing.assert_allclose(read_orientation("quat", quat_wxyz), expected, atol=1e-9)


@given(hnp.arrays(float, 3, elements=finite), st.permutations("xyz"), st.booleans())
def test_small_letters_are_intrinsic_rotations_and_capitals_extrinsic(angles, letters, turned):
    sequence = "".join(letters) if turned else "".join(letters).upper()
    expected = Rotation.from_euler(sequence.swapcase(), angles).as_matrix()  # SciPy has them the other way round
    np.testing.assert_allclose(read_orientation("euler", angles, sequence=sequence), expected, atol=1e-9)
    np.testing.assert_allclose(read_orientation("euler", np.rad2deg(angles), "degree", sequence), expected, atol=1e-9)


@given(vectors, finite)
def test_an_axis_of_any_length_and_an_angle(axis, angle):
    expected = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix()
    np.testing.assert_allclose(read_orientation("axisangle", [*axis, angle]), expected, atol=1e-9)


@given(vectors)
def test_the_z_axis_goes_where_it_should_by_the_shortest_turn(axis):
    rotation = read_orientation("zaxis", axis)
    np.testing.assert_allclose(rotation[:, 2], axis / np.linalg.norm(axis), atol=1e-9)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(rotation) == pytest.approx(1)
    assert Rotation.from_matrix(rotation).magnitude() == pytest.approx(
        np.arctan2(np.linalg.norm(axis[:2]), axis[2]), abs=1e-6
    )


@given(vectors, vectors)
def test_two_axes_are_made_square(x, y):
    if np.linalg.norm(np.cross(x, y)) < 1e-2 * np.linalg.norm(x) * np.linalg.norm(y):
        return
    rotation = read_orientation("xyaxes", [*x, *y])
    np.testing.assert_allclose(rotation[:, 0], x / np.linalg.norm(x), atol=1e-9)
    assert rotation[:, 1] @ y > 0
    np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-9)
    assert np.linalg.det(rotation) == pytest.approx(1)


def test_frames_are_dissolved_into_what_they_hold(read):
    inner = """<frame pos="1 0 0" axisangle="0 0 2 1.5707963267948966">
      <frame pos="0 1 0"><body name="part" pos="1 0 0"><joint name="spin"/><geom size="1"/></body></frame>
      <geom name="line" type="capsule" size="0.1" fromto="0 0 0 1 0 0" mass="0"/></frame>"""
    trunk = trunk_of(read(quadruped_mjcf(trunk_extra=inner)))
    assert trunk.find(".//frame") is None
    part, line = trunk.find("body[@name='part']"), trunk.find("geom[@name='line']")
    np.testing.assert_allclose([float(word) for word in part.get("pos").split()], [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose([float(word) for word in part.get("xyaxes").split()], [0, 1, 0, -1, 0, 0], atol=1e-12)
    np.testing.assert_allclose([float(word) for word in line.get("fromto").split()], [1, 0, 0, 1, 1, 0], atol=1e-12)


def test_a_leg_may_be_in_a_frame(robot, tmp_path):
    text = quadruped_mjcf()
    before, leg = text.split('<body name="FL_link_0" pos="0.2 0.1 0.0">')
    leg, after = leg.split('<body name="FR_link_0"')
    frame = f'<frame pos="0.2 0.1 0"><body name="FL_link_0">{leg}</frame>'
    framed = load_text(tmp_path, f'{before}{frame}<body name="FR_link_0"{after}')
    assert framed.legs == robot().legs
    hip = framed.pinocchio.jointPlacements[framed.legs["FL"].joint_ids[0]]
    np.testing.assert_allclose(hip.translation, [0.2, 0.1, 0])


def test_all_four_feet_are_where_the_urdf_of_the_same_robot_has_them(robot):
    assert list(robot().legs) == list(FOUR_LEGS)
    assert {leg.foot_in_body for leg in robot().legs.values()} == {(0.0, 0.0, -0.2)}


# --- where joints are at home


def test_joints_are_locked_at_the_keyframe_home(read):
    legs = " ".join(["0.1 0.2 0.3"] * 4)
    keys = f'<keyframe><key qpos="{"9 " * 21}"/><key name="home" qpos="0 0 1 1 0 0 0 {legs} 0.4 -0.5"/></keyframe>'
    robot = RobotModel.from_source(read(quadruped_mjcf(arm=True, tail=keys)))
    assert list(robot.locked_joints.values()) == [0.4, -0.5]
    short = RobotModel.from_source(read(quadruped_mjcf(arm=True, tail=keys.replace(" -0.5", ""))))
    assert list(short.locked_joints.values()) == [0.0, 0.0]  # another robot's
