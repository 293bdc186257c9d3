"""Audit of correct models, and of models with one defect."""

import json
import re
import subprocess
import sys
import warnings
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from robots import load_text, quadruped_mjcf, quadruped_urdf

from equipoise.errors import MissingDependencyError, ModelWarning
from equipoise.robot.audit import audit
from equipoise.robot.catalog import CATALOG, load_robot
from equipoise.robot.description import LEG_NAMES, RobotDescription
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.stance import nominal_stance

# What is wrong with the robots of the catalogue, by hand from their files: severity and links.
KNOWN_WRONG = {
    "anymal_c": {
        (
            "warning",
            "depth_camera_front_camera, depth_camera_rear_camera, depth_camera_left_camera, depth_camera_right_camera",
        ),
        ("warning", "hatch"),
    },
    "hyq": {("warning", "trunk_imu")},
    "solo8": {("warning", "")},  # placeholders of 1000 in place of limits
    "solo12": {("warning", "")},
    "mini_cheetah": {
        ("warning", ""),  # no limits of torque and speed
        ("error", "thigh_fr, thigh_fl, thigh_hr, thigh_hl"),
        ("warning", "abduct_fl, abduct_fr, abduct_hl, abduct_hr"),
        ("warning", "thigh_fl, thigh_fr, thigh_hl, thigh_hr"),
    },
}


def load_quietly(name_or_path, description=None):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        return load_robot(str(name_or_path), description)


@pytest.fixture
def edited_a1(a1_urdf, tmp_path):
    """Return the built-in A1 with other inertials: by link, attributes of elements below <inertial>."""

    def edited(changes, description=None, extra=""):
        root = ET.fromstring(a1_urdf.replace("</robot>", extra + "</robot>"))
        for link, elements in changes.items():
            for tag, values in elements.items():
                for key, value in values.items():
                    root.find(f"link[@name='{link}']/inertial/{tag}").set(key, value)
        path = tmp_path / "edited.urdf"
        path.write_text(ET.tostring(root, encoding="unicode"), encoding="utf-8")
        return load_quietly(path, description)

    return edited


def diagonal_inertia(x, y, z):
    return {"ixx": str(x), "iyy": str(y), "izz": str(z), "ixy": "0", "ixz": "0", "iyz": "0"}


def suspicions(report):
    return [finding for finding in report.findings if finding.severity != "note"]


def the_finding(report, word):
    found = [finding for finding in report.findings if word in finding.text]
    assert len(found) == 1, [str(finding) for finding in report.findings]
    return found[0]


def test_the_built_in_a1_has_no_findings(a1):
    assert [str(finding) for finding in audit(a1).findings] == [
        "note: y of the CoM in the base frame (positive: left) is +0.8 mm for the whole robot "
        "and +2.2 mm for the base (trunk)"
    ]


def test_bodies_are_the_base_and_every_leg_link_with_what_is_fixed_to_it(a1):
    report = audit(a1)
    assert [body.name for body in report.bodies] == [
        "trunk", "FL_hip", "FL_thigh", "FL_calf", "FR_hip", "FR_thigh", "FR_calf",
        "RL_hip", "RL_thigh", "RL_calf", "RR_hip", "RR_thigh", "RR_calf",
    ]  # fmt: skip
    assert sum(body.mass for body in report.bodies) == pytest.approx(report.mass)
    calf = report.bodies[3]
    assert calf.mass == pytest.approx(0.166 + 0.06)
    assert calf.com_in_link[2] == pytest.approx((0.166 * -0.107388 + 0.06 * -0.2) / 0.226)
    assert calf.radius_of_gyration == pytest.approx(np.sqrt(calf.principal_moments.sum() / 2 / calf.mass))
    assert calf.extent == pytest.approx(2 * np.linalg.norm(calf.com_in_link))
    assert report.bodies[2].extent == pytest.approx(0.2)  # from hip pitch to knee
    assert report.bodies[0].extent == pytest.approx(2 * np.hypot(0.1805, 0.047))


