"""USD as usd-core reads it; tests that do not need usd-core run without it."""

import dataclasses
import sys

import numpy as np
import pytest
from exporting import assert_same, found, usd, with_joints
from scipy.spatial.transform import Rotation

from equipoise import export
from equipoise.errors import MissingDependencyError, ModelError, SettingsError
from equipoise.result.quantity import Quantity
from equipoise.robot.inertial import InertialParameters

CALF = "FL_calf_joint"
FIXED = """
    def Xform "lidar" (
        prepend apiSchemas = ["PhysicsRigidBodyAPI"]
    ) {}
    def PhysicsFixedJoint "mount"
    {
        rel physics:body0 = </a1/trunk>
        rel physics:body1 = </a1/lidar>
    }"""


@pytest.fixture(scope="module")
def result(a1):
    return with_joints(found(a1))


@pytest.fixture
def pxr():
    return pytest.importorskip("pxr", reason="usd-core is not installed: USD is NOT TRIED")


def written(result, tmp_path, name="a1.usda", **options):
    """Return the stage of an exported file."""
    from pxr import Usd  # noqa: PLC0415

    path = export(result, "usd", file=tmp_path / name, **options).save(tmp_path / f"new_{name}")
    return Usd.Stage.Open(str(path))


def trunk_of(stage):
    """Return the base's body in SI units, by the rules of UsdPhysics."""
    from pxr import UsdGeom, UsdPhysics  # noqa: PLC0415

    mass_unit, length = UsdPhysics.GetStageKilogramsPerUnit(stage), UsdGeom.GetStageMetersPerUnit(stage)
    api = UsdPhysics.MassAPI(stage.GetPrimAtPath("/a1/trunk"))
    axes = api.GetPrincipalAxesAttr().Get()
    turn = Rotation.from_quat([*axes.GetImaginary(), axes.GetReal()]).as_matrix()
    inertia = turn @ np.diag(api.GetDiagonalInertiaAttr().Get()) @ turn.T * mass_unit * length**2
    com = np.array(api.GetCenterOfMassAttr().Get()) * length
    return InertialParameters(api.GetMassAttr().Get() * mass_unit, com, inertia)


@pytest.mark.parametrize("name", ["a1.usda", "a1.usd", "a1.usdc"])
def test_usd_has_the_base_in_the_stages_units(name, pxr, a1, result, tmp_path):
    from pxr import Sdf  # noqa: PLC0415

    (tmp_path / "text.usda").write_text(usd(a1, length=0.01, mass=0.001), encoding="utf-8")
    Sdf.Layer.FindOrOpen(str(tmp_path / "text.usda")).Export(str(tmp_path / name))
    stage = written(result, tmp_path, name)
    assert_same(trunk_of(stage), result.base.parameters(), 1e-6)  # single precision
    trunk = stage.GetPrimAtPath("/a1/trunk")
    assert sorted(trunk.GetAppliedSchemas()) == ["PhysicsMassAPI", "PhysicsRigidBodyAPI"]
    assert trunk.GetRelationship("kept").GetTargets() == ["/a1"]
    assert trunk.GetCustomDataByKey("equipoise").startswith("equipoise ")
    assert not stage.GetPrimAtPath(f"/a1/{CALF}").GetAuthoredAttributes()
    before, after = ((tmp_path / file).read_bytes()[:8] for file in (name, f"new_{name}"))
    assert before == after  # text stays text


def test_joints_have_physx_parameters_in_degrees(pxr, a1, result, tmp_path):
    (tmp_path / "a1.usda").write_text(usd(a1), encoding="utf-8")
    stage = written(result, tmp_path, parameters="motors")
    joint = stage.GetPrimAtPath(f"/a1/{CALF}")
    values = {attribute.GetName().split(":")[-1]: attribute.Get() for attribute in joint.GetAuthoredAttributes()}
    assert values == pytest.approx({
        "armature": 0.0102, "staticFrictionEffort": 0.32, "dynamicFrictionEffort": 0.32,
        "viscousFrictionCoefficient": np.radians(0.052),
    })  # fmt: skip
    assert joint.GetMetadata("apiSchemas").GetAddedOrExplicitItems() == ["PhysxJointAxisAPI:angular"]
    assert stage.GetPrimAtPath("/a1/trunk").GetAttribute("physics:mass").Get() == pytest.approx(4.7)
    twice = written(result, tmp_path, "new_a1.usda", parameters="motors")
    again = twice.GetPrimAtPath(f"/a1/{CALF}")
    assert again.GetMetadata("apiSchemas").GetAddedOrExplicitItems() == ["PhysxJointAxisAPI:angular"]


