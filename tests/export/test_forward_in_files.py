"""Exports for files in which another axis than x points forward: values are in the file's axes."""

import ast
import dataclasses
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from exporting import CONST, SDF, added_to, assert_same, composite_in_mujoco, composite_in_pinocchio, found, usd
from robots import load_text, quadruped_mjcf, quadruped_urdf

from equipoise import RobotDescription, export
from equipoise.robot.inertial import InertialParameters, base_parameters

TURN = np.array(
    [[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]
)  # vectors of the base frame, whose x is the file's y, in file axes
TRUNK = RobotDescription(forward="+y")

pytestmark = pytest.mark.filterwarnings("ignore::equipoise.errors.ModelWarning")


@pytest.fixture
def robot(tmp_path):
    return load_text(tmp_path, quadruped_urdf(), TRUNK)


@pytest.fixture
def result(robot):
    return found(robot)


@pytest.fixture
def base(robot):
    """Return the base in the file's axes."""
    return in_file(base_parameters(robot) + added_to(robot))


def in_file(body):
    return InertialParameters(body.mass, TURN @ body.com, TURN @ body.inertia @ TURN.T)


def from_words(mass, com, ixx, ixy, ixz, iyy, iyz, izz):
    return InertialParameters(mass, np.array(com), np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]]))


def from_sdf(inertial):
    x, y, z, *_ = map(float, inertial.findtext("pose").split())
    moments = [float(inertial.findtext(f"inertia/{key}")) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")]
    return from_words(float(inertial.findtext("mass")), (x, y, z), *moments)


@pytest.mark.parametrize("payload_link", [False, True])
def test_a_urdf_has_the_estimated_composite(robot, result, tmp_path, payload_link):
    path = export(result, "urdf", payload_link=payload_link).save(tmp_path / "exported.urdf")
    of_file = dataclasses.replace(result, model={**result.model, "base_link": "trunk"})
    assert_same(composite_in_pinocchio(path, of_file, robot.locked_joints), in_file(result.composite.parameters()))


@pytest.mark.parametrize("payload_link", [False, True])
def test_an_mjcf_has_the_estimated_composite(tmp_path, payload_link):
    robot = load_text(tmp_path, quadruped_mjcf(), TRUNK)
    result = found(robot)
    out = export(result, "mjcf", payload_link=payload_link)
    assert_same(composite_in_mujoco(out.text, result, robot.locked_joints), in_file(result.composite.parameters()))
    assert "trunk_forward" not in out.text


def test_an_inertial_of_an_sdf_is_the_base_links(result, base):
    out = export(result, "sdf")
    assert_same(from_sdf(ET.fromstring(out.text)), base)
    assert "base link 'trunk' with all" in out.text


def test_a_link_of_an_sdf_hangs_at_the_base_link(robot, result, tmp_path):
    (tmp_path / "model.sdf").write_text(SDF.format(""))
    root = ET.fromstring(export(result, "sdf", payload_link=True, file=tmp_path / "model.sdf").text)
    link = next(e for e in root.iter("link") if e.get("name") == "equipoise_payload")
    assert link.find("pose").get("relative_to") == "trunk"
    assert_same(from_sdf(link.find("inertial")), in_file(added_to(robot)))


def test_xacro_has_the_base_in_its_own_axes(result, base, tmp_path):
    (tmp_path / "const.xacro").write_text(CONST)
    root = ET.fromstring(export(result, "xacro", file=tmp_path / "const.xacro").text)
    of = {e.get("name"): e.get("value") for e in root}
    moments = [float(of[f"trunk_{key}"]) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")]
    com = [float(of[f"trunk_com_{axis}"]) for axis in "xyz"]
    assert_same(from_words(float(of["trunk_mass"]), com, *moments), base)


@pytest.mark.parametrize("name", ["mjlab", "isaaclab"])
def test_drawn_bodies_are_in_the_axes_of_the_file(result, base, name):
    assigned = {
        one.targets[0].id: one.value for one in ast.parse(export(result, name).text).body if isinstance(one, ast.Assign)
    }
    assert ast.literal_eval(assigned["BASE_LINK"]) == "trunk"
    drawn = ast.literal_eval(assigned["QUANTILES"])
    for axis, com in zip("xyz", base.com, strict=True):
        assert drawn[f"com_{axis}"][0] < com < drawn[f"com_{axis}"][1]
    widths = [np.diff(drawn[name])[0] for name in ("Ixx", "Iyy")]
    x, y = result.composite.inertia.stds.diagonal()[:2]
    assert (widths[0] > widths[1]) == (y > x)  # turned by a right angle


def test_usd_has_the_base_prim_in_its_own_axes(robot, result, base, tmp_path):
    pytest.importorskip("pxr", reason="usd-core is not installed: USD is NOT TRIED")
    from pxr import Usd, UsdPhysics  # noqa: PLC0415

    (tmp_path / "a1.usda").write_text(usd(robot))
    path = export(result, "usd", file=tmp_path / "a1.usda").save(tmp_path / "new.usda")
    stage = Usd.Stage.Open(str(path))
    api = UsdPhysics.MassAPI(stage.GetPrimAtPath("/a1/trunk"))
    np.testing.assert_allclose(np.array(api.GetCenterOfMassAttr().Get()), base.com, atol=1e-6)


def test_numbers_for_controllers_stay_in_axes_whose_x_points_forward(result):
    assert "frame of base link 'trunk_forward'" in export(result, "yaml").text