def test_the_composite_is_at_the_nominal_stance_and_its_ratio_is_stated(a1):
    report = audit(a1)
    truth = composite_parameters(a1, nominal_stance(a1).joint_position)
    np.testing.assert_array_equal(report.composite.inertia, truth.inertia)
    ratio = np.diag(truth.inertia) / np.diag(report.base.inertia)
    assert report.ratio_composite_over_base == pytest.approx(ratio)
    assert report.ratio_message == "the composite's Ixx, Iyy, Izz are 9.6, 7.0 and 6.3 x the base's (link 'trunk')"


def test_json_form_has_stable_keys_and_plain_values(a1):
    report = json.loads(json.dumps(audit(a1).to_dict(), allow_nan=False))
    assert list(report) == [
        "robot", "mass", "base_link", "composite", "base", "stance_effective", "ratio_composite_over_base", "bodies",
        "findings", "imu", "stance",
    ]  # fmt: skip
    for body in ("composite", "base", "stance_effective"):
        assert list(report[body]) == ["mass", "com_in_base", "inertia"]
    assert list(report["bodies"][0]) == [
        "name", "mass", "com_in_link", "principal_moments", "extent", "radius_of_gyration",
    ]  # fmt: skip
    assert list(report["findings"][0]) == ["severity", "body", "text"]
    assert list(report["stance"]) == ["joint_position", "hip_height"]
    assert list(report["stance"]["joint_position"]) == list(a1.joint_names)


def test_a_thigh_heavier_on_one_side_is_named_with_both_masses(edited_a1):
    finding = the_finding(audit(edited_a1({"FL_thigh": {"mass": {"value": "1.2"}}})), "mirror")
    assert (finding.severity, finding.body) == ("warning", "FL_thigh, FR_thigh")
    assert finding.text == "left and right are not mirror images: masses 1.2 and 1.013 kg"


def test_a_com_copied_from_left_to_right_without_its_minus_is_recognised(edited_a1):
    robot = edited_a1({"RR_thigh": {"origin": {"xyz": "-0.003237 -0.022327 -0.027326"}}})
    finding = the_finding(audit(robot), "mirror")
    assert (finding.severity, finding.body) == ("warning", "RL_thigh, RR_thigh")
    assert finding.text.startswith(
        "left and right are not mirror images: CoMs 44.7 mm from being mirrored "
        "(both at y = -22.3 mm from their joints; is a minus missing?)"
    )


def test_a_product_of_inertia_without_its_sign_is_a_difference_of_the_sides(edited_a1):
    robot = edited_a1({"FL_hip": {"inertia": {"ixy": "0.0001"}}, "FR_hip": {"inertia": {"ixy": "0.0001"}}})
    finding = the_finding(audit(robot), "mirror")
    assert finding.body == "FL_hip, FR_hip"
    assert finding.text.startswith("left and right are not mirror images: inertias ")


def test_small_differences_of_the_sides_are_notes_and_smaller_ones_nothing(edited_a1):
    robot = edited_a1({"FL_thigh": {"mass": {"value": "1.033"}}, "RL_thigh": {"mass": {"value": "1.018"}}})
    finding = the_finding(audit(robot), "mirror")
    assert (finding.severity, finding.body) == ("note", "FL_thigh, FR_thigh")


def test_front_and_rear_legs_may_differ(edited_a1):
    robot = edited_a1({f"{leg}_thigh": {"mass": {"value": "2"}} for leg in ("RL", "RR")})
    assert suspicions(audit(robot)) == []


def test_at_an_unmirrored_stance_only_masses_and_moments_are_compared(a1, edited_a1):
    stance = dict(zip(a1.joint_names, nominal_stance(a1).joint_position.tolist(), strict=True))
    stance["FL_hip_joint"] += 0.2
    changes = {"FL_hip": {"inertia": {"ixx": "0.001"}}}
    report = audit(edited_a1(changes, RobotDescription(stance=stance)))
    (finding,) = suspicions(report)
    assert finding.body == "FL_hip, FR_hip"
    assert "principal moments" in finding.text
    assert "the FL and FR legs are" in the_finding(report, "only masses and principal moments").text


