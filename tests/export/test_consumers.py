"""Exported files read by their consumers; tests of consumers that are not installed are skipped.

MuJoCo and Pinocchio read theirs in test_export_models.py and test_sensors_and_motors.py, usd-core in test_usd.py.
"""

import inspect
import math
from types import SimpleNamespace

import numpy as np
import pytest
from exporting import CONST, INERTIAL, SDF, assert_same, found, with_joints
from robots import load_text, quadruped_mjcf

from equipoise import export
from equipoise.robot.inertial import InertialParameters

STEP = 0.002  # [s], of mjlab's physics


def installed(module, package):
    return pytest.importorskip(module, reason=f"{package} is not installed: what it makes of its file is NOT TRIED")


@pytest.fixture(scope="module")
def result(a1):
    return with_joints(found(a1))


def names_in(text):
    names = {}
    exec(compile(text, "exported", "exec"), names)
    return names


# --- Drake


def test_drake_weighs_the_robot_of_a_urdf(result, tmp_path):
    installed("pydrake", "drake")
    from pydrake.multibody.parsing import Parser  # noqa: PLC0415
    from pydrake.multibody.plant import MultibodyPlant  # noqa: PLC0415

    path = export(result, "urdf").save(tmp_path / "found.urdf")
    plant = MultibodyPlant(0.0)
    (model,) = Parser(plant).AddModels(str(path))
    plant.Finalize()
    context = plant.CreateDefaultContext()
    for name, angle in result.joint_position.items():
        plant.GetJointByName(name).set_angle(context, angle)
    whole = plant.CalcSpatialInertia(context, plant.GetFrameByName("trunk"), plant.GetBodyIndices(model))
    inertia = whole.Shift(whole.get_com()).CalcRotationalInertia().CopyToFullMatrix3()
    assert_same(InertialParameters(whole.get_mass(), whole.get_com(), inertia), result.composite.parameters(), 1e-9)


# --- Gazebo's engine


def test_dart_weighs_the_link_of_an_sdf(result, tmp_path):
    dart = installed("dartpy", "dartpy, the engine of Gazebo,")
    jointed = SDF.replace("</child>", "</child><axis><xyz>1 0 0</xyz></axis>").replace('<visual name="v"/>', "")
    model = tmp_path / "model.sdf"
    model.write_text(jointed.replace('version="1.9"', 'version="1.6"').format(INERTIAL), encoding="utf-8")
    path = export(result, "sdf", file=model).save(tmp_path / "found.sdf")
    skeleton = dart.utils.SdfParser.readWorld(dart.common.Uri(str(path))).getSkeleton(0)
    trunk = skeleton.getBodyNode("trunk")
    body = InertialParameters(trunk.getMass(), trunk.getLocalCOM(), trunk.getInertia().getMoment())
    assert_same(body, result.base.parameters(), 1e-12)


# --- xacro


def test_xacro_makes_a_link_of_the_properties(result, tmp_path):
    xacro = installed("xacro", "xacro")
    const = tmp_path / "const.xacro"
    const.write_text(CONST, encoding="utf-8")
    export(result, "xacro", file=const).save(tmp_path / "found.xacro")
    com, inertia = (
        " ".join(f"{key}" for key in keys) for keys in (("x", "y", "z"), ("xx", "xy", "xz", "yy", "yz", "zz"))
    )
    origin = " ".join(f"${{trunk_com_{axis}}}" for axis in com.split())
    tensor = " ".join(f'i{key}="${{trunk_i{key}}}"' for key in inertia.split())
    (tmp_path / "robot.xacro").write_text(
        '<robot name="a1" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include filename="found.xacro"/>'
        f'<link name="trunk"><inertial><origin xyz="{origin}"/><mass value="${{trunk_mass}}"/>'
        f"<inertia {tensor}/></inertial></link></robot>",
        encoding="utf-8",
    )
    (inertial,) = xacro.process_file(str(tmp_path / "robot.xacro")).getElementsByTagName("inertial")
    at = {tag: inertial.getElementsByTagName(tag)[0] for tag in ("origin", "mass", "inertia")}
    moments = [[float(at["inertia"].getAttribute(f"i{''.join(sorted(a + b))}")) for b in "xyz"] for a in "xyz"]
    place = np.array([float(word) for word in at["origin"].getAttribute("xyz").split()])
    body = InertialParameters(float(at["mass"].getAttribute("value")), place, np.array(moments))
    assert_same(body, result.base.parameters(), 1e-12)


