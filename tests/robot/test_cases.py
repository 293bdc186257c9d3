"""Defects of public model files and their variants: read correctly, or refused with the name and the remedy."""

import re
import warnings

import cases
import numpy as np
import pinocchio as pin
import pytest
from robots import load_text

from equipoise import nominal_stance
from equipoise.errors import ModelError, ModelWarning, SettingsError
from equipoise.robot.audit import audit
from equipoise.robot.cleaning.urdf_joints import UNLIMITED_JOINT_RANGE
from equipoise.robot.description import LEG_NAMES, RobotDescription
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.kinematics import foot_positions
from equipoise.robot.model import RobotModel

BOX = '<collision><origin xyz="0.02 0 0.01"/><geometry><box size="{}"/></geometry></collision>'

MIMIC = '<mimic joint="{}" multiplier="-2" offset="0"/>'
FINGERS = "".join(
    f'<link name="finger_{side}"><inertial><mass value="0.02"/>'
    '<inertia ixx="1e-5" iyy="1e-5" izz="1.1e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    f'<joint name="grip_{side}" type="prismatic"><parent link="trunk"/><child link="finger_{side}"/><axis xyz="0 1 0"/>'
    f'<limit lower="0" upper="0.03" effort="1" velocity="1"/>{mimic}</joint>'
    for side, mimic in (("left", ""), ("right", MIMIC.format("grip_left")))
)


@pytest.fixture
def load(tmp_path):
    return lambda text, description=None: load_text(tmp_path, text, description)


@pytest.fixture
def refusal(load):
    """Return the error message of a file, after its name."""

    def refusal(text, description=None, error=ModelError):
        with pytest.raises(error) as caught:
            load(text, description)
        return re.sub(r"^robot model '.*?':? ", "", str(caught.value))

    return refusal


@pytest.fixture
def warned(tmp_path):
    """Return the warnings of a file, except those on meshes and massless links."""

    def warned(text):
        path = tmp_path / "quad.urdf"
        path.write_text(text, encoding="utf-8")
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            RobotModel.from_file(path)
        return [str(each.message) for each in caught if each.category is ModelWarning]

    return warned


def findings(robot, severity="warning"):
    return [(finding.body, finding.text) for finding in audit(robot).findings if finding.severity == severity]


def composite(robot):
    return composite_parameters(robot, nominal_stance(robot).joint_position)


def limits_of(robot, joint):
    index = robot.joint_names.index(joint)
    return robot.lower_limit[index], robot.upper_limit[index]


def test_the_robot_of_the_cases_has_no_findings(load, warned):
    robot = load(cases.urdf())
    np.testing.assert_allclose(composite(robot).com * 1000, cases.COM_MM, atol=0.06)
    np.testing.assert_allclose(np.diag(composite(robot).inertia), cases.MOMENTS, rtol=1e-3)
    assert findings(robot) == findings(robot, "error") == warned(cases.urdf()) == []
    assert findings(load(cases.mjcf(cases.FREE)), "error") == []


# --- limits


@pytest.mark.parametrize("angle", [0.0, 0.2, -0.3])
def test_equal_limits_lock_a_joint_where_they_are(load, angle):
    robot = load(cases.with_limits(cases.urdf(), "hip", f'lower="{angle}" upper="{angle}"'))
    assert not {f"{leg}_hip_joint" for leg in LEG_NAMES} & set(robot.joint_names)
    assert robot.mass == pytest.approx(12)
    free, knees = load(cases.urdf()), np.tile([0.5, -1.2], 4)
    bent = np.insert(knees, [0, 2, 4, 6], angle)
    np.testing.assert_allclose(foot_positions(robot, knees), foot_positions(free, bent), atol=1e-12)
    one, other = (composite_parameters(*at).inertia for at in ((robot, knees), (free, bent)))
    np.testing.assert_allclose(one, other, atol=1e-12)
    assert any(f"FL_hip_joint at {angle:g}" in text for _, text in findings(robot, "note"))


