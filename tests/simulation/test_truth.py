"""The simulated robot's truth and the robot model: two engines without common code, the same robot.

Some robots are compared with what MuJoCo reads from the user's own file too, for a cleaned file is read by both.
"""

import os
import re
import warnings
from pathlib import Path

import mujoco
import numpy as np
import pytest
from robots import load_text, mjcf_arm_on_a_mount, quadruped_mjcf, quadruped_urdf, urdf_arm_on_a_mount

from equipoise.errors import ModelWarning
from equipoise.robot.catalog import CATALOG, load_robot
from equipoise.robot.description import RobotDescription
from equipoise.robot.inertial import InertialParameters, base_parameters, composite_parameters, nominal_inertia
from equipoise.robot.links import link_names
from equipoise.robot.stance import nominal_stance
from equipoise.simulation.drawn_errors import DrawnErrors
from equipoise.simulation.effects import IDEAL
from equipoise.simulation.mujoco_model import build_simulated_robot
from equipoise.simulation.mujoco_truth import link_truth, simulated_truth
from equipoise.simulation.payload import Payload

# MuJoCo 3 stops diagonalising a link's inertia at 1e-5 of it.
TOLERANCE = 1e-9 if int(mujoco.__version__.split(".")[0]) >= 4 else 1e-6
PAYLOAD = Payload(
    InertialParameters(
        1.5, np.array([0.1, -0.03, 0.08]), np.array([[0.01, 1e-3, 2e-4], [1e-3, 0.02, -5e-4], [2e-4, -5e-4, 0.025]])
    )
)
BENT = RobotDescription(locked_joints={"arm_0": 0.5, "arm_1": -0.7})
RADIAN = '<compiler angle="radian"/>'


def built(robot, payload=None):
    errors = DrawnErrors.draw(IDEAL, len(robot.joint_names), 0)
    return build_simulated_robot(robot, nominal_stance(robot), errors, payload, 1e-3)


def assert_same_body(found, expected):
    assert found.mass == pytest.approx(expected.mass, abs=TOLERANCE)
    np.testing.assert_allclose(found.com, expected.com, atol=TOLERANCE)
    np.testing.assert_allclose(found.inertia, expected.inertia, atol=TOLERANCE)


def assert_engines_agree(robot, payload=None):
    simulated = built(robot, payload)
    low, high = np.maximum(robot.lower_limit, -1), np.minimum(robot.upper_limit, 1)
    anywhere = np.random.default_rng(1).uniform(np.minimum(low, high), high)
    for position in (nominal_stance(robot).joint_position, anywhere):
        truth, nominal = simulated_truth(robot, simulated, position), nominal_inertia(robot, position)
        for body in ("composite", "base", "stance_effective"):
            expected = getattr(nominal, body)
            assert_same_body(getattr(truth, body), expected if payload is None else expected + payload.parameters)


SAME_IN_BOTH = {
    "URDF": (quadruped_urdf(), None),
    "URDF, two joints a leg": (quadruped_urdf(joints_per_leg=2), None),
    "URDF, arm held bent": (quadruped_urdf(arm_joints=4), BENT),
    "URDF, continuous arm held bent": (quadruped_urdf(arm_joints=4, arm_type="continuous"), BENT),
    "URDF, sliding arm held out": (quadruped_urdf(arm_joints=4, arm_type="prismatic"), BENT),
    "URDF, spine held bent": (quadruped_urdf(spine=True), RobotDescription(locked_joints={"spine": 0.2})),
    "URDF, world link": (quadruped_urdf(world=True), None),
    "URDF, turned inertial": (
        quadruped_urdf().replace('<origin xyz="-0.004 0.02 -0.03"/>', '<origin xyz="0 0 -0.03" rpy="0.3 0.4 0.5"/>'),
        None,
    ),
    "URDF, link of a rounded plate": (
        re.sub('ixx="0.0055" iyy="0.0051" izz="0.0014"', 'ixx="0.002" iyy="0.003" izz="0.005001"', quadruped_urdf()),
        None,
    ),
    "MJCF": (quadruped_mjcf(), None),
    "MJCF, arm held bent": (quadruped_mjcf(arm=True), BENT),
    "MJCF, shapes tell masses": (quadruped_mjcf(explicit_inertia=False), None),
    "MJCF, nameless": (re.sub(r'<(body|joint) name="[^"]*"', r"<\1", quadruped_mjcf()), None),
}