# --- mjlab


@pytest.fixture(scope="module")
def mjlab(tmp_path_factory):
    """Return mjlab's entity of a robot, from the exported MJCF and actuators, and the result."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("warnings.filters", [("ignore", None, Warning, None, 0)])  # of packages that are not ours
        installed("mjlab", "mjlab")
        import mujoco  # noqa: PLC0415
        from mjlab.actuator import BuiltinPositionActuatorCfg  # noqa: PLC0415
        from mjlab.entity import Entity, EntityArticulationInfoCfg, EntityCfg  # noqa: PLC0415

        folder = tmp_path_factory.mktemp("mjlab")
        result = with_joints(found(load_text(folder, quadruped_mjcf(), name="robot.xml")))
        path = export(result, "mjcf").save(folder / "found.xml")
        names = names_in(export(result, "mjlab", parameters="all").text)
        actuators = tuple(
            BuiltinPositionActuatorCfg(stiffness=20.0, damping=0.5, **row) for row in names["actuators"](STEP)
        )
        entity = Entity(EntityCfg(
            spec_fn=lambda: mujoco.MjSpec.from_file(str(path)),
            articulation=EntityArticulationInfoCfg(actuators=actuators),
        ))  # fmt: skip
        yield SimpleNamespace(result=result, names=names, actuators=actuators, model=entity.spec.compile())


def test_joints_of_mjlab_have_the_estimated_parameters(mjlab):
    dofs = {name: int(mjlab.model.joint(name).dofadr[0]) for name in mjlab.result.joint_position}
    for attribute, quantity in (
        ("armature", "armature"),
        ("frictionloss", "coulomb_friction"),
        ("damping", "viscous_friction"),
    ):
        of_model = getattr(mjlab.model, f"dof_{attribute}")
        for name, dof in dofs.items():
            assert of_model[dof] == pytest.approx(getattr(mjlab.result.motors[name], quantity).value), (name, attribute)
    for actuator in mjlab.actuators:
        (name,) = actuator.target_names_expr
        delay = mjlab.result.motors[name].delay.value
        assert STEP * actuator.delay_min_lag <= delay + STEP / 2
        assert STEP * actuator.delay_max_lag >= delay - STEP / 2


def test_terms_of_mjlab_take_the_drawn_ranges(mjlab):
    from mjlab.envs.mdp import dr  # noqa: PLC0415

    assert mjlab.names["PSEUDO_INERTIA"].keys() <= inspect.signature(dr.pseudo_inertia).parameters.keys()
    low, high = next(iter(mjlab.names["ENCODER_BIAS"].values()))
    assert low < high
    assert "bias_range" in inspect.signature(dr.encoder_bias).parameters


# --- holosoma


def test_holosomas_robot_takes_the_offsets(result):
    robot = installed("holosoma_inference.config.config_types.robot", "holosoma-inference")
    offsets = names_in(export(result, "holosoma").text)["joint_offsets_deg"]
    joints = tuple(result.joint_position)
    each, order = (0.0,) * len(joints), tuple(range(len(joints)))
    config = robot.RobotConfig(
        robot_type="a1", robot="a1", num_motors=len(joints), num_joints=len(joints), default_dof_angles=each,
        default_motor_angles=each, motor2joint=order, joint2motor=order, dof_names=joints, dof_names_upper_body=(),
        dof_names_lower_body=joints, joint_offsets_deg=offsets(joints),
    )  # fmt: skip
    zeros = {finding.name: finding.value for finding in result.sensors}
    assert config.joint_offsets_deg[3] == pytest.approx(math.degrees(zeros[f"{joints[3]} offset"]))
    assert config.joint_offsets_deg[0] == 0.0  # not identified