@pytest.mark.parametrize("axis", ["1 0 0", "0 0.6 0.8"])
@pytest.mark.parametrize("reference", [0.0, 0.1])
def test_equal_ends_of_a_range_lock_a_joint_of_mjcf(load, axis, reference):
    def robot(attributes):
        old = 'axis="1 0 0" range="-0.8 0.8"'
        return load(cases.mjcf(cases.FREE).replace(old, f'axis="{axis}" ref="{reference}" {attributes}'))

    locked, free, knees = robot('range="0.25 0.25"'), robot('range="-0.8 0.8"'), np.tile([0.5, -1.2], 4)
    assert len(locked.joint_names) == 8
    bent = np.insert(knees, [0, 2, 4, 6], 0.25)
    np.testing.assert_allclose(foot_positions(locked, knees), foot_positions(free, bent), atol=1e-12)


def test_a_locked_joint_in_degrees_is_locked_at_its_angle(load):
    text = re.sub(
        r'range="([^"]*)"',
        lambda found: 'range="{:.9g} {:.9g}"'.format(*np.degrees([float(word) for word in found[1].split()])),
        cases.mjcf(cases.FREE, compiler=""),
    ).replace('axis="1 0 0" range="-45.8366236 45.8366236"', 'axis="1 0 0" range="10 10"')
    robot = load(text)
    assert robot.source.locked["FL_hip_joint"] == pytest.approx(np.radians(10))
    assert limits_of(robot, "FL_calf_joint") == pytest.approx((-2.6, -0.5))


def test_a_wheel_that_is_locked_is_the_foot(load):
    text = cases.urdf().replace(
        '_foot_fixed" type="fixed">', '_foot_fixed" type="revolute"><limit lower="0" upper="0"/>'
    )
    robot = load(text)
    np.testing.assert_array_equal(robot.lower_limit, load(cases.urdf()).lower_limit)
    assert {leg.foot_radius for leg in robot.legs.values()} == {0.02}


def test_a_slider_that_is_locked_stays_where_it_is(load):
    finger = FINGERS.replace('lower="0" upper="0.03"', 'lower="0.02" upper="0.02"').replace(
        MIMIC.format("grip_left"), ""
    )
    still = FINGERS.replace("<parent", '<origin xyz="0 0.02 0"/><parent').replace('"prismatic"', '"fixed"')
    locked, fixed = (load(cases.urdf(extra=extra)) for extra in (finger, still))
    assert (locked.locked_joints, set(locked.source.locked)) == ({}, {"grip_left", "grip_right"})
    np.testing.assert_allclose(composite(locked).com, composite(fixed).com, atol=1e-12)


def test_a_robot_whose_joints_are_all_locked_is_refused_with_their_names(refusal):
    text = cases.urdf()
    for part in cases.LIMITS:
        text = cases.with_limits(text, part, 'lower="0" upper="0"')
    message = refusal(text)
    assert "limbs found: none; FL_hip_joint, FL_thigh_joint, " in message
    assert message.endswith("are locked by equal limits: give the range of those that move")


@pytest.mark.parametrize("part", cases.LIMITS)
def test_exchanged_limits_are_refused(refusal, part):
    message = refusal(cases.with_limits(cases.urdf(), part, 'lower="0.5" upper="-0.4"'))
    assert message.startswith(f"joint 'FL_{part}_joint' has the limits 0.5 to -0.4, which are exchanged")
    text = cases.mjcf(cases.FREE).replace('range="-0.8 0.8"', 'range="0.8 -0.8"')
    assert refusal(text).startswith("joint 'FL_hip_joint' has the range 0.8 to -0.8, whose ends are exchanged")


def test_a_bound_that_is_missing_is_zero_and_named(load, warned, refusal):
    text = cases.with_limits(cases.urdf(), "calf", 'lower="-2.6"')
    assert limits_of(load(text), "FL_calf_joint") == (-2.6, 0.0)
    assert "quad: joint 'FL_calf_joint' has no upper limit, which is 0 in URDF" in warned(text)
    assert "are exchanged" in refusal(cases.with_limits(cases.urdf(), "calf", 'lower="0.5"'))