def test_an_inertia_that_breaks_the_triangle_inequality_is_an_error_of_its_link(edited_a1):
    report = audit(edited_a1({"RR_calf": {"inertia": diagonal_inertia(0.001, 0.001, 0.003)}}))
    finding = the_finding(report, "no body can have")
    assert (finding.severity, finding.body) == ("error", "RR_calf")
    assert "(principal moments 0.001, 0.001, 0.003 kg m2)" in finding.text
    assert report.findings[0] is finding


def test_the_same_defect_of_several_links_is_reported_once(edited_a1):
    wrong = {"inertia": diagonal_inertia(0.001, 0.001, 0.003)}
    report = audit(edited_a1({f"{leg}_calf": wrong for leg in LEG_NAMES}))
    assert [finding.body for finding in suspicions(report)] == ["FR_calf, FL_calf, RR_calf, RL_calf"]


def test_an_impossible_inertia_of_a_part_that_hardly_matters_is_a_warning(edited_a1):
    report = audit(edited_a1({"imu_link": {"inertia": diagonal_inertia(1e-8, 1e-8, 3e-8)}}))
    assert [(finding.severity, finding.body) for finding in suspicions(report)] == [("warning", "imu_link")]


def test_an_identity_inertia_of_the_trunk_is_a_placeholder(edited_a1):
    (finding,) = suspicions(audit(edited_a1({"trunk": {"inertia": diagonal_inertia(1, 1, 1)}})))
    assert (finding.severity, finding.body) == ("warning", "trunk")
    assert finding.text == (
        "an inertia that looks like a placeholder: Ixx = Iyy = Izz = 1 kg m2 and 4.713 kg with a radius of gyration of "
        "564 mm on a body that is about 373 mm long"
    )


@pytest.mark.parametrize("moment", [0.1, 0.01, 0.001, 1e-4, 5e-3])
@pytest.mark.parametrize("part", ["hip", "thigh", "calf"])
def test_a_round_number_times_identity_is_a_placeholder_on_every_leg_link(edited_a1, part, moment):
    changes = {f"{leg}_{part}": {"inertia": diagonal_inertia(moment, moment, moment)} for leg in LEG_NAMES}
    finding = the_finding(audit(edited_a1(changes)), "placeholder")
    assert (finding.severity, finding.body) == ("warning", f"FL_{part}, FR_{part}, RL_{part}, RR_{part}")


def test_a_placeholder_of_a_light_link_is_a_note_with_its_share(edited_a1):
    report = audit(edited_a1({"imu_link": {"inertia": diagonal_inertia(1e-4, 1e-4, 1e-4)}}))
    finding = the_finding(report, "placeholder")
    assert (finding.severity, finding.body) == ("note", "imu_link")
    assert finding.text.endswith(" on a body that is about 373 mm long; it is 0.2% of that body's inertia")


def test_an_identity_inertia_hidden_in_a_light_part_of_the_trunk_is_found(edited_a1):
    finding = the_finding(audit(edited_a1({"imu_link": {"inertia": diagonal_inertia(1, 1, 1)}})), "placeholder")
    assert (finding.severity, finding.body) == ("warning", "imu_link")


def test_a_small_ball_of_a_foot_may_have_a_round_inertia(edited_a1):
    changes = {f"{leg}_foot": {"inertia": diagonal_inertia(1e-5, 1e-5, 1e-5)} for leg in LEG_NAMES}
    assert suspicions(audit(edited_a1(changes))) == []


def test_a_mass_denser_than_steel_is_a_warning(edited_a1):
    (finding,) = suspicions(audit(edited_a1({"trunk": {"inertia": diagonal_inertia(1.6e-5, 5.6e-5, 6.4e-5)}})))
    assert (finding.severity, finding.body) == ("warning", "trunk")
    assert "a solid steel ball of that mass has 40.5 mm" in finding.text


