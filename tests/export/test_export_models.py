"""Edits of the user's own URDF or MJCF: the composite read from it, and its unchanged parts."""

import codecs
import dataclasses
import importlib
import os
import re
import sys
import types
from pathlib import Path

import numpy as np
import pytest
from exporting import (
    added_to,
    assert_same,
    composite_in_equipoise,
    composite_in_mujoco,
    composite_in_pinocchio,
    found,
    read_again,
)
from robots import load_text, quadruped_mjcf, quadruped_urdf

from equipoise import RobotDescription, export, load_robot
from equipoise.errors import MissingDependencyError, ModelError, NotEstimatedError, SettingsError
from equipoise.exports.formats import export_all
from equipoise.result.body import Body
from equipoise.result.statistics import NORMAL_95
from equipoise.robot.catalog import CATALOG
from equipoise.robot.inertial import InertialParameters, base_parameters

pytestmark = pytest.mark.filterwarnings("ignore::equipoise.errors.ModelWarning")
MODELS = Path(os.environ.get("EQUIPOISE_TEST_MODELS", "no such folder"))  # files of others, never in the repository
COMMENT = re.compile(rb"<!-- equipoise .*?-->\s*", re.DOTALL)


def written(robot, tmp_path, **options):
    """Export a robot that is heavier than its file; return the file, the export and the result."""
    result = found(robot)
    out = export(result, robot.source.format, **options)
    folder = tmp_path / "exported"
    folder.mkdir(exist_ok=True)
    return out.save(folder / robot.source.path.name), out, result


def assert_only_inertial_changed(before, after):
    """Assert that two files' bytes differ in one inertial only."""
    after = COMMENT.sub(b"", after, count=1)
    start = next(i for i, (a, b) in enumerate(zip(before, after, strict=False)) if a != b)
    end = next(i for i, (a, b) in enumerate(zip(reversed(before), reversed(after), strict=False)) if a != b)
    assert re.search(rb"<inertial\b(?:(?!</inertial>|<link|<body).)*$", before[:start], re.DOTALL)
    assert not re.search(rb"</inertial>|<link|<body", before[start : len(before) - end])


@pytest.mark.parametrize("name", CATALOG)
def test_every_robots_urdf_has_the_estimated_composite(name, tmp_path):
    try:
        robot = load_robot(name)
    except MissingDependencyError:
        pytest.skip(f"{name} is not installed")
    path, _, result = written(robot, tmp_path)
    assert_same(composite_in_equipoise(path, result, robot), result.composite.parameters())
    assert_only_inertial_changed(robot.source.path.read_bytes(), path.read_bytes())
    before = composite_in_pinocchio(robot.source.path, result, robot.locked_joints)
    assert_same(composite_in_pinocchio(path, result, robot.locked_joints), before + added_to(robot))
    if not robot.source.repairs:
        assert_same(composite_in_pinocchio(path, result, robot.locked_joints), result.composite.parameters())


FIXED = """<link name="{name}"><inertial><origin xyz="0.02 -0.01 0.03" rpy="0.1 0.2 -0.3"/><mass value="0.4"/>
  <inertia ixx="0.002" ixy="1e-4" ixz="0" iyy="0.003" iyz="-2e-4" izz="0.004"/></inertial></link>
<joint name="{name}_joint" type="fixed"><origin xyz="0.1 0 0.05" rpy="0 0.4 0.2"/><parent link="trunk"/>
  <child link="{name}"/></joint>"""
TRUNK = re.compile(r'<link name="trunk"><inertial>.*?</inertial></link>', re.DOTALL)
TRUNK_IS_FIXED = (
    '<link name="trunk"/><link name="shell"><inertial><mass value="6"/><origin xyz="0.01 0 0.02" rpy="0.3 -0.2 0.1"/>'
    '<inertia ixx="0.02" ixy="0" ixz="0" iyy="0.06" iyz="0" izz="0.065"/></inertial></link>'
    '<joint name="s" type="fixed"><origin xyz="0.01 0.02 0.03" rpy="0.5 0 0.1"/><parent link="trunk"/>'
    '<child link="shell"/></joint>'
    '<link name="tag"/><joint name="t" type="fixed"><parent link="trunk"/><child link="tag"/></joint>'
)
URDFS = {
    "plain": quadruped_urdf(),
    "arm": quadruped_urdf(arm_joints=2),
    "two joints a leg": quadruped_urdf(joints_per_leg=2),
    "links fixed to the base": quadruped_urdf(extra=FIXED.format(name="lidar") + FIXED.format(name="battery")),
    "world": quadruped_urdf(world=True),
    "massless base": TRUNK.sub(TRUNK_IS_FIXED, quadruped_urdf()),
    "turned inertial": quadruped_urdf().replace('<origin xyz="0.01 ', "<origin\n rpy='0.3 -0.4 1.0' xyz=\"0.01 ", 1),
    "no origin": re.sub(r'(<link name="trunk"><inertial>)<origin[^>]*/>', r"\1", quadruped_urdf()),
    "own name spaces": quadruped_urdf().replace(
        "<robot ", '<robot xmlns:drake="http://drake.mit.edu" drake:note="a" ', 1
    ),
    "quoted name": quadruped_urdf(trunk="tr&amp;unk"),
}