@pytest.mark.parametrize("attributes", ["", None])
def test_joints_without_limits_turn_two_turns_and_are_named(load, warned, attributes):
    text = cases.with_limits(cases.urdf(), "calf", "")
    if attributes is None:
        text = text.replace('<limit  effort="20" velocity="20"/>', "")
    assert limits_of(load(text), "FL_calf_joint") == (-UNLIMITED_JOINT_RANGE, UNLIMITED_JOINT_RANGE)
    (message,) = warned(text)
    assert message.startswith("quad: joints without position limits get 6.28 rad to either side: FL_calf")
    described = RobotDescription(joint_limits={"FL_calf_joint": (-2.6, -0.5)})
    assert limits_of(load(text, described), "FL_calf_joint") == (-2.6, -0.5)


def test_limits_of_a_continuous_joint_are_ignored(load):
    text = cases.with_limits(cases.urdf(), "thigh", 'lower="0" upper="0"').replace(
        '_thigh_joint" type="revolute"', '_thigh_joint" type="continuous"'
    )
    robot = load(text)
    assert limits_of(robot, "FL_thigh_joint") == (-UNLIMITED_JOINT_RANGE, UNLIMITED_JOINT_RANGE)
    assert any("no position limit within two turns of FL_thigh_joint" in text for _, text in findings(robot, "note"))


@pytest.mark.parametrize("value", ["nan", "inf", "-inf"])
def test_limits_that_are_not_finite_are_refused_with_the_joint(refusal, value):
    message = refusal(cases.with_limits(cases.urdf(), "hip", f'lower="{value}" upper="0.8"'))
    assert message == f"<limit> of 'FL_hip_joint' has lower={value!r}; every number must be finite"


@pytest.mark.parametrize(
    ("part", "limits"),
    [("calf", (-150, -30)), ("calf", (-150, 0)), ("thigh", (-90, 170)), ("hip", (-45, 45)), ("hip", (-46.5, 46.5))],
)
def test_limits_in_degrees_are_refused(refusal, part, limits):
    message = refusal(cases.with_limits(cases.urdf(), part, 'lower="{}" upper="{}"'.format(*limits)))
    assert message.startswith(
        f"position limits look like degrees: FL_{part}_joint {limits[0]:g} to {limits[1]:g} rad, "
    )
    assert message.endswith("give them in radians")


@pytest.mark.parametrize("most", [2 * np.pi, 9.42, 10, 12.566, 12.57, 31.4, 100, 1000, 1e6])
def test_limits_that_mean_no_limit_are_not_degrees(load, most):
    robot = load(cases.with_limits(cases.urdf(), "thigh", f'lower="{-most}" upper="{most}"'))
    assert limits_of(robot, "FL_thigh_joint") == (-UNLIMITED_JOINT_RANGE, UNLIMITED_JOINT_RANGE)


def test_radians_that_are_read_as_degrees_are_refused(refusal):
    message = refusal(cases.mjcf(cases.FREE, compiler=""))
    assert message.startswith("no leg joint may turn by more than 0.0524 rad: its position limits look like radians")


MIRRORED = {"hip": (-0.4, 1.2), "thigh": (-3.0, 1.5), "calf": (0.5, 2.6)}


def test_limits_that_are_copied_and_not_mirrored_are_warned_of(load, warned):
    text = cases.urdf(mirrored_axes=True)
    message = (
        "limits of FL_calf_joint and FR_calf_joint are not mirrored: -2.6 to -0.5 rad both, though equal angles do not mirror "
        "these legs; mirrored, FL_calf_joint has 0.5 to 2.6 rad"
    )
    assert f"quad: {message}" in warned(text)
    assert ("", message) in findings(load(text))
    assert len(warned(text)) == 4  # thighs and calves; the hips' limits are symmetric


def test_mirrored_limits_are_not_warned_of(load, warned):
    text = cases.urdf(mirrored_axes=True, limits={**cases.LIMITS, "hip": (-0.4, 1.2)}, left_limits=MIRRORED)
    assert warned(text) == []
    np.testing.assert_allclose(composite(load(text)).com * 1000, cases.COM_MM, atol=0.06)


def test_hip_limits_that_are_copied_are_warned_of(warned):
    one_sided = {**cases.LIMITS, "hip": (-0.4, 1.2)}
    assert [
        re.findall(r"of (\w+) and", message) for message in warned(cases.urdf(limits=one_sided, left_limits=one_sided))
    ] == [
        ["FL_hip_joint"],
        ["RL_hip_joint"],
    ]


