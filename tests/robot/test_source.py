"""Reader of URDF files: repairs, their notes, and refused files."""

import hashlib
import re
import warnings
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from robots import FOUR_LEGS, load_text, quadruped_mjcf, quadruped_urdf

from equipoise.errors import ModelError, ModelWarning
from equipoise.robot.cleaning.urdf import physical_inertia
from equipoise.robot.cleaning.urdf_joints import UNLIMITED_JOINT_RANGE
from equipoise.robot.model import RobotModel
from equipoise.robot.source import read_model_source

WORLD = '<link name="odom"/><link name="footprint"/>'


def with_inertia(text, link, **moments):
    """Return the URDF with other moments of inertia of one link; missing ones are zero."""
    root = ET.fromstring(text)
    for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"):
        root.find(f"link[@name='{link}']/inertial/inertia").set(key, str(moments.get(key, 0)))
    return ET.tostring(root, encoding="unicode")


def edited(pattern, replacement, **robot):
    """Return a synthetic URDF with the first match of a pattern replaced."""
    text, count = re.subn(pattern, replacement, quadruped_urdf(**robot), count=1)
    assert count == 1
    return text


@pytest.fixture
def read(tmp_path):
    """Read text as a file; {path} in an expected message is its path."""

    def read(text, base_link=None):
        path = tmp_path / "robot.urdf"
        path.write_text(text, encoding="utf-8")
        return read_model_source(path, base_link)

    return read


@pytest.fixture
def refusal(read, tmp_path):
    """Return the error message of a text, without the file's folder."""

    def refusal(text, base_link=None):
        with pytest.raises(ModelError) as error:
            read(text, base_link)
        return str(error.value).replace(str(tmp_path / "robot.urdf"), "robot.urdf")

    return refusal


def links_of(source):
    return {link.get("name"): link for link in ET.fromstring(source.xml).findall("link")}


def joint_of(source, name):
    return ET.fromstring(source.xml).find(f"joint[@name='{name}']")


def test_the_root_element_determines_the_format(read):
    assert read(quadruped_urdf()).format == "urdf"
    assert read(quadruped_mjcf()).format == "mjcf"


def test_the_hash_is_of_the_file_as_it_is_on_disk(read, tmp_path):
    source = read(quadruped_urdf())
    assert source.sha256 == hashlib.sha256((tmp_path / "robot.urdf").read_bytes()).hexdigest()
    assert source.path == tmp_path / "robot.urdf"


def test_a_file_without_defects_is_repaired_nowhere(a1, read):
    assert a1.source.repairs == ()
    assert read(quadruped_urdf(foot_links=False)).repairs == ()


def test_files_that_a_model_names_are_not_needed(read):
    meshes = """<visual><geometry><mesh filename="package://robot_description/meshes/a.dae"/></geometry></visual>
      <collision><geometry><mesh filename="file:///nowhere/a.stl"/></geometry></collision>"""
    text = quadruped_urdf(extra='<material name="grey"><texture filename="grey.png"/></material>').replace(
        '<link name="FL_link_1">', f'<link name="FL_link_1">{meshes}'
    )
    source = read(text.replace('<link name="FR_link_1">', f'<link name="FR_link_1">{meshes}'))
    assert "filename" not in source.xml
    assert source.repairs[0] == (
        "2 collision meshes are ignored: the feet are modelled as spheres and nothing else touches the floor"
    )


def test_unused_elements_are_removed(read):
    extra = '<transmission name="t"/><gazebo reference="trunk"/><sensor name="s"/>'
    dependent = '<mimic joint="FL_0"/><safety_controller k_velocity="1"/></joint>'
    source = read(quadruped_urdf(extra=extra).replace("</joint>", dependent))
    tags = {element.tag for element in ET.fromstring(source.xml).iter()}
    assert not tags & {"transmission", "gazebo", "sensor", "mimic", "safety_controller"}