@pytest.mark.parametrize("case", URDFS)
def test_urdfs_of_all_kinds(case, tmp_path):
    robot = load_text(tmp_path, URDFS[case])
    path, _, result = written(robot, tmp_path)
    assert_same(composite_in_equipoise(path, result, robot), result.composite.parameters())
    assert_same(composite_in_pinocchio(path, result, robot.locked_joints), result.composite.parameters())
    assert_only_inertial_changed(URDFS[case].encode(), path.read_bytes())


@pytest.mark.parametrize("case", URDFS)
def test_a_payload_is_a_link_of_a_urdf(case, tmp_path):
    robot = load_text(tmp_path, URDFS[case])
    path, _, result = written(robot, tmp_path, payload_link=True)
    assert_same(composite_in_pinocchio(path, result, robot.locked_joints), result.composite.parameters())
    before, after = URDFS[case].encode(), path.read_bytes()
    start = after.index(b"<!-- equipoise")
    assert before.startswith(after[:start].rstrip())
    assert after.endswith(before[len(after[:start].rstrip()) :])
    assert_same(base_parameters(read_again(path, robot)), base_parameters(robot) + added_to(robot))


def test_locked_joints_keep_their_positions(tmp_path):
    robot = load_text(
        tmp_path, quadruped_urdf(arm_joints=2), RobotDescription(locked_joints={"arm_0": 0.7, "arm_1": -0.4})
    )
    path, out, result = written(robot, tmp_path)
    assert_same(composite_in_pinocchio(path, result, robot.locked_joints), result.composite.parameters())
    assert_same(base_parameters(read_again(path, robot)), result.base.parameters())
    assert out.header[3].endswith(", arm_0 0.7, arm_1 -0.4")


MJCF_TRUNK = re.compile(r"(<freejoint/>)<inertial [^>]*/>")


def mjcf(inertial, head='<compiler angle="radian"/>', **changes):
    return MJCF_TRUNK.sub(rf"\1{inertial}", quadruped_mjcf(head=head, **changes))


FIXED_BODY = (
    '<body name="lidar" pos="0.1 0 0.1" quat="0.9 0.1 -0.2 0.3"><inertial pos="0.01 0 0.02" mass="0.6" diaginertia="0.002 '
    '0.003 0.004" euler="0.1 0.2 0.3"/></body>'
)
MJCFS = {
    "fullinertia": quadruped_mjcf(),
    "quat": mjcf('<inertial pos="0.01 0 0" quat="0.8 0.2 -0.4 0.1" mass="6" diaginertia="0.02 0.06 0.065"/>'),
    "euler in degrees": re.sub(r' range="[^"]*"', "", mjcf(
        "<inertial mass='6'\n  diaginertia='0.02 0.06 0.065' pos='0.01 0 0' euler='20 -30 10' />",
        '<compiler eulerseq="ZYX" balanceinertia="true" autolimits="true"/>',
    )),
    "axisangle": mjcf('<inertial pos="0 0 0" axisangle="1 2 3 0.7" mass="6" diaginertia="0.02 0.06 0.065"/>'),
    "xyaxes": mjcf('<inertial pos="0 0 0" xyaxes="1 0.1 0 0 1 0.2" mass="6" diaginertia="0.02 0.06 0.065"/>'),
    "zaxis": mjcf('<inertial pos="0 0 0" zaxis="0.1 0.2 1" mass="6" diaginertia="0.02 0.06 0.065"/>'),
    "from geoms": quadruped_mjcf(explicit_inertia=False),
    "geoms that do not count": quadruped_mjcf(trunk_extra='<geom type="box" size="0.1 0.1 0.1" density="900"/>'),
    "arm": quadruped_mjcf(arm=True),
    "fixed body": quadruped_mjcf(trunk_extra=FIXED_BODY),
    "massless base": mjcf("", trunk_extra=FIXED_BODY.replace("0.6", "6").replace("0.002 0.003 0.004", "0.02 0.06 0.065")),
    "in frames": quadruped_mjcf().replace(
        "<worldbody>", '<worldbody><light pos="0 0 3"/><frame pos="1 0 0" euler="0.1 0 0">'
    ).replace("</worldbody>", "</frame></worldbody>"),
    "free joint": quadruped_mjcf(free='<joint type="free"/>'),
    "turned body": quadruped_mjcf(attributes='pos="0 0 0.5" euler="0 0.2 0.1"'),
    "defaults": quadruped_mjcf(
        head='<compiler angle="radian"/><default><default class="leg"><joint damping="1"/></default></default>'
    ),
}  # fmt: skip