def test_limits_that_differ_between_the_sides_are_warned_of(warned):
    (message, _) = warned(cases.urdf(left_limits={**cases.LIMITS, "calf": (-2.0, -0.5)}))
    assert message == (
        "quad: limits of FL_calf_joint and FR_calf_joint are not mirrored: -2 to -0.5 rad and -2.6 to -0.5 rad; mirrored, "
        "FL_calf_joint has -2.6 to -0.5 rad"
    )


def test_limits_that_differ_by_tolerances_are_not_warned_of(warned):
    assert warned(cases.urdf(left_limits={**cases.LIMITS, "calf": (-2.51, -0.5)})) == []
    assert len(warned(cases.urdf(left_limits={**cases.LIMITS, "calf": (-2.49, -0.5)}))) == 2


def test_limits_that_a_description_narrows_on_one_side_are_no_defect_of_the_file(load):
    described = RobotDescription(joint_limits={"FL_calf_joint": (-2.0, -1.0)})
    assert findings(load(cases.urdf(), described)) == []


@pytest.mark.parametrize("limits", [(-2.6, -2.6), (-0.5, -2.6)])
def test_described_limits_lock_and_exchange_nothing(limits):
    with pytest.raises(SettingsError, match="the lower one comes first, and they may not be equal"):
        RobotDescription(joint_limits={"FL_calf_joint": limits})


# --- masses and inertias


@pytest.mark.parametrize(("factor", "unit"), [(1000, "millimetres"), (100, "centimetres")])
def test_centres_of_mass_in_another_unit_are_refused_with_the_factor(refusal, factor, unit):
    message = refusal(cases.with_coms_times(cases.urdf(), factor))
    assert (
        f"it looks like {unit}; divide by {factor} the centres of mass of trunk, FL_hip, FL_thigh, FL_calf, " in message
    )
    assert message.endswith(", and of all other links")


@pytest.mark.parametrize("link", ["trunk", "FL_thigh", "RR_calf"])
def test_a_single_centre_of_mass_in_millimetres_is_refused(refusal, link):
    message = refusal(cases.with_coms_times(cases.urdf(), 1000, link))
    assert message.startswith(f"the centre of mass of link '{link}' is ")
    assert message.endswith(f"it looks like millimetres; divide by 1000 the centres of mass of {link}")


@pytest.mark.parametrize(("link", "shown"), [("trunk", "2"), ("FL_thigh", "4")])
def test_a_single_centre_of_mass_that_may_be_in_either_unit_is_refused_with_both(refusal, link, shown):
    message = refusal(cases.with_coms_times(cases.urdf(), 100, link))
    assert f"link {link!r} is {shown}" in message
    assert message.endswith(f"like centimetres or millimetres; divide by 100 or 1000 the centres of mass of {link}")


@pytest.mark.parametrize(("unit", "power"), [("kg cm2", 4), ("kg mm2", 6), ("g cm2", 7), ("g mm2", 9)])
@pytest.mark.parametrize("link", [r"\w+", "trunk"])
def test_inertias_in_another_unit_are_refused_with_the_factor(refusal, unit, power, link):
    message = refusal(cases.with_inertias_times(cases.urdf(), 10.0**power, link))
    assert f"it looks like {unit}; divide by 1e{power} the inertias of trunk" in message
    assert message.endswith("all other links" if link != "trunk" else "of trunk, which gives kg m2")


@pytest.mark.parametrize("power", [7, 9])
def test_those_of_light_links_are_refused_without_a_guess(refusal, power):
    text = cases.urdf().replace('ixx="8e-06"', 'ixx="7.5e-06"')  # of equal moments it is a placeholder
    message = refusal(cases.with_inertias_times(text, 10.0**power, r"\w+_foot"))
    assert "give the inertias of FL_foot, FR_foot, RL_foot, RR_foot in kg m2 (1 kg cm2 is 1e-4" in message


def test_an_unphysical_inertia_is_not_a_unit_error(load):
    text = cases.urdf().replace('ixx="0.025"', 'ixx="90.025"')
    assert [link for link, _ in findings(load(text), "error")] == ["trunk"]