def test_links_with_almost_no_mass_are_massless_and_named(read):
    tiny = '<inertial><mass value="1e-7"/><inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial>'
    extra = "".join(
        f'<link name="camera_{i}">{tiny}</link><joint name="c{i}" type="fixed"><parent link="trunk"/>'
        f'<child link="camera_{i}"/></joint>'
        for i in range(5)
    )
    source = read(quadruped_urdf(extra=extra))
    assert source.repairs == (
        "5 links with (almost) no mass are treated as massless: camera_0, camera_1, camera_2, camera_3, ...",
    )
    assert links_of(source)["camera_0"].find("inertial") is None


def test_an_unphysical_inertia_is_repaired_with_a_note(read):
    source = read(with_inertia(quadruped_urdf(), "FL_link_1", ixx=0.001, iyy=0.002, izz=0.005))
    assert source.repairs == (
        "link 'FL_link_1' has an inertia that no body can have (principal moments 0.001, 0.002, 0.005 kg m2); "
        "it was moved to the nearest physical one",
    )
    repaired = links_of(source)["FL_link_1"].find("inertial/inertia")
    xx, yy, zz = (float(repaired.get(key)) for key in ("ixx", "iyy", "izz"))
    # Ixx is the integral of y2 + z2: the z2 of 1 kg was negative and is now a millimetre's.
    assert (xx, yy, zz) == pytest.approx((0.002 + 1e-6, 0.003 + 1e-6, 0.005))


def test_a_plate_with_rounded_moments_is_repaired_without_a_note(read):
    source = read(with_inertia(quadruped_urdf(), "FL_link_1", ixx=0.001, iyy=0.002, izz=0.003001))
    assert source.repairs == ()
    repaired = links_of(source)["FL_link_1"].find("inertial/inertia")
    xx, yy, zz = (float(repaired.get(key)) for key in ("ixx", "iyy", "izz"))
    assert zz < xx + yy
    assert (xx, yy, zz) == pytest.approx((0.001, 0.002, 0.003), rel=1e-3)


symmetric = hnp.arrays(float, (3, 3), elements=st.floats(-1, 1, allow_subnormal=False)).map(lambda a: a + a.T)


@given(inertia=symmetric, mass=st.floats(1e-3, 100))
def test_a_repaired_inertia_is_physical_in_the_same_axes_and_is_repaired_no_further(inertia, mass):
    repaired = physical_inertia(inertia, mass)
    smallest, middle, largest = np.linalg.eigvalsh(repaired)
    assert smallest > 0
    assert largest <= smallest + middle
    np.testing.assert_allclose(repaired, repaired.T, atol=1e-12)
    # The two share their principal axes, so they commute.
    np.testing.assert_allclose(repaired @ inertia, inertia @ repaired, atol=1e-6 * max(1, mass))
    np.testing.assert_allclose(physical_inertia(repaired, mass), repaired, rtol=1e-9, atol=1e-12)


@given(points=hnp.arrays(float, (5, 3), elements=st.floats(-1, 1)), mass=st.floats(0.1, 10))
def test_the_inertia_of_real_matter_stays_as_it_is(points, mass):
    points = points + np.random.default_rng(0).normal(size=(5, 3))  # no plane holds all five
    second_moments = mass * points.T @ points
    inertia = np.trace(second_moments) * np.eye(3) - second_moments
    if np.linalg.eigvalsh(second_moments).min() > 1e-6:
        np.testing.assert_array_equal(physical_inertia(inertia, mass), inertia)


def test_a_massless_world_above_the_trunk_is_dropped(read):
    source = read(quadruped_urdf(world=True, foot_links=False))
    assert source.repairs == ("links above the base 'trunk' are ignored: world",)
    assert "world" not in links_of(source)
    assert joint_of(source, "fix_base") is None


def test_a_chain_of_massless_links_is_dropped_down_to_the_trunk(read):
    extra = (
        f'{WORLD}<joint name="a" type="floating"><parent link="odom"/><child link="footprint"/></joint>'
        '<joint name="b" type="fixed"><parent link="footprint"/><child link="trunk"/></joint>'
    )
    source = read(quadruped_urdf(extra=extra, foot_links=False))
    assert source.repairs == ("links above the base 'trunk' are ignored: odom, footprint",)


