"""MuJoCo model of the simulated robot, made from the robot's model file."""

from __future__ import annotations

import copy
import dataclasses
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from equipoise.conventions import GRAVITY, FloatArray
from equipoise.errors import ModelError, SettingsError
from equipoise.robot.cleaning.urdf import read_inertia, write_inertia
from equipoise.robot.model import RobotModel
from equipoise.robot.source import ModelSource
from equipoise.robot.stance import Stance
from equipoise.simulation.drawn_errors import DrawnErrors
from equipoise.simulation.effects import Contacts
from equipoise.simulation.leg_errors import LegErrors
from equipoise.simulation.mujoco_contacts import CONTACT_TIME, IMPEDANCE, IMPRATIO, add_contacts, quat_wxyz, soften_feet
from equipoise.simulation.mujoco_drive import add_springs, has_springs, set_springs, set_stops
from equipoise.simulation.mujoco_legs import add_rotor_spin, change_legs
from equipoise.simulation.mujoco_loads import add_loads, linear
from equipoise.simulation.payload import Payload

IMU_SITE = "equipoise_imu"
ACCELEROMETER = "equipoise_accelerometer"

TIMESTEP = 0.5e-3  # [s], the usual one
_NO_ISLANDS = int(getattr(mujoco.mjtDisableBit, "mjDSBL_ISLAND", 0))


@dataclass(frozen=True, eq=False)
class SimulatedRobot:
    """Compiled MuJoCo model with the indices of the robot's joints.

    Attributes:
        model: compiled model; the engine's joint PD, torque limits, feet, floor, payload and actuator errors are in it.
        errors: drawn sensor and actuator errors that it was made with.
        qpos: (nj,) indices of the leg joints in qpos, in the robot's joint order; `dof` likewise in qvel.
        dof: (nj,) indices of the same joints in qvel.
        kp, kd: (nj,) gains that the joint PD is commanded with [Nm/rad], [Nm s/rad].
        base_body: id of the base body.
        links: the same model without rotor spin: its bodies have the inertias of the links.
    """

    model: mujoco.MjModel
    errors: DrawnErrors
    qpos: NDArray[np.intp]
    dof: NDArray[np.intp]
    kp: FloatArray
    kd: FloatArray
    base_body: int
    links: mujoco.MjModel

    def set_gains(self, kp: FloatArray, kd: FloatArray) -> None:
        """Set the commanded (nj,) gains of the joint PD [Nm/rad], [Nm s/rad] (`set_joints`)."""
        # An error of the torque constant acts on the motor's own loop by the same factor.
        errors, gain = self.errors, self.errors.torque_gain
        # `add_rotor_spin` puts the rest into the inertia of the carrying link.
        armature = errors.sizes.armature * (1 - errors.sizes.rotor_spin)
        losses = errors.coulomb_friction, errors.viscous_friction, armature
        set_joints(self.model, self.dof, gain * kp, gain * kd, losses)


def build_simulated_robot(
    robot: RobotModel,
    stance: Stance,
    errors: DrawnErrors,
    payload: Payload | None,
    timestep: float,
    contacts: Contacts = "default",
) -> SimulatedRobot:
    """Build the MuJoCo model of a robot, from its model file.

    Actuators, sensors, keyframes, options, friction losses and damping of the file are replaced. Only the feet (spheres) and
    the belly (a box, for lying) touch the floor.

    Args:
        stance: stance whose hip height gains scale with.
        errors: errors of drives, legs, feet and floor are built in; sensor errors are the platform's.
        timestep: time step of the engine [s].
        contacts: contact parameters of the feet, "default" or those of the "file".

    Raises:
        ModelError: MuJoCo cannot make a model of the file.
        SettingsError: the time step is too long for the contacts, the file has no contact parameters, or effects exclude each
            other.
    """
    if timestep > CONTACT_TIME / 2:
        raise SettingsError(
            f"the engine's time step is {timestep:g} s; contacts of the feet need {CONTACT_TIME / 2:g} s or less"
        )
    kp, kd = (np.full(len(robot.joint_names), gain) for gain in robot.gains(stance.hip_height))
    legs = LegErrors.of(robot, stance, errors)
    try:
        spec = _read(robot.source)
        base = _floating_base(spec)
        _strip(spec)
        _weld_locked_joints(spec, robot)
        add_contacts(spec, robot, stance, base, errors, legs, contacts)
        add_loads(spec, base, stance, errors, payload)
        if has_springs(errors):
            add_springs(spec, robot, errors, errors.sizes.armature + timestep * kd[0])
        _add_actuators_and_sensors(spec, robot, base, errors)
        set_options(spec, timestep)
        spec.option.gravity = GRAVITY * errors.gravity_direction
        if has_springs(errors) and errors.sizes.rolling_friction:
            # MuJoCo uses sparse matrices from 60 degrees of freedom; with cones of six dimensions they are faster from 30.
            spec.option.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
        model = spec.compile()
    except SettingsError:
        raise
    except ValueError as error:
        raise ModelError(f"MuJoCo cannot make a model of {str(robot.source.path)!r}: {error}") from error
    joints = np.array([model.joint(name).id for name in robot.joint_names])
    qpos, dof = model.jnt_qposadr[joints].astype(np.intp), model.jnt_dofadr[joints].astype(np.intp)
    simulated = SimulatedRobot(model, errors, qpos, dof, kp, kd, int(model.jnt_bodyid[0]), model)
    simulated.set_gains(kp, kd)
    set_springs(model, robot, errors)
    change_legs(model, robot, joints, legs, errors)
    if spin := errors.sizes.armature * errors.sizes.rotor_spin:
        simulated = dataclasses.replace(simulated, links=copy.copy(model))
        add_rotor_spin(model, joints, np.full(len(joints), spin))
    set_stops(model, robot, errors, stance.scale.torque)
    if contacts == "default":
        soften_feet(model, robot, errors)
    return simulated