@pytest.mark.parametrize("moment", [0.1, 1.0])
def test_a_placeholder_is_not_a_unit_error(load, moment):
    text = re.sub(r'i([xyz])\1="[^"]*"', rf'i\1\1="{moment}"', cases.urdf())
    assert any("placeholder" in text for _, text in findings(load(text)))


@pytest.mark.parametrize("moved", ["0.1 0 -0.04", "0 0 0.1", "0 0.2 -0.04"])
def test_a_centre_of_mass_outside_its_links_is_a_warning(load, moved):
    text = re.sub(r'(_thigh"><inertial><origin xyz=)"[^"]*"', rf'\1"{moved}"', cases.urdf())
    links, texts = zip(*findings(load(text)), strict=True)
    assert "FL_thigh, FR_thigh, RL_thigh, RR_thigh" in links
    assert any(
        re.search(r"a centre of mass at \(.*\) mm that is \d+ mm outside its joints and shapes", text) for text in texts
    )


def test_a_centre_of_mass_inside_its_collision_shape_is_not_outside(load):
    shape = '<collision><origin xyz="0.1 0 0"/><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'
    text = re.sub(r'(_thigh">)(<inertial><origin xyz=)"[^"]*"', rf'\1{shape}\2"0.1 0 0"', cases.urdf())
    assert findings(load(text)) == []


@pytest.mark.parametrize("share", [0.3, 1 / 4, 3.0, 4.0])
def test_a_trunk_whose_inertia_is_not_that_of_its_shape_is_a_warning(load, share):
    x, y, z = edges = 0.4, 0.2, 0.1
    moments = [share * 6 / 12 * (a**2 + b**2) for a, b in ((y, z), (z, x), (x, y))]
    text = cases.urdf().replace(
        '<link name="trunk">' + cases.inertial("0.02 0 0.01", 6.0, (0.025, 0.085, 0.1)),
        '<link name="trunk">{}{}'.format(
            cases.inertial("0.02 0 0.01", 6.0, moments), BOX.format(" ".join(map(str, edges)))
        ),
    )
    (finding,) = findings(load(text))
    shown = f"{share:.2g}"
    assert finding == (
        "trunk",
        f"moments of inertia Ixx, Iyy, Izz that are {shown}, {shown}, {shown} times those of its collision shapes filled "
        "with its mass",
    )


@pytest.mark.parametrize("edges", ["0.4 0.2 0.1", "0.05 0.05 0.02", "1 1 1"])  # right, a camera, a cover for contacts
def test_a_trunk_like_its_shape_or_with_a_shape_that_is_not_the_trunk_is_no_warning(load, edges):
    text = cases.urdf().replace('<link name="trunk">', f'<link name="trunk">{BOX.format(edges)}')
    assert findings(load(text)) == []


# --- couplings


def test_leg_joints_that_mimic_are_refused(refusal):
    belt = MIMIC.format(r"\2_thigh_joint")
    text = re.sub(r'(name="(\w\w)_calf_joint".*?)</joint>', rf"\1{belt}</joint>", cases.urdf())
    message = refusal(text)
    assert message.startswith(
        "leg joints are coupled, but equipoise moves each independently: FL_calf_joint with FL_thigh_joint (<mimic>), "
    )
    assert message.endswith("if they are not coupled on the robot, remove the couplings in a copy of the file")


def test_a_gripper_that_mimics_is_locked_with_a_note(load):
    robot = load(cases.urdf(extra=FINGERS))
    assert set(robot.locked_joints) == {"grip_left", "grip_right"}
    notes = [text for _, text in findings(robot, "note")]
    assert "couplings of locked joints are ignored: grip_right with grip_left (<mimic>)" in notes