@pytest.mark.parametrize("payload_link", [False, True], ids=["inertial", "payload link"])
@pytest.mark.parametrize("case", MJCFS)
def test_mjcfs_of_all_kinds(case, payload_link, tmp_path):
    robot = load_text(tmp_path, MJCFS[case], name="robot.xml")
    path, out, result = written(robot, tmp_path, payload_link=payload_link)
    assert_same(composite_in_mujoco(out.text, result, robot.locked_joints), result.composite.parameters())
    assert_same(composite_in_equipoise(path, result, robot), result.composite.parameters())
    if not payload_link and "<inertial" in MJCFS[case].split("<body", 2)[1]:
        assert_only_inertial_changed(MJCFS[case].encode(), path.read_bytes())


@pytest.mark.parametrize("payload_link", [False, True], ids=["inertial", "payload link"])
@pytest.mark.skipif(
    not (MODELS / "unitree_mujoco_go2.xml").is_file(),
    reason="EQUIPOISE_TEST_MODELS names no folder with unitree_mujoco_go2.xml",
)
def test_a_users_mjcf(payload_link, tmp_path):
    robot = load_robot(MODELS / "unitree_mujoco_go2.xml")
    path, _, result = written(robot, tmp_path, payload_link=payload_link)
    assert_same(
        composite_in_mujoco(read_again(path, robot).source.xml, result, robot.locked_joints),
        result.composite.parameters(),
    )
    if not payload_link:
        assert_only_inertial_changed(robot.source.path.read_bytes(), path.read_bytes())


@pytest.mark.parametrize(
    ("encoding", "bom"),
    [("utf-8", codecs.BOM_UTF8), ("utf-16-le", codecs.BOM_UTF16_LE), ("iso-8859-1", b"")],
)
def test_a_files_encoding_and_line_ends_stay(encoding, bom, tmp_path):
    declared = encoding.removesuffix("-le")
    text = f'<?xml version="1.0" encoding="{declared}"?>\n<!-- für mich -->\n' + quadruped_urdf()
    path = tmp_path / "robot.urdf"
    path.write_bytes(bom + text.replace("\n", "\r\n").encode(encoding))
    file, _, result = written(load_robot(path), tmp_path)
    robot = load_robot(path)
    assert_same(composite_in_equipoise(file, result, robot), result.composite.parameters())
    content = file.read_bytes()
    assert content.startswith(bom)
    exported = content[len(bom) :].decode(encoding)
    assert "<!-- für mich -->\r\n" in exported
    assert exported.count("\n") == exported.count("\r\n")


def test_exporting_onto_an_export_changes_nothing(a1, tmp_path):
    path, _, result = written(a1, tmp_path)
    again = export(result, "urdf", file=path)
    assert len(COMMENT.findall(again.content)) == 1
    twice = composite_in_equipoise(again.save(tmp_path / "twice.urdf"), result, a1)
    assert_same(twice, result.composite.parameters(), 1e-12)
    assert "is not the model file of the run" in again.notes[-1]


# --- what is refused


def refusal(error, result, model_format, **options):
    with pytest.raises(error) as raised:
        export(result, model_format, **options)
    return str(raised.value)


def test_a_file_that_changed_or_moved_since_the_run_is_refused(tmp_path):
    robot = load_text(tmp_path, quadruped_urdf(), name="robot.urdf")
    result, path = found(robot), tmp_path / "robot.urdf"
    path.write_text(quadruped_urdf() + "\n", encoding="utf-8")
    assert refusal(ModelError, result, "urdf") == (
        f"the model file {str(path)!r} has changed since the run; to edit its present content, name it with --file {path}"
    )
    named = export(result, "urdf", file=path)
    assert named.notes[0].startswith("robot.urdf is not the model file of the run: its sha256 is ")
    assert named.notes[0] in named.text
    moved = path.rename(tmp_path / "moved.urdf")
    assert refusal(ModelError, result, "urdf") == (
        f"the model file {str(path)!r} cannot be read: No such file or directory; name it with --file"
    )
    moved.write_text(quadruped_urdf(), encoding="utf-8")
    assert export(result, "urdf", file=moved).notes == ()