@pytest.mark.parametrize("name", SAME_IN_BOTH)
def test_the_truth_without_errors_matches_the_model_file(tmp_path, name):
    assert_engines_agree(load_text(tmp_path, *SAME_IN_BOTH[name]))


@pytest.mark.parametrize("name", ["URDF", "URDF, arm held bent", "MJCF", "MJCF, arm held bent"])
def test_a_payload_is_in_the_truth_as_it_was_given(tmp_path, name):
    assert_engines_agree(load_text(tmp_path, *SAME_IN_BOTH[name]), PAYLOAD)


def test_a_point_mass_moves_the_truth_as_a_point_does(a1):
    payload = Payload.parse("2,0.1,0.02,0.1")
    assert_engines_agree(a1, Payload(InertialParameters(2.0, payload.parameters.com, 1e-9 * np.eye(3))))
    position = nominal_stance(a1).joint_position
    truth = simulated_truth(a1, built(a1, payload), position).composite
    nominal = composite_parameters(a1, position)
    arm, reduced = payload.parameters.com - nominal.com, 2 * a1.mass / (2 + a1.mass)
    np.testing.assert_allclose(truth.com - nominal.com, arm * 2 / (2 + a1.mass), atol=TOLERANCE)
    expected = nominal.inertia + reduced * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    np.testing.assert_allclose(truth.inertia, expected, atol=2 * TOLERANCE)


# --- every robot, in every engine


def of_the_catalogues(name, folder):
    return load_robot(name)


def in_the_catalogue_folder(path, folder):
    """A file that comes with the catalogue's robots and has no line in it."""
    root = CATALOG["b1"].find().parents[2]
    return load_robot(root / path)


ARM_HELD = {"to_upper": 0.7, "to_lower": -0.5, "to_left_finger": 0.02, "to_right_finger": 0.03}
EVERY_ROBOT = {
    **{name: (of_the_catalogues, name) for name in CATALOG},
    "b1-z1": (in_the_catalogue_folder, "b1_description/urdf/b1-z1.urdf"),
    "anymal-kinova": (in_the_catalogue_folder, "anymal_b_simple_description/robots/anymal-kinova.urdf"),
    "URDF, arm on a mount": (
        lambda text, folder: load_text(folder, text), quadruped_urdf(extra=urdf_arm_on_a_mount()),
    ),
    "URDF, arm on a mount, bent": (
        lambda text, folder: load_text(folder, text, RobotDescription(locked_joints=ARM_HELD)),
        quadruped_urdf(extra=urdf_arm_on_a_mount()),
    ),
    "URDF, arm without a mount": (lambda text, folder: load_text(folder, text), quadruped_urdf(arm_joints=4)),
    "MJCF, arm on a mount": (
        lambda text, folder: load_text(folder, text), quadruped_mjcf(trunk_extra=mjcf_arm_on_a_mount()),
    ),
    "MJCF, arm on a mount, bent": (
        lambda text, folder: load_text(folder, text, RobotDescription(locked_joints=ARM_HELD)),
        quadruped_mjcf(trunk_extra=mjcf_arm_on_a_mount()),
    ),
}  # fmt: skip


def truth_in_mujoco(robot, stance, errors):
    simulated = build_simulated_robot(robot, stance, errors, None, 1e-3)
    return simulated_truth(robot, simulated, stance.joint_position)


def truth_in_dart(robot, stance, errors):
    dart_model = pytest.importorskip("equipoise.lab.dart.dart_model", exc_type=ImportError)
    from equipoise.lab.dart.dart_truth import dart_truth  # noqa: PLC0415 - the engine may not be installed

    return dart_truth(robot, dart_model.build_dart_robot(robot, stance, errors, None), stance.joint_position)


def read_or_skip(name, folder):
    """A robot of EVERY_ROBOT."""
    read, what = EVERY_ROBOT[name]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        try:
            return read(what, folder)
        except ImportError as error:
            pytest.skip(str(error))