TENDON = '<tendon><fixed name="belt"{}><joint joint="FL_thigh_joint" coef="1"/><joint joint="FL_calf_joint" coef="1"/></fixed>'
COUPLED = {
    "equality of two joints": (
        '<equality><joint joint1="FL_calf_joint" joint2="FL_thigh_joint" polycoef="0 -2 0 0 0"/></equality>',
        "FL_calf_joint with FL_thigh_joint (<equality> <joint>)",
    ),
    "equality with a constant": (
        '<equality><joint joint1="FL_calf_joint"/></equality>',
        "FL_calf_joint (<equality> <joint>)",
    ),
    "closed loop": (
        '<equality><connect body1="FL_calf" body2="FL_hip" anchor="0 0 0"/></equality>',
        "FL_calf_joint with FL_hip_joint (<equality> <connect>)",
    ),
    "equality of a tendon": (
        TENDON.format("") + '</tendon><equality><tendon tendon1="belt"/></equality>',
        "FL_thigh_joint with FL_calf_joint (<equality> <tendon>)",
    ),
    "stiff tendon": (TENDON.format(' stiffness="9"') + "</tendon>", "FL_thigh_joint with FL_calf_joint (<tendon>)"),
    "driven tendon": (
        TENDON.format("") + '</tendon><actuator><motor tendon="belt"/></actuator>',
        "FL_thigh_joint with FL_calf_joint (<tendon>)",
    ),
}


@pytest.mark.parametrize(("tail", "named"), COUPLED.values(), ids=COUPLED)
def test_leg_joints_that_mjcf_couples_are_refused(refusal, tail, named):
    message = refusal(cases.mjcf(cases.FREE, tail=tail))
    assert message.startswith(f"leg joints are coupled, but equipoise moves each independently: {named}; ")


@pytest.mark.parametrize(
    "tail",
    [
        '<equality><joint joint1="FL_calf_joint" joint2="FL_thigh_joint" active="false"/></equality>',
        TENDON.format("") + "</tendon>",
        '<equality><weld body1="trunk"/></equality>',
    ],
    ids=["inactive", "tendon that only measures", "trunk held up"],
)
def test_couplings_of_other_joints_are_accepted(load, tail):
    robot = load(cases.mjcf(cases.FREE, tail=tail))
    assert len(robot.joint_names) == 12
    assert not any("coupl" in text for _, text in findings(robot, "note"))


# --- what is missing or too much


def test_a_trunk_that_is_merged_into_the_world_is_recognised(refusal):
    message = refusal(cases.mjcf('<geom type="box" size="0.2 0.1 0.05" mass="6"/>{}'))
    assert message.startswith(
        "has no trunk: its legs (FL_hip, FR_hip, RL_hip, RR_hip) are attached to the world, as MuJoCo writes"
    )
    assert "into one <body> with a <freejoint/> and an <inertial>, or give the URDF" in message


def test_a_trunk_without_a_freejoint_or_on_other_joints_is_refused(refusal):
    assert refusal(cases.mjcf()) == "has no floating base: give the trunk's body a <freejoint/>"
    door = '<body name="door"><joint name="hinge"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>'
    static = f'{door}<body name="trunk">{{}}</body>'
    assert refusal(cases.mjcf(static)) == "has no floating base: give the trunk's body a <freejoint/>"
    joints = '<joint name="x" type="slide" axis="1 0 0"/><joint name="yaw" axis="0 0 1"/>'
    assert refusal(cases.mjcf(f'<body name="trunk">{joints}{{}}</body>')) == (
        "has no floating base: replace the joints of trunk (x, yaw) by one <freejoint/>"
    )


def without_feet(extra=""):
    return re.sub(r'<joint name="\w\w_foot_fixed".*?</collision></link>', "", cases.urdf()).replace(
        "</robot>", f"{extra}</robot>"
    )


def rotor(leg, where):
    return (
        f'<link name="{leg}_rotor"/><joint name="{leg}_rotor_joint" type="fixed"><origin xyz="{where}"/>'
        f'<parent link="{leg}_calf"/><child link="{leg}_rotor"/></joint>'
    )


@pytest.mark.parametrize("where", [None, "0 0.05 0", "0.02 0.1 0.01"])
def test_a_leg_without_a_foot_is_refused_with_what_to_add(refusal, where):
    extra = "" if where is None else "".join(rotor(leg, where) for leg in LEG_NAMES)
    message = refusal(without_feet(extra))
    assert message.startswith("nothing marks the foot of leg FL: below joint 'FL_calf_joint' there is neither a")
    assert "add a fixed link at the foot's centre in a copy of the file" in message