def test_a_described_base_link_ends_the_chain(read):
    assert read(quadruped_urdf(world=True, foot_links=False), "trunk").repairs != ()
    source = read(quadruped_urdf(world=True, foot_links=False), "world")
    assert source.repairs == ()
    assert "world" in links_of(source)


def test_continuous_joints_are_bounded(read):
    joint = joint_of(read(quadruped_urdf(continuous=True)), "FL_1")
    assert joint.get("type") == "revolute"
    assert float(joint.find("limit").get("lower")) == -UNLIMITED_JOINT_RANGE
    assert float(joint.find("limit").get("upper")) == UNLIMITED_JOINT_RANGE
    assert float(joint.find("limit").get("effort")) == 30


def test_a_joint_without_limits_gets_the_element_that_readers_want(read):
    source = read(edited(r'<axis xyz="1 0 0"/><limit [^>]*>', '<axis xyz="1 0 0"/>'))
    assert joint_of(source, "FL_0").find("limit").attrib == {
        "lower": str(-UNLIMITED_JOINT_RANGE),
        "upper": str(UNLIMITED_JOINT_RANGE),
        "effort": "0.0",
        "velocity": "0.0",
    }


@pytest.mark.parametrize(
    ("pattern", "replacement"),
    [(r' ixy="[^"]*"', ""), ('xyz="0.01 0.002', 'xyz=" 0.01\\n0.002')],
    ids=["no product of inertia", "a line break"],
)
def test_text_that_another_reader_accepts_keeps_its_mass(tmp_path, pattern, replacement):
    assert load_text(tmp_path, edited(pattern, replacement)).mass == load_text(tmp_path, quadruped_urdf()).mass


def test_names_may_be_nan_or_inf(read):
    assert "nan" in links_of(read(quadruped_urdf(trunk="nan")))


NOT_MODELS = [
    ("", "is not valid XML: no element found: line 1, column 0"),
    ("solid cube", "is not valid XML: syntax error: line 1, column 0"),
    ("<robot><link></robot>", "is not valid XML: mismatched tag: line 1, column 15"),
    (
        "<html></html>",
        "starts with <html>; expected <robot> (URDF; run xacro first on a .xacro file) or <mujoco> (MJCF)",
    ),
    (
        '<robot name="a" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include filename="b"/><link name="c"/></robot>',
        "is a xacro file; run xacro on it and use the URDF that it writes",
    ),
    ('<robot name="a"/>', "has no <link>"),
    ('<robot name="a"><link name="b"/></robot>', "has no mass: no link has an <inertial> with a positive mass"),
]


@pytest.mark.parametrize(("text", "message"), NOT_MODELS, ids=[message[:20] for _, message in NOT_MODELS])
def test_other_files_are_refused_with_the_reason(refusal, text, message):
    assert refusal(text) == f"robot model 'robot.urdf' {message}"