def test_a_placeholder_on_a_locked_arm_is_compared_with_the_base(edited_a1):
    arm = """
      <link name="arm"><inertial><mass value="0.5"/>
        <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <joint name="arm_joint" type="revolute"><origin xyz="0 0 0.1"/><parent link="trunk"/><child link="arm"/>
        <axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>"""
    report = audit(edited_a1({}, extra=arm))
    (finding,) = suspicions(report)
    assert (finding.severity, finding.body) == ("warning", "arm")
    assert report.base.mass == pytest.approx(4.714 + 0.5)


def test_a_robot_without_a_stance_is_audited_with_the_reason(edited_a1):
    knees = {f"{leg}_calf_joint": (-2.69, -2.6) for leg in LEG_NAMES}
    changes = {"FL_thigh": {"mass": {"value": "1.2"}}}
    report = audit(edited_a1(changes, RobotDescription(joint_limits=knees)))
    assert (report.stance, report.composite, report.stance_effective) == (None, None, None)
    assert (report.ratio_composite_over_base, report.ratio_message) == (None, None)
    finding = the_finding(report, "no nominal stance")
    assert (finding.severity, finding.body) == ("error", "")
    assert "give one under [stance] in a robot configuration" in finding.text
    assert the_finding(report, "mirror").body == "FL_thigh, FR_thigh"
    assert json.loads(json.dumps(report.to_dict(), allow_nan=False))["composite"] is None


def test_a_base_with_hardly_any_mass_is_an_error(tmp_path):
    (finding,) = suspicions(audit(load_text(tmp_path, quadruped_urdf(trunk_mass=0.001))))
    assert (finding.severity, finding.body) == ("error", "trunk")
    assert finding.text == (
        "hardly any mass, 0.001 kg of the robot's 7.601 kg, although it holds motors and battery: give its link "
        "an <inertial> with mass, centre of mass and inertia"
    )


def test_the_mass_of_a_base_may_be_in_a_link_fixed_to_it(tmp_path):
    text = quadruped_urdf(
        trunk_mass=0.0,
        extra=f"""
      <link name="shell"><inertial><mass value="6"/><inertia {
            " ".join(f'{key}="{value}"' for key, value in diagonal_inertia(0.02, 0.06, 0.065).items())
        }/></inertial></link>
      <joint name="shell_joint" type="fixed"><parent link="trunk"/><child link="shell"/></joint>""",
    )
    assert suspicions(audit(load_text(tmp_path, text))) == []


LIMIT = 'effort="30" velocity="20"'


def test_joints_without_torque_or_speed_limits_are_named(tmp_path):
    text = quadruped_urdf().replace(LIMIT, 'effort="0" velocity="20"', 1).replace(LIMIT, 'effort="30"', 1)
    assert [str(finding) for finding in suspicions(audit(load_text(tmp_path, text)))] == [
        "warning: no plausible torque limit of FL_0: the guard cannot detect excessive torques; give it as effort [Nm] of "
        "their <limit>",
        "warning: no plausible speed limit of FL_1: the guard cannot detect excessive speeds or jumps of targets; give it as "
        "velocity [rad/s] of their <limit>",
    ]


@pytest.mark.parametrize("limit", ["", 'effort="1000" velocity="1000"'], ids=["none", "placeholders"])
def test_a_file_without_limits_has_one_finding_per_kind(tmp_path, limit):
    report = audit(load_text(tmp_path, quadruped_urdf().replace(LIMIT, limit)))
    torque, speed = (finding.text for finding in suspicions(report))
    assert torque.startswith("no plausible torque limit of any leg joint: ")
    assert speed.startswith("no plausible speed limit of any leg joint: ")


def test_mjcf_needs_torque_limits_but_no_speed_limits(tmp_path):
    text = quadruped_mjcf()
    (finding,) = suspicions(audit(load_text(tmp_path, text)))
    assert finding.text == (
        "no plausible torque limit of any leg joint: the guard cannot detect excessive torques; give it as forcerange "
        "[Nm] of their actuators"
    )
    limited = re.sub(r'(<joint name="[FR][LR]_. *")', r'\1 actuatorfrcrange="-30 30"', text)
    assert suspicions(audit(load_text(tmp_path, limited))) == []


