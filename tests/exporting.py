"""Synthetic results to export: a robot with a known payload that its model file lacks."""

import dataclasses
import warnings

import mujoco
import numpy as np
import pinocchio as pin

from equipoise import BayesianMethod, RunFolder
from equipoise.errors import ModelWarning
from equipoise.exports.subject import seen_from
from equipoise.result.body import Body
from equipoise.result.calibration import Calibration, model_facts
from equipoise.result.findings import Motor, SensorFinding
from equipoise.result.quantity import Quantity
from equipoise.result.statistics import verdict_of
from equipoise.robot.inertial import COMPONENTS, InertialParameters, components, composite_parameters, nominal_inertia
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import nominal_stance

# 4 % of a robot's mass, off centre, with an inertia that is not diagonal.
_SHARE, _COM = 0.04, np.array([0.07, -0.03, 0.11])
_TILT = (-0.004, 0.002, 0.007)
_GYRATION = np.array([[0.005, 0.0004, -0.0002], [0.0004, 0.006, 0.0003], [-0.0002, 0.0003, 0.004]])

# Files that a user may have: a const.xacro as legged_control's, an SDF as Gazebo's and the <inertial> of its trunk.
CONST = """<?xml version="1.0"?>
<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="a1">
    <!-- trunk -->
    <xacro:property name="trunk_mass" value="6.0"/>
    <xacro:property name='trunk_com_x'   value='0.0'/>  <!-- measured -->
    <xacro:property name="trunk_com_y" value="${0.002 * 2}"/><xacro:property name="trunk_com_z" value="0"/>
    <xacro:property name="trunk_ixx" value="0.01"/><xacro:property name="trunk_ixy" value="0"/>
    <xacro:property name="trunk_ixz" value="0"/><xacro:property name="trunk_iyy" value="0.03"/>
    <xacro:property name="trunk_iyz" value="0"/><xacro:property name="trunk_izz" value="0.04"/>
    <xacro:property name="hip_mass" value="0.595"/>
</robot>
"""
INERTIAL = (
    "<inertial><!-- CAD --><pose degrees='true'>0.1 0 0 0 0 30</pose>\n<mass>6</mass><inertia><ixx>1</ixx><iyy>1</iyy>"
    "<izz>1</izz></inertia></inertial>"
)
SDF = """<sdf version="1.9"><world name="w"><model name="a1">
  <link name="trunk">{}<visual name="v"/></link>
  <link name="FR_hip"><inertial><mass>1</mass></inertial></link>
  <joint name="FR" type="revolute"><parent>trunk</parent><child>FR_hip</child></joint>
</model></world></sdf>
"""
USD = """#usda 1.0
(
    defaultPrim = "a1"
    kilogramsPerUnit = {mass}
    metersPerUnit = {length}
)

def Xform "a1"
{{
    def Xform "trunk" (
        prepend apiSchemas = ["PhysicsRigidBodyAPI"]
    )
    {{
        float physics:mass = 4.7
        rel kept = </a1>
    }}
{joints}
}}
"""


def usd(robot, length=1, mass=1, more=""):
    """Return a USD of a robot's base and joints, with other units and additional prims."""
    joints = "\n".join(f'    def PhysicsRevoluteJoint "{name}" {{}}' for name in robot.joint_names)
    return USD.format(length=length, mass=mass, joints=joints + more)


def added_to(robot):
    """Return the payload of a robot."""
    mass = _SHARE * robot.mass
    return InertialParameters(mass, _COM, mass * _GYRATION)


def found(robot, added=None, verdicts=None, **changes):
    """Return a calibration with a payload that the model file lacks, and small standard deviations.

    Args:
        verdicts: other than "identified", by (body, parameter).
    """
    added = added or added_to(robot)
    stance = nominal_stance(robot).joint_position
    nominal = nominal_inertia(robot, stance)
    bodies = {name: joined(getattr(nominal, name), added) for name in ("composite", "base")}
    result = Calibration(
        **model_facts(robot, stance), method="bayesian", excitations={}, support_lines={}, trials=(), settings={},
        composite=sure("composite", bodies["composite"], nominal.composite, verdicts or {}),
        base=sure("base", bodies["base"], nominal.base, verdicts or {}),
        stance_effective=Body.partial(nominal.stance_effective),
    )  # fmt: skip
    return dataclasses.replace(result, **changes)