@pytest.mark.parametrize("engine", [truth_in_mujoco, truth_in_dart])
@pytest.mark.parametrize("name", EVERY_ROBOT)
def test_the_truth_of_an_unchanged_robot_is_the_model(tmp_path, name, engine):
    robot = read_or_skip(name, tmp_path)
    stance = nominal_stance(robot)
    truth = engine(robot, stance, DrawnErrors.draw(IDEAL, len(robot.joint_names), 0))
    nominal = nominal_inertia(robot, stance.joint_position)
    for body in ("composite", "base", "stance_effective"):
        found, expected = getattr(truth, body), getattr(nominal, body)
        assert found.mass == pytest.approx(expected.mass, rel=1e-6)
        assert np.abs(found.com - expected.com).max() < 1e-6 * robot.leg_length
        assert np.abs(found.inertia - expected.inertia).max() < 1e-6 * np.trace(expected.inertia)


@pytest.mark.parametrize("name", EVERY_ROBOT)
def test_links_of_an_unchanged_robot_are_the_models(tmp_path, name):
    robot = read_or_skip(name, tmp_path)
    truth, names = link_truth(robot, built(robot)), link_names(robot.full_pinocchio)
    assert len(truth) == sum(len(leg.joints) for leg in robot.legs.values())
    for leg in robot.legs.values():
        for joint in leg.joint_ids:
            inertia = robot.pinocchio.inertias[joint]
            found = truth[names[robot.full_pinocchio.getJointId(robot.pinocchio.names[joint])]]
            moment = [found[f"moment_{axis}"] for axis in "xyz"]
            assert found["mass"] == pytest.approx(inertia.mass, rel=1e-6)
            np.testing.assert_allclose(
                moment, inertia.mass * inertia.lever, atol=1e-6 * inertia.mass * robot.leg_length
            )


# --- what MuJoCo reads from the file as it is


def composite_in_mujoco(model, robot, joint_position):
    """Mass, CoM and inertia about it in the base frame, of an unmodified MuJoCo model; other joints at `held`."""
    data = mujoco.MjData(model)
    data.qpos[:7] = [0, 0, 0, 1, 0, 0, 0]
    for name, value in [*zip(robot.joint_names, joint_position, strict=True), *robot.locked_joints.items()]:
        data.qpos[model.jnt_qposadr[model.joint(name).id]] = value
    mujoco.mj_forward(model, data)
    base = int(model.jnt_bodyid[np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)[0]])
    own = model.body_rootid == base
    masses, coms, axes = model.body_mass[own], data.xipos[own], data.ximat[own].reshape(-1, 3, 3)
    com = masses @ coms / masses.sum()
    inertia = sum(
        R @ np.diag(moments) @ R.T + m * (r @ r * np.eye(3) - np.outer(r, r))
        for m, r, R, moments in zip(masses, coms - com, axes, model.body_inertia[own], strict=True)
    )
    return InertialParameters(float(masses.sum()), com, inertia)


def assert_reads_as_mujoco_does(robot, model, tolerance=TOLERANCE):
    position = nominal_stance(robot).joint_position
    found, expected = composite_parameters(robot, position), composite_in_mujoco(model, robot, position)
    assert found.mass == pytest.approx(expected.mass, abs=tolerance)
    np.testing.assert_allclose(found.com, expected.com, atol=tolerance)
    np.testing.assert_allclose(found.inertia, expected.inertia, atol=tolerance)
    limited = [model.joint(name).limited[0] for name in robot.joint_names]
    ranges = np.array([model.joint(name).range for name in robot.joint_names])
    np.testing.assert_allclose(robot.lower_limit[limited], ranges[limited, 0], atol=1e-9)
    np.testing.assert_allclose(robot.upper_limit[limited], ranges[limited, 1], atol=1e-9)


def arm_turned(orientation, head=RADIAN):
    return quadruped_mjcf(arm=True, head=head).replace('euler="0.3 -0.2 0.4"', orientation)


def in_degrees(text):
    """The ranges of a file of radians in degrees."""
    for radians, degrees in (("0.9", "50"), ("2.5", "140"), ("2.7", "150")):
        text = text.replace(f'range="-{radians} {radians}"', f'range="-{degrees} {degrees}"')
    return text