def test_static_friction_includes_stribeck_friction(pxr, a1, result, tmp_path):
    (tmp_path / "a1.usda").write_text(usd(a1), encoding="utf-8")
    at_rest = Quantity("stribeck_friction", "Nm", 0.1, 0.01, "identified")
    motors = {name: dataclasses.replace(motor, stribeck_friction=at_rest) for name, motor in result.motors.items()}
    stage = written(dataclasses.replace(result, motors=motors), tmp_path, parameters="motors")
    joint = stage.GetPrimAtPath(f"/a1/{CALF}")
    values = {attribute.GetName().split(":")[-1]: attribute.Get() for attribute in joint.GetAuthoredAttributes()}
    assert values["staticFrictionEffort"] == pytest.approx(0.42)
    assert values["dynamicFrictionEffort"] == pytest.approx(0.32)


def test_composed_files_are_overridden_with_a_note(pxr, a1, result, tmp_path):
    (tmp_path / "parts.usda").write_text(usd(a1), encoding="utf-8")
    (tmp_path / "a1.usda").write_text("#usda 1.0\n(\n    metersPerUnit = 1\n    subLayers = [@./parts.usda@]\n)\n")
    assert_same(trunk_of(written(result, tmp_path)), result.base.parameters(), 1e-6)
    notes = export(result, "usd", file=tmp_path / "a1.usda").notes
    assert notes[0] == "a1.usda is composed of ./parts.usda: write the output to the same folder with --out"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (lambda a1: usd(a1).replace('"trunk"', '"base"'), "has 0 rigid bodies called 'trunk'; it has base"),
        (lambda a1: usd(a1, more=FIXED), "fixes bodies to 'trunk' (joint 'mount'), whose masses would be counted twice"),
        (lambda a1: usd(a1).replace(CALF, "calf"), f"has 0 revolute joints called {CALF!r}"),
        (lambda a1: usd(a1).replace("rel kept", "double3 xformOp:scale = (2, 1, 1)\n uniform token[] xformOpOrder = "
                                    '["xformOp:scale"]\n rel kept'), "scales 'trunk' by [2.0, 1.0, 1.0]"),
        (lambda a1: "#usda 1.0\ndef {", "is not valid USD: "),
    ],
    ids=["no base", "fixed", "no joint", "scaled", "damaged"],
)  # fmt: skip
def test_an_unsuitable_stage_is_refused(text, message, pxr, a1, result, tmp_path):
    (tmp_path / "a1.usda").write_text(text(a1), encoding="utf-8")
    with pytest.raises(ModelError) as error:
        export(result, "usd", file=tmp_path / "a1.usda", parameters="all")
    assert message in str(error.value)


def test_a_locked_arm_is_not_counted_twice(pxr, a1, result, tmp_path):
    (tmp_path / "a1.usda").write_text(usd(a1, more='\n    def PhysicsRevoluteJoint "arm" {}'), encoding="utf-8")
    assert export(result, "usd", file=tmp_path / "a1.usda").notes == ()
    held = dataclasses.replace(result, locked_joints={"arm": 0.3})
    with pytest.raises(ModelError, match="has joint 'arm', which was locked"):
        export(held, "usd", file=tmp_path / "a1.usda")
    export(held, "usd", file=tmp_path / "a1.usda", parameters="motors")


def test_errors_without_a_file_or_usd_core_name_a_remedy(result, tmp_path, monkeypatch):
    with pytest.raises(SettingsError) as error:
        export(result, "usd")
    assert str(error.value) == "format usd edits your own stage: name it with --file robot.usd"
    monkeypatch.setitem(sys.modules, "pxr", None)
    for name in [name for name in sys.modules if name.startswith("pxr.")]:
        monkeypatch.setitem(sys.modules, name, None)
    (tmp_path / "a1.usda").write_text("#usda 1.0\n", encoding="utf-8")
    with pytest.raises(MissingDependencyError) as error:
        export(result, "usd", file=tmp_path / "a1.usda")
    assert str(error.value) == "USD needs usd-core: pip install 'equipoise[usd]'"