@pytest.mark.parametrize("frame", ["calf", "calf_joint", "rotor"])
def test_a_described_foot_on_the_knee_is_refused(refusal, frame):
    described = RobotDescription(foot_frames={leg: f"{leg}_{frame}" for leg in LEG_NAMES})
    text = without_feet("".join(rotor(leg, "0 0.05 0") for leg in LEG_NAMES))
    message = refusal(text, described, SettingsError)
    assert message.startswith(f"foot frame 'FL_{frame}' of leg FL sits on the knee's axis (joint 'FL_calf_joint')")
    assert "add a fixed link at the foot's centre" in message


def test_a_site_marks_a_foot(load):
    text = re.sub(r'<geom name="(\w\w_foot)"[^>]*>', r'<site name="\1" pos="0 0 -0.2"/>', cases.mjcf(cases.FREE))
    assert {leg.foot_in_body for leg in load(text).legs.values()} == {(0.0, 0.0, -0.2)}


@pytest.mark.parametrize("kind", ["revolute", "continuous"])
@pytest.mark.parametrize("axis", ["0 0 0", "0.0 0 -0", "1e-9 0 0"])
def test_an_axis_without_direction_is_refused(refusal, kind, axis):
    text = re.sub(r'(_calf_joint" type=)"revolute"(.*?<axis xyz=)"[^"]*"', rf'\1"{kind}"\2"{axis}"', cases.urdf())
    message = refusal(text)
    assert message.startswith(f"joint 'FL_calf_joint': axis {axis} has no direction; ")
    mjcf = cases.mjcf(cases.FREE).replace('_calf_joint" axis="0 1 0"', f'_calf_joint" axis="{axis}"')
    assert refusal(mjcf).startswith(f"joint 'FL_calf_joint': axis {axis} has no direction; ")


@pytest.mark.parametrize("axis", ["0 nan 0", "0 inf 0"])
def test_an_axis_that_is_not_finite_is_refused(refusal, axis):
    text = re.sub(r'(_calf_joint".*?<axis xyz=)"[^"]*"', rf'\1"{axis}"', cases.urdf())
    assert refusal(text) == f"<axis> of 'FL_calf_joint' has xyz={axis!r}; every number must be finite"


def test_an_axis_may_have_any_length(load):
    text = cases.urdf().replace('<axis xyz="0 1 0"/>', '<axis xyz="0 7e-3 0"/>')
    np.testing.assert_allclose(composite(load(text)).com, composite(load(cases.urdf())).com, atol=1e-9)
    mjcf = cases.mjcf(cases.FREE)
    moved = np.tile([0.1, 0.5, -1.2], 4)
    feet = [foot_positions(load(each), moved) for each in (mjcf, mjcf.replace('axis="0 1 0"', 'axis="0 3 0"'))]
    np.testing.assert_allclose(*feet, atol=1e-12)


def virtual_chain(mass="0"):
    links = ["world", "px", "py", "pz", "rz", "ry", "trunk"]
    kinds = ["prismatic"] * 3 + ["continuous"] * 3
    axes = ["1 0 0", "0 1 0", "0 0 1", "0 0 1", "0 1 0", "1 0 0"]
    body = cases.inertial("0 0 0", mass, (1e-6,) * 3) if float(mass) else ""
    parts = [f'<link name="{link}">{body if link != "world" else ""}</link>' for link in links[:-1]]
    for place, (kind, axis) in enumerate(zip(kinds, axes, strict=True)):
        parts.append(
            f'<joint name="base_{links[place + 1]}" type="{kind}"><parent link="{links[place]}"/>'
            f'<child link="{links[place + 1]}"/><axis xyz="{axis}"/>'
            '<limit lower="-9" upper="9" effort="0" velocity="0"/></joint>'
        )
    return "".join(parts)