BOX = 'type="box" size="0.1 0.05 0.02"'
PARTS = f"""<body name="part" pos="0.1 0 0" {{0}}><inertial pos="0 0.1 0" mass="0.3" diaginertia="0.01 0.02 0.025" {{0}}/>
  <body name="plate" {{0}}><geom {BOX} pos="0 0.1 0.1" {{0}}/></body></body>"""
ORIENTATIONS = [
    'quat="2 1 0.3 0"', 'axisangle="1 2 3 0.7"', 'xyaxes="0 2 0.1 -1 0 1"', 'zaxis="0.1 0.2 -1"', 'zaxis="0 0 -1"',
    'euler="0.3 0.2 -1"',
]  # fmt: skip
SHAPES = [
    'type="sphere" size="0.05"', BOX, 'type="capsule" size="0.02 0.1"', 'type="cylinder" size="0.02 0.1"',
    'type="ellipsoid" size="0.1 0.05 0.03"', 'type="box" size="0.02" fromto="0 0 0 0.1 0.1 0.2"',
    'type="cylinder" size="0.02" fromto="0 0 0 0.1 0.1 0.2"', 'type="capsule" size="0.02" fromto="0 0 0 0.1 0.1 0.2"',
    'type="ellipsoid" size="0.02" fromto="0 0 0 0.1 0.1 0.2"', 'size="0.05" mass="0.3"', 'size="0.05" density="300"',
    'size="0.05" group="4"',
]  # fmt: skip
CLASSES = f"""{RADIAN}<default><geom density="200"/><joint damping="1"/>
  <default class="plate"><geom {BOX} pos="0.1 0 0" quat="1 0.5 0 0"/><default class="thin"><geom density="50"/></default>
  </default></default><default><geom friction="0.5"/></default>"""
FRAMES = """
  <frame pos="0.1 0.02 0" euler="0.3 0.2 0.1" childclass="plate">
    <body name="a"><geom/></body>
    <frame zaxis="1 1 1">
      <geom class="thin" xyaxes="0 1 0 -1 0 0"/>
      <geom class="main" type="capsule" size="0.01" fromto="0 0 0 0.1 0.1 0"/>
      <body name="b" pos="0 0 0.1" quat="1 2 3 4"><joint name="b" axis="1 1 0" pos="0.1 0 0"/><geom/></body>
    </frame>
  </frame>"""
AS_THEY_ARE = {
    "plain": quadruped_mjcf(),
    "degrees": in_degrees(quadruped_mjcf(arm=True, explicit_inertia=False, head="")),
    "lying elsewhere": quadruped_mjcf(attributes='pos="1 2 0.5" euler="0.3 0.2 1"'),
    "joints off their bodies": quadruped_mjcf().replace('name="FL_1"', 'name="FL_1" pos="0.01 0.02 0.03"'),
    "joint with a reference": quadruped_mjcf().replace('name="FL_1"', 'name="FL_1" ref="0.4" pos="0.02 0.01 0"'),
    "joint with a reference in degrees": in_degrees(quadruped_mjcf(head="")).replace('name="FL_1"', 'name="FL_1" ref="20"'),
    "long axes": quadruped_mjcf().replace('axis="0 1 0"', 'axis="0 2 0.1"'),
    "shapes overrule": quadruped_mjcf(
        head='<compiler angle="radian" inertiafromgeom="true"/>', trunk_extra='<geom size="0.1" pos="0 0 0.1"/>'
    ),
    "default classes": quadruped_mjcf(
        head=CLASSES,
        explicit_inertia=False,
        trunk_extra='<body name="a" childclass="plate"><geom/><geom class="thin"/><geom class="main" size="0.1"/></body>',
    ),
    "frames": quadruped_mjcf(head=CLASSES, trunk_extra=FRAMES),
    "two compilers": quadruped_mjcf(head='<compiler autolimits="true"/>' + RADIAN),
    "the world comes first": quadruped_mjcf(
        head=RADIAN + '<worldbody><geom type="plane" size="1 1 1"/><body name="box"><geom size="1"/></body></worldbody>'
    ),
    **{f"Euler {s}": arm_turned('euler="0.3 -0.2 0.4"', f'<compiler angle="radian" eulerseq="{s}"/>')
       for s in ("xyz", "XYZ", "zyx", "ZYX", "yzx", "xYz")},
    **{f"Euler {s} in degrees": in_degrees(arm_turned('euler="30 -20 40"', f'<compiler eulerseq="{s}"/>'))
       for s in ("xyz", "ZYX")},
    **{text: quadruped_mjcf(trunk_extra=PARTS.format(text)) for text in ORIENTATIONS},
    **{shape: quadruped_mjcf(trunk_extra=f'<body name="part" pos="0.1 0 0"><geom {shape}/></body>') for shape in SHAPES},
}  # fmt: skip