def test_another_file_of_the_robot_gets_the_estimated_composite(a1, tmp_path):
    text = a1.source.path.read_text(encoding="utf-8").replace('<mass value="1.013"/>', '<mass value="1.1"/>')
    (tmp_path / "mine.urdf").write_text(text, encoding="utf-8")
    result = found(a1)
    path = export(result, "urdf", file=tmp_path / "mine.urdf").save(tmp_path / "out.urdf")
    assert_same(composite_in_pinocchio(path, result, {}), result.composite.parameters())


def test_a_run_of_the_other_format_is_refused(a1, tmp_path):
    mine = found(dataclasses.replace(a1, name="mine"))
    assert refusal(SettingsError, mine, "mjcf") == (
        "the run's model is URDF: export --to urdf, or name your MJCF file of the same robot with --file"
    )
    assert refusal(SettingsError, found(a1), "mjcf", file=a1.source.path) == (
        f"{str(a1.source.path)!r} is URDF, not MJCF"
    )


@pytest.fixture
def menagerie(monkeypatch, tmp_path):
    """Replace robot_descriptions by a stub that has a Go1 of MuJoCo Menagerie; return its path."""
    folder = tmp_path / "menagerie & others"
    folder.mkdir()
    path = folder / "go1.xml"
    path.write_text(quadruped_mjcf(head='<compiler angle="radian" meshdir="assets"/>'), encoding="utf-8")
    package, module = types.ModuleType("robot_descriptions"), types.ModuleType("robot_descriptions.go1_mj_description")
    package.__path__, module.MJCF_PATH = [], str(path)
    monkeypatch.setitem(sys.modules, package.__name__, package)
    monkeypatch.setitem(sys.modules, module.__name__, module)
    return path


def test_a_run_with_a_urdf_gets_the_file_that_mujoco_menagerie_has(menagerie, tmp_path):
    robot = dataclasses.replace(load_text(tmp_path, quadruped_urdf()), name="go1")
    result = found(robot)
    out = export(result, "mjcf")
    assert f'meshdir="{str(menagerie.parent / "assets").replace("&", "&amp;")}"' in out.text
    assert f"the file is MuJoCo Menagerie's go1.xml, whose meshes stay in {menagerie.parent}" in out.notes
    assert_same(composite_in_mujoco(out.text, result, {}), result.composite.parameters())
    assert export_all(result)["mjcf"].content == out.content


def test_without_robot_descriptions_the_error_names_the_package(a1, monkeypatch):
    def absent(name):
        raise ModuleNotFoundError(f"No module named {name!r}", name="robot_descriptions")

    monkeypatch.setattr(importlib, "import_module", absent)
    assert refusal(MissingDependencyError, found(a1), "mjcf").endswith(
        "with --file, or install MuJoCo Menagerie's files: pip install robot_descriptions"
    )


@pytest.mark.parametrize(("moved", "distance"), [(0.0, None), (0.004, "4.0 mm"), (0.05, "50.0 mm")])
def test_a_file_with_feet_elsewhere_gets_a_note_or_is_refused(menagerie, tmp_path, moved, distance):
    text = menagerie.read_text(encoding="utf-8").replace('pos="0.2 0.1 0.0"', f'pos="{0.2 + moved} 0.1 0.0"', 1)
    menagerie.write_text(text, encoding="utf-8")
    result = found(dataclasses.replace(load_text(tmp_path, quadruped_urdf()), name="go1"))
    if moved > 0.01:
        message = refusal(SettingsError, result, "mjcf")
        assert message.endswith("it is another robot's, or its base frame or joint offsets differ")
    else:
        message = " ".join(export(result, "mjcf").notes)
    assert distance is None or f"the feet of go1.xml are {distance} from those of the run's model" in message
    assert (distance is None) == ("the feet of" not in message)


def test_a_result_without_its_model_needs_a_file(a1):
    result = dataclasses.replace(found(a1), robot_model=None)
    assert "name the run folder, or give --file" in refusal(SettingsError, result, "urdf")
    assert export(result, "urdf", file=a1.source.path).notes == ()


def test_a_robot_with_other_joints_is_refused(a1, tmp_path):
    (tmp_path / "other.urdf").write_text(quadruped_urdf(), encoding="utf-8")
    assert "the run's stance names 'FL_hip_joint'" in refusal(
        SettingsError, found(a1), "urdf", file=tmp_path / "other.urdf"
    )