def set_options(spec: mujoco.MjSpec, timestep: float) -> None:
    """Set the options of the engine; damping is not its integrator's (reason: `set_joints`).

    The search for islands (MuJoCo 3.3.6 and later) is disabled: a robot is one tree.

    Fixed links are fused, which saves up to a third of the engine's time. Older versions do not fuse: a spec that is
    compiled again counts an arm's mount twice, and MuJoCo 3.5 to 3.8 fuses rotated links wrongly.
    """
    spec.option.timestep = timestep
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    spec.option.disableflags = int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP) | _NO_ISLANDS
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = IMPRATIO
    spec.compiler.fusestatic = tuple(int(part) for part in mujoco.__version__.split(".")[:2]) >= (3, 17)


def set_joints(
    model: mujoco.MjModel,
    dof: NDArray[np.intp],
    kp: FloatArray,
    kd: FloatArray,
    losses: tuple[float | FloatArray, float | FloatArray, float],
) -> None:
    """Set PD control and losses of the joints.

    Damping D acts on the speed at the end of a step h, so that light shanks are stable: D (v + h a). The term D h a is an
    additional armature D h, which contacts and friction take into account. MuJoCo's implicit integrators add it after the
    forces are computed: feet slide, by a delay of 0.3 ms on a Go2; light shanks chatter; the accelerometer is wrong.

    Friction takes a joint's speed within a step. MuJoCo's default opposes a + b v, b = 105/s, and leads by 20 deg at 6 Hz.

    Args:
        dof: (nj,) indices of the joints in qvel.
        kp, kd: (nj,) gains as they act [Nm/rad], [Nm s/rad].
        losses: Coulomb friction [Nm] and viscous friction [Nm s/rad] of all or of each, armature [kg m2].
    """
    timestep = model.opt.timestep
    model.actuator_gainprm[:, 0] = kp
    model.actuator_biasprm[:, 1], model.actuator_biasprm[:, 2] = -kp, -kd
    model.dof_frictionloss[dof], model.dof_damping[dof], armature = losses
    model.dof_armature[dof] = armature + timestep * (kd + losses[1])
    model.dof_solref[dof] = 2 * timestep, 1.0
    model.dof_solimp[dof, :2] = IMPEDANCE


def _read(source: ModelSource) -> mujoco.MjSpec:
    """Return the file's spec without engine options and contact shapes, which are set separately."""
    root = ET.fromstring(source.xml)
    for parent in (root, *root.findall("mujoco")):
        for option in parent.findall("option"):
            parent.remove(option)
    # A link without an inertial is massless, whatever shapes it has (URDF); in MJCF its shapes give it mass.
    for link in root.findall("link"):
        for collision in link.findall("collision"):
            link.remove(collision)
        for inertial in link.findall("inertial"):
            _straighten(inertial, link.get("name", ""), source.path)
    spec = mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"))
    spec.compiler.fusestatic = False  # reason: `set_options`
    return spec