@pytest.mark.parametrize("name", AS_THEY_ARE)
def test_an_mjcf_file_is_read_as_mujoco_reads_it(tmp_path, name):
    robot = load_text(tmp_path, AS_THEY_ARE[name])
    assert_reads_as_mujoco_does(robot, mujoco.MjModel.from_xml_string(AS_THEY_ARE[name]))
    assert_engines_agree(robot)


ARMS = {
    "as it is": str,
    "with references": lambda text: text.replace('joint name="arm_', 'joint ref="0.3" name="arm_'),
    "sliding": lambda text: text.replace('joint name="arm_', 'joint type="slide" name="arm_'),
    "sliding with references": lambda text: text.replace('joint name="arm_', 'joint type="slide" ref="0.3" name="arm_'),
    "called as its bodies": lambda text: text.replace('"arm_link_1" pos="0 0.02 0.15">', '"arm_1"><geom size="0.1"/>'),
}


@pytest.mark.parametrize("change", ARMS.values(), ids=ARMS)
def test_a_locked_arm_agrees_with_mujoco(tmp_path, change):
    text = change(quadruped_mjcf(arm=True))
    robot = load_text(tmp_path, text, BENT)
    assert robot.locked_joints == BENT.locked_joints
    assert_reads_as_mujoco_does(robot, mujoco.MjModel.from_xml_string(text))
    assert_engines_agree(robot)


def test_a_locked_body_may_have_several_joints(tmp_path):
    second = '<joint name="arm_0" axis="0 1 0"/><joint name="arm_0b" axis="1 0 0"/>'
    text = quadruped_mjcf(arm=True).replace('<joint name="arm_0" axis="0 1 0"/>', second)
    robot = load_text(tmp_path, text)
    assert composite_parameters(robot, nominal_stance(robot).joint_position).mass == pytest.approx(14.4)
    assert_engines_agree(robot)


def test_a_robot_that_mujoco_wrote_out_is_the_one_that_it_read(tmp_path):
    copies = '<replicate count="3" offset="0.05 0 0" euler="0 0 0.4"><body name="copy"><geom size="0.03"/></body></replicate>'
    model = mujoco.MjModel.from_xml_string(quadruped_mjcf(trunk_extra=copies))
    mujoco.mj_saveLastXML(str(tmp_path / "written.xml"), model)
    robot = load_text(tmp_path, (tmp_path / "written.xml").read_text(encoding="utf-8"))
    assert_reads_as_mujoco_does(robot, model, 1e-5)  # MuJoCo writes six digits


def extra_models():
    """Model files of the user's, on EQUIPOISE_EXTRA_MODELS: files or folders, as on a PATH."""
    for entry in filter(None, os.environ.get("EQUIPOISE_EXTRA_MODELS", "").split(os.pathsep)):
        path = Path(entry)
        yield from sorted(p for p in path.iterdir() if p.suffix in (".xml", ".urdf")) if path.is_dir() else [path]


@pytest.mark.parametrize("path", list(extra_models()) or [None], ids=lambda path: path.name if path else "none")
def test_real_model_files_are_the_same_in_both_engines(path):
    if path is None:
        pytest.skip("EQUIPOISE_EXTRA_MODELS names no model files")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        robot = load_robot(path)
    assert base_parameters(robot).physical_defect() is None
    assert len(robot.legs["FL"].joints) in (2, 3)
    assert_engines_agree(robot)