def test_expanded_xacro_is_accepted(read):
    text = quadruped_urdf().replace("<robot ", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" ')
    assert read(text).format == "urdf"


DEFECTS = [
    (
        quadruped_urdf(trunk_mass="nan"),
        ": <mass> of 'trunk' has value='nan'; every number must be finite",
    ),
    (
        edited('lower="-0.9"', 'lower="-inf"'),
        ": <limit> of 'FL_0' has lower='-inf'; every number must be finite",
    ),
    (quadruped_urdf(trunk_mass=-6.0), ": link 'trunk' has a negative mass, -6.0 kg"),
    (quadruped_urdf(trunk_mass="heavy"), ": link 'trunk': mass is 'heavy', which is not a number"),
    (
        edited('effort="30"', 'effort="strong"'),
        ": joint 'FL_0': effort is 'strong', which is not a number",
    ),
    (edited("ixx=", 'ixx="round" unused='), ": link 'trunk': ixx is 'round', which is not a number"),
    (
        edited('xyz="0.01 0.002', 'xyz="0,01 0.002'),
        ": link 'trunk': xyz of its <inertial> is '0,01', which is not a number; write decimals with a point",
    ),
    (
        edited('xyz="0.01 0.002 ', 'xyz="0.01 '),
        ": link 'trunk': xyz of its <inertial> is '0.01 0.005'; it must be three numbers",
    ),
    (edited("<inertia [^>]*>", ""), ": link 'trunk' has a mass and no <inertia>"),
    (
        edited('<parent link="trunk"/>', '<parent link="truck"/>'),
        ": joint 'FL_0' names a link 'truck' that does not exist",
    ),
    (edited('<parent link="trunk"/>', ""), ": joint 'FL_0' lacks a <parent> or a <child>"),
    (
        quadruped_urdf(extra='<link name="island"/>'),
        " has 2 root links (trunk, island); a robot is one tree",
    ),
    (
        quadruped_urdf(
            extra='<joint name="bar" type="fixed"><parent link="FR_foot"/><child link="FL_foot"/></joint>',
        ),
        ": link 'FL_foot' is the child of two joints, 'FL_foot_joint' and 'bar'; a robot is one tree",
    ),
    (
        quadruped_urdf(
            extra='<link name="a"/><link name="b"/>'
            '<joint name="ab" type="fixed"><parent link="a"/><child link="b"/></joint>'
            '<joint name="ba" type="fixed"><parent link="b"/><child link="a"/></joint>',
        ),
        ": links a, b form a loop; a robot is one tree",
    ),
]


@pytest.mark.parametrize(("text", "message"), DEFECTS, ids=[message[:40] for _, message in DEFECTS])
def test_invalid_models_are_refused_with_the_place(refusal, text, message):
    assert refusal(text) == f"robot model 'robot.urdf'{message}"


def test_a_base_link_that_does_not_exist_is_refused_with_those_that_do(refusal):
    links = ", ".join(sorted(["trunk", *(f"{leg}_link_{i}" for leg in FOUR_LEGS for i in range(3))]))
    assert (
        refusal(quadruped_urdf(foot_links=False), "body")
        == f"robot model 'robot.urdf' has no link 'body'; it has {links}"
    )


def test_a_base_link_below_something_with_mass_is_refused(refusal):
    assert refusal(quadruped_urdf(), "FL_link_0") == (
        "base link 'FL_link_0' is below 'trunk', which has mass or more than one joint: 'trunk' is the base"
    )


def test_a_missing_file_is_refused_with_a_hint(tmp_path):
    path = tmp_path / "nowhere.urdf"
    with pytest.raises(ModelError) as error:
        read_model_source(path)
    assert str(error.value) == f"robot model '{path}' does not exist; see 'equipoise robots' for known names"


def test_a_folder_is_refused(tmp_path):
    with pytest.raises(ModelError, match="is a folder; give the URDF or MJCF file"):
        read_model_source(tmp_path)


UNREADABLE = [
    edited('xyz="0.2 0.1 0.0"', 'xyz="front left"'),
    edited('xyz="0.2 0.1 0.0"', 'xyz="0.2 0.1"'),
    edited('name="FL_0" type="revolute"', 'name="FL_0" type="hinge"'),
    quadruped_urdf(extra='<link name="trunk"/>'),
    edited('joint name="FL_0"', "joint"),
]


@pytest.mark.parametrize("text", UNREADABLE, ids=["words", "two numbers", "joint type", "two trunks", "no name"])
def test_errors_of_the_urdf_reader_are_model_errors(tmp_path, text):
    path = tmp_path / "robot.urdf"
    path.write_text(text, encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        with pytest.raises(ModelError, match="cannot be read by Pinocchio"):
            RobotModel.from_file(path)


def test_every_repair_is_a_warning_that_names_the_robot(tmp_path):
    path = tmp_path / "spot.urdf"
    path.write_text(quadruped_urdf(world=True), encoding="utf-8")
    with pytest.warns(ModelWarning, match=r"^spot: links above the base 'trunk' are ignored: world$"):
        RobotModel.from_file(path)