@pytest.mark.parametrize("mass", ["0", "1e-6", "0.001", "0.05"])
def test_a_virtual_chain_above_the_trunk_is_dropped(load, mass):
    robot = load(cases.urdf(extra=virtual_chain(mass)))
    assert (robot.base_link, robot.locked_joints) == ("trunk", {})
    assert robot.mass == pytest.approx(12)
    np.testing.assert_allclose(composite(robot).com * 1000, cases.COM_MM, atol=0.06)
    assert "links above the base 'trunk' are ignored: world, px, py, pz, rz, ry" in [
        t for _, t in findings(robot, "note")
    ]


def test_a_second_hinge_in_a_body_is_named(refusal):
    backlash = '<joint name="{leg}_hip_backlash" axis="1 0 0" range="-0.01 0.01"/>'
    assert refusal(cases.mjcf(cases.FREE, backlash)) == (
        "body 'FL_hip' of a leg has several joints, FL_hip_joint and FL_hip_backlash; legs need one joint per body: remove "
        "FL_hip_backlash in a copy of the file"
    )


def test_of_two_hinges_in_a_body_the_one_that_moves_is_kept(refusal):
    backlash = r'<joint name="\1_hip_backlash" axis="1 0 0" range="-0.01 0.01"/>'
    text = re.sub(r'(?=<joint name="(\w\w)_hip_joint")', backlash, cases.mjcf(cases.FREE))
    assert "FL_hip_joint and FL_hip_backlash; legs need one joint per body: remove FL_hip_backlash" in refusal(text)


def with_backlash(part):
    """Return a URDF with a massless link between each link of a part and its joint, on a backlash joint."""
    link = rf"\1_{part}_play"
    return re.sub(
        rf'<joint name="(\w\w)_{part}_joint"(.*?)<parent link="(\w+)"/><child link="\w+"/>(.*?)</joint>',
        rf'<link name="{link}"/><joint name="\1_{part}_joint"\2<parent link="\3"/><child link="{link}"/>\4</joint>'
        rf'<joint name="\1_{part}_backlash" type="revolute"><parent link="{link}"/><child link="\1_{part}"/>'
        '<axis xyz="0 1 0"/><limit lower="-0.01" upper="0.01" effort="1" velocity="1"/></joint>',
        cases.urdf(),
    )


def test_a_backlash_joint_is_named(refusal):
    message = refusal(with_backlash("thigh"))
    assert "4 of 4 joints (FL_hip_joint, FL_thigh_joint, FL_thigh_backlash, FL_calf_joint)" in message
    assert "; FL_thigh_backlash, FR_thigh_backlash, " in message
    assert message.endswith(" are hardly moving: make them fixed in a copy of the file if they do not move")


def test_two_leg_joints_about_one_axis_are_refused(refusal):
    text = cases.with_limits(with_backlash("thigh"), "hip", 'lower="0" upper="0"')
    assert refusal(text) == (
        "leg joints 'FL_thigh_joint' and 'FL_thigh_backlash' turn about the same axis; make the one that is not driven fixed "
        "in a copy of the file"
    )


@pytest.mark.parametrize(("kind", "named"), [("floating", "floating"), ("planar", "of more than one axis (planar)")])
def test_toes_that_do_not_turn_about_one_axis_are_named(refusal, kind, named):
    message = refusal(cases.urdf().replace('_foot_fixed" type="fixed"', f'_foot_fixed" type="{kind}"'))
    assert "limbs found: 4 of 4 joints (FL_hip_joint, FL_thigh_joint, FL_calf_joint, FL_foot_fixed)" in message
    assert message.endswith(
        f"; FL_foot_fixed, FR_foot_fixed, RL_foot_fixed, RR_foot_fixed are {named}: make them fixed in a copy of the file if "
        "they do not move"
    )


# --- axes that meet


@pytest.mark.parametrize("offset", ["0 0 0", "0 1e-18 0", "1e-4 0 0", "0 1e-4 0", "0.05 0 0"])
def test_hip_axes_may_meet(load, offset):
    robot = load(cases.urdf(offset))
    expected = pin.computeTotalMass(robot.pinocchio)
    assert (robot.mass, expected) == (pytest.approx(12), pytest.approx(12))
    moments = np.diag(composite(robot).inertia)
    if offset != "0.05 0 0":
        np.testing.assert_allclose(moments, (0.1094, 0.3494, 0.3371), rtol=3e-3)