def mjcf_quadruped(fl_thigh_inertia):
    """Return a quadruped of two joints per leg, with a camera fixed to its trunk."""
    legs = ""
    for name, x, y in (("FL", 0.2, 0.1), ("FR", 0.2, -0.1), ("RL", -0.2, 0.1), ("RR", -0.2, -0.1)):
        inertia = fl_thigh_inertia if name == "FL" else "0.002 0.002 0.0004"
        legs += f"""
        <body name="{name}_thigh" pos="{x} {y} 0"><joint name="{name}_hfe" axis="0 1 0" range="-2 2"/>
          <inertial pos="0 0 -0.1" mass="0.6" diaginertia="{inertia}"/>
          <body name="{name}_shank" pos="0 0 -0.2"><joint name="{name}_kfe" axis="0 1 0" range="-2.7 -0.5"/>
            <inertial pos="0 0 -0.1" mass="0.2" diaginertia="0.0007 0.0007 0.00002"/>
            <geom type="sphere" size="0.02" pos="0 0 -0.2" mass="0.01"/></body></body>"""
    return f"""<mujoco><compiler angle="radian"/><worldbody><body name="trunk"><freejoint/>
      <inertial pos="0 0 0" mass="6" diaginertia="0.03 0.1 0.11"/>
      <body name="camera" pos="0.2 0 0"><inertial pos="0 0 0" mass="0.1" diaginertia="0.00001 0.00001 0.0001"/></body>
      {legs}</body></worldbody></mujoco>"""


def test_impossible_inertias_of_an_mjcf_file_are_found_on_moving_and_on_fixed_bodies(tmp_path):
    path = tmp_path / "robot.xml"
    path.write_text(mjcf_quadruped("0.002 0.002 0.005"), encoding="utf-8")
    report = audit(load_quietly(path))
    impossible = [finding for finding in report.findings if "no body can have" in finding.text]
    assert [(finding.severity, finding.body) for finding in impossible] == [
        ("error", "FL_thigh"),
        ("warning", "camera"),
    ]
    assert "a principal moment, 0.005 kg m2, exceeds the sum of the others, 0.004" in impossible[0].text


@pytest.mark.parametrize("name", CATALOG)
def test_catalogue_robots_have_only_correct_findings(name):
    try:
        robot = load_quietly(name)
    except MissingDependencyError as error:
        pytest.skip(str(error))
    report = audit(robot)
    assert {(finding.severity, finding.body) for finding in suspicions(report)} == KNOWN_WRONG.get(name, set())
    assert report.composite.mass == pytest.approx(sum(body.mass for body in report.bodies))
    assert min(report.ratio_composite_over_base) > 1
    json.dumps(report.to_dict(), allow_nan=False)


def test_a_sideways_com_and_hips_off_the_middle_are_noted(a1_urdf, tmp_path):
    text = a1_urdf.replace("1805 0.047 0", "1805 0.057 0").replace("1805 -0.047 0", "1805 -0.037 0")
    path = tmp_path / "shifted.urdf"
    path.write_text(text, encoding="utf-8")
    report = audit(load_quietly(path))
    assert suspicions(report) == []  # the legs are mirror images still, about their own middle
    assert the_finding(report, "hips' middle").text == "the hips' middle is at y = +10.0 mm in the base frame"
    y = report.composite.com[1] * 1000
    assert y == pytest.approx(0.83 + 10 * 7.744 / 12.458, abs=0.02)  # the legs weigh 7.744 kg
    assert f"is {y:+.1f} mm for the whole robot" in the_finding(report, "y of the CoM").text


def test_the_audit_runs_without_a_simulator():
    code = (
        "import sys; sys.modules['mujoco'] = None\n"
        "from equipoise.robot.audit import audit\n"
        "from equipoise.robot.catalog import load_robot\n"
        "audit(load_robot('unitree_a1'))"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