def with_joints(result):
    """Return the result with sensor and motor parameters: another number for every joint and axis.

    The first joint's zero and gain are not identified, the second joint's are weak.
    """
    names = list(result.joint_position)
    stds = {names[0]: 4e-3, names[1]: 2e-3}
    zeros = [finding(f"{name} offset", 1e-3 * (i - 5.5), stds.get(name, 3e-4)) for i, name in enumerate(names)]
    imu = [
        finding(f"IMU {word}", value, 4e-4) for word, value in zip(("rolled", "pitched", "yawed"), _TILT, strict=True)
    ]
    motors = {name: motor(i, 0.03 if name in stds else 2e-3) for i, name in enumerate(names)}
    sensors = (*imu, finding("clock offset", -1.25e-3, 1e-4), *zeros[::-1])
    return dataclasses.replace(result, sensors=sensors, motors=motors)


def finding(name, value, std):
    return SensorFinding(name, value, std, "", False)


def motor(i, std):
    """Return the i-th joint's motor, with a gain of this standard deviation."""
    values = {
        "coulomb_friction": (0.3 + i / 100, 0.01),
        "viscous_friction": (0.05 + i / 1000, 1e-3),
        "armature": (0.01 + i / 1e4, 5e-4),
        "relative_gain": (0.03 - i / 200, std),
        "delay": (4e-3 + i / 1e5, 2e-5),
    }
    reference = {"relative_gain": 0.05, "delay": 5e-3}
    return Motor(**{
        name: Quantity(name, "", value, sd, verdict_of(sd, reference.get(name, value))) for name, (value, sd) in values.items()
    })  # fmt: skip


def make_run(path, robot):
    """Write a finished run of a robot that is heavier than its file."""
    with RunFolder.create(path, robot, BayesianMethod(), {"time": "2026-01-01T00:00:00+00:00"}) as folder:
        folder.save(with_joints(found(robot)).with_provenance(**folder.provenance))


def joined(body, added):
    """Return both bodies together; the added one need not be physical."""
    return InertialParameters.from_vector(body.vector + added.vector)


def sure(name, body, model, verdicts):
    """Return a body with standard deviations of 2 % of each parameter, some of them correlated."""
    scale = np.abs(components(body))
    scale[1:4] = 0.02
    scale[7:] = scale[4:7].min()
    root = 0.02 * np.diag(scale)
    root[4:7, 0] = root[4:7, 4:7].diagonal()
    reference = {"identified": np.inf, "weak": 3.0, "not identified": 1.0}  # standard deviations
    covariance = root @ root.T
    sizes = [reference[verdicts.get((name, part), "identified")] for part in COMPONENTS]
    return Body.complete(body, covariance, np.sqrt(np.diag(covariance)) * sizes, model)


def read_again(path, robot):
    """Return the robot of an exported file."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        return RobotModel.from_file(path, robot.name, robot.description)


def composite_in_equipoise(path, result, robot):
    """Return the composite of an exported file, as equipoise reads it."""
    again = read_again(path, robot)
    return composite_parameters(again, again.joint_vector(dict(result.joint_position), "stance"))


def composite_in_pinocchio(path, result, held):
    """Return the composite of a URDF, as Pinocchio reads it, without equipoise's cleaning."""
    model = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
    q = pin.neutral(model)
    for name, position in {**result.joint_position, **held}.items():
        joint = model.joints[model.getJointId(name)]
        turned = [position] if joint.nq == 1 else [np.cos(position), np.sin(position)]  # a continuous joint
        q[joint.idx_q : joint.idx_q + joint.nq] = turned
    data = model.createData()
    pin.ccrba(model, data, q, np.zeros(model.nv))
    body = pin.Inertia(data.Ig)
    in_root = InertialParameters(body.mass, np.array(pin.centerOfMass(model, data, q)), np.array(body.inertia))
    return seen_from(in_root, model.frames[model.getFrameId(result.model["base_link"], pin.FrameType.BODY)].placement)


def composite_in_mujoco(text, result, held):
    """Return the composite of an MJCF text, as MuJoCo compiles it."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[:] = 0
    data.qpos[3] = 1
    for name, position in {**result.joint_position, **held}.items():
        joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)
        data.qpos[model.jnt_qposadr[joint]] = position
    mujoco.mj_kinematics(model, data)
    total = None
    for body in range(1, model.nbody):
        turn = data.ximat[body].reshape(3, 3)
        if model.body_mass[body] > 0:
            part = InertialParameters(
                float(model.body_mass[body]), data.xipos[body], turn @ np.diag(model.body_inertia[body]) @ turn.T
            )
            total = part if total is None else total + part
    return total


def assert_same(a, b, tolerance=1e-9):
    """Assert that two bodies agree to a relative tolerance."""
    np.testing.assert_allclose(components(a), components(b), rtol=tolerance, atol=tolerance * a.mass)