def test_xacro_is_refused_with_a_remedy(a1, tmp_path):
    file = tmp_path / "robot.urdf.xacro"
    file.write_text('<robot xmlns:xacro="http://ros.org/wiki/xacro"><xacro:include filename="a"/></robot>', "utf-8")
    assert "run xacro on it and use the URDF that it writes" in refusal(ModelError, found(a1), "urdf", file=file)


def test_masses_from_geoms_alone_are_refused(tmp_path):
    text = quadruped_mjcf(explicit_inertia=False, head='<compiler angle="radian" inertiafromgeom="true"/>')
    assert "does not follow its <inertial> elements" in refusal(
        ModelError, found(load_text(tmp_path, text, name="robot.xml")), "mjcf"
    )


def test_a_base_body_in_another_file_is_refused(tmp_path):
    (tmp_path / "scene.xml").write_text('<mujoco><include file="robot.xml"/></mujoco>', encoding="utf-8")
    (tmp_path / "robot.xml").write_text(quadruped_mjcf(), encoding="utf-8")
    assert "write a single file (mujoco.mj_saveLastXML)" in refusal(
        ModelError, found(load_robot(tmp_path / "scene.xml")), "mjcf"
    )


@pytest.mark.parametrize("text", [quadruped_urdf(), quadruped_mjcf()], ids=["urdf", "mjcf"])
def test_an_unphysical_link_is_refused(text, tmp_path):
    robot = load_text(tmp_path, text)
    light = InertialParameters(-5.9, np.array([0.0, 0.0, 0.1]), -0.05 * np.eye(3))
    message = refusal(NotEstimatedError, found(robot, light), robot.source.format)
    assert message.startswith(
        "link 'trunk' of robot, minus the other links, is not physical: a principal moment of inertia is -3.2"
    )
    assert "equipoise audit" in message


def within(result, half_width):
    """Return the result with intervals of this half-width."""
    found, variance = result.composite, (half_width / NORMAL_95) ** 2
    known = Body.complete(found.parameters(), variance * np.eye(10), np.full(10, np.inf), found.model)
    return dataclasses.replace(result, composite=known)


def test_a_nearly_physical_payload_is_a_link(a1, tmp_path):
    result = found(a1, InertialParameters(0.5, np.array([0.1, 0.0, 0.1]), np.diag([0.001, 0.002, -0.0005])))
    result = within(result, 0.01)
    written = export(result, "urdf", payload_link=True)
    assert any(
        note.startswith("within the intervals: equipoise_payload, the difference from the model file, is not physical")
        for note in written.notes
    )
    again = composite_in_equipoise(written.save(tmp_path / "robot.urdf"), result, a1)
    np.testing.assert_allclose(again.com, result.composite.com_in_base.values, rtol=1e-12)
    assert again.mass == pytest.approx(result.composite.mass.value, rel=1e-12)


def test_an_unphysical_payload_is_refused_unless_forced(a1, tmp_path):
    result = found(a1, InertialParameters(0.5, np.array([0.1, 0.0, 0.1]), np.diag([0.001, 0.002, -0.0005])))
    result = within(result, 1e-6)
    assert "is not physical: a principal moment of inertia is -0.0005 kg m2" in refusal(
        NotEstimatedError, result, "urdf", payload_link=True
    )
    forced = export(result, "urdf", payload_link=True, force=True)
    assert forced.notes[0].startswith("FORCED, beyond the intervals: equipoise_payload, the difference")
    assert forced.notes[0] in forced.text
    again = composite_in_equipoise(forced.save(tmp_path / "robot.urdf"), result, a1)
    np.testing.assert_allclose(again.com, result.composite.com_in_base.values, rtol=1e-12)
    lighter = found(a1, InertialParameters(-0.2, np.zeros(3), -0.001 * np.eye(3)))
    assert "would have a mass of -0.2 kg" in refusal(NotEstimatedError, lighter, "urdf", payload_link=True, force=True)


@pytest.mark.parametrize("model_format", ["urdf", "mjcf"])
def test_a_second_payload_link_is_refused(model_format, tmp_path):
    text = quadruped_urdf() if model_format == "urdf" else quadruped_mjcf()
    robot = load_text(tmp_path, text)
    path, _, _ = written(robot, tmp_path, payload_link=True)
    heavier = found(read_again(path, robot))
    assert "'equipoise_payload' already; use the file without it" in refusal(
        SettingsError, heavier, model_format, payload_link=True
    )