def _straighten(inertial: ET.Element, link: str, path: Path) -> None:
    """Write a URDF link's inertia in the link's own axes: MuJoCo before 3.17 reads a rotated one wrongly."""
    origin, tensor = inertial.find("origin"), inertial.find("inertia")
    if origin is None or tensor is None or "rpy" not in origin.attrib:
        return
    turn = pin.rpy.rpyToMatrix(np.array([float(word) for word in origin.attrib.pop("rpy").split()]))
    write_inertia(tensor, turn @ read_inertia(tensor, link, path) @ turn.T)


def _delete(spec: mujoco.MjSpec, element: Any) -> None:
    """Delete an element of a spec: a method of the spec since MuJoCo 3.3.1, of the element before."""
    if hasattr(spec, "delete"):
        spec.delete(element)
    else:
        element.delete()


def _floating_base(spec: mujoco.MjSpec) -> mujoco.MjsBody:
    base = spec.worldbody.first_body()
    if not any(joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in spec.joints):
        base.add_freejoint()
    # The floor is at z = 0 and the platform places the base: the file's pose of it is not used.
    return base


def _strip(spec: mujoco.MjSpec) -> None:
    """Remove the file's losses, contacts and gravity compensation."""
    for joint in spec.joints:
        joint.damping, joint.stiffness = linear(0.0, joint.damping), linear(0.0, joint.stiffness)
        joint.frictionloss = 0.0
        joint.armature = 0.0
        joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0
    for body in spec.bodies:
        body.gravcomp = 0.0


def _weld_locked_joints(spec: mujoco.MjSpec, robot: RobotModel) -> None:
    """Remove joints that do not belong to a leg, with their links at the locked positions."""
    if not robot.locked_joints:
        return
    compiled = spec.compile()
    poses: dict[int, pin.SE3] = {}
    for body in spec.bodies:
        for spec_joint in list(body.joints):
            if spec_joint.type == mujoco.mjtJoint.mjJNT_FREE or spec_joint.name in robot.joint_names:
                continue
            joint = compiled.joint(spec_joint.name)
            index = int(compiled.jnt_bodyid[joint.id])
            xyzw = np.roll(compiled.body_quat[index], -1)
            pose = poses.get(index, pin.XYZQUATToSE3(np.concatenate([compiled.body_pos[index], xyzw])))
            position = robot.locked_joints.get(spec_joint.name, 0.0)  # joints with several axes stay at zero
            poses[index] = pose = pose * _motion(joint, position)
            body.pos, body.quat = pose.translation, quat_wxyz(pose.rotation)
            body.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
            _delete(spec, spec_joint)


def _motion(joint: Any, position: float) -> pin.SE3:
    """Return the motion of a body in its own axes that a joint of the compiled model makes from zero."""
    if joint.type[0] == mujoco.mjtJoint.mjJNT_SLIDE:
        return pin.SE3(np.eye(3), position * joint.axis)
    turned = np.array(pin.exp3(position * joint.axis))
    return pin.SE3(turned, joint.pos - turned @ joint.pos)


def _add_actuators_and_sensors(
    spec: mujoco.MjSpec, robot: RobotModel, base: mujoco.MjsBody, errors: DrawnErrors
) -> None:
    """Add joint PD inside the engine (gains are set later), reported torque, and the IMU."""
    for index, joint in enumerate(robot.joint_names):
        actuator = spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        actuator.gaintype = mujoco.mjtGain.mjGAIN_FIXED
        actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        limit = robot.effort_limit[index]
        if np.isfinite(limit):
            actuator.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
            actuator.forcerange = [-limit * errors.torque_gain[index], limit * errors.torque_gain[index]]
    pose = robot.imu_in_base
    mounted = np.array(pose.rotation) @ np.array(pin.exp3(errors.drawn["imu_tilt"]))
    base.add_site(name=IMU_SITE, pos=pose.translation + errors.drawn["imu_position"], quat=quat_wxyz(mounted))
    for joint in robot.joint_names:
        spec.add_sensor(
            name=f"{joint}_torque",
            type=mujoco.mjtSensor.mjSENS_ACTUATORFRC,
            objtype=mujoco.mjtObj.mjOBJ_ACTUATOR,
            objname=joint,
        )
    spec.add_sensor(
        name=ACCELEROMETER,
        type=mujoco.mjtSensor.mjSENS_ACCELEROMETER,
        objtype=mujoco.mjtObj.mjOBJ_SITE,
        objname=IMU_SITE,
    )
