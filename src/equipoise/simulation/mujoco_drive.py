"""Springs and backlash behind motors of the simulated robot in MuJoCo, and friction that depends on load and rest."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from equipoise.conventions import FloatArray
from equipoise.robot.model import RobotModel
from equipoise.simulation.drawn_errors import DrawnErrors

_TEETH = 10.0  # stiffness of the stops of backlash without springs, over that of the springs in `stress`


def spring_constraint(
    stiffness: float, damping: float, timestep: float, inverse_weight: float
) -> tuple[tuple[float, float], tuple[float, float, float, float, float], float]:
    """Return constraint parameters equivalent to a spring K with a damper D, evaluated at a step's end.

    At a step's end a spring compressed by r exerts K (r + h v') + D v', where v' = v + h a is
    the speed then. It is stable for any stiffness and step h, adds damping h K, and adds inertia h^2 K + h D.
    MuJoCo's constraint exerts (k r + b v + a) / R, where R is (1 - d) / d times its inverse weight.
    With 1 / R = h^2 K + h D, k = K R and b = (h K + D) R the two are the same.

    Args:
        stiffness: stiffness K [N/m] or [Nm/rad].
        damping: damping D [Ns/m] or [Nms/rad].
        timestep: time step h [s].
        inverse_weight: inverse weight of the pushed body in the engine's model [1/kg] or [1/(kg m2)].

    Returns:
        the engine's solref, its solimp, and R.
    """
    softness = 1 / (timestep**2 * stiffness + timestep * damping)
    impedance = inverse_weight / (softness + inverse_weight)
    # The engine divides these parameters by the impedance.
    solref = -impedance * stiffness * softness, -impedance * (timestep * stiffness + damping) * softness
    return solref, (impedance, impedance, 0.001, 0.5, 2.0), softness


def spring_name(joint: str) -> str:
    """Return the name of the joint behind a motor."""
    return f"equipoise_{joint}_spring"


def add_springs(spec: mujoco.MjSpec, robot: RobotModel, errors: DrawnErrors, armature: float) -> None:
    """Add a second joint behind each leg joint, about the same axis.

    The file's joint becomes the motor's side: command, encoder, torque, friction and rotor are there. The link turns by the
    sum of both.

    Args:
        armature: rotor inertia of the motors' side in the engine [kg m2]; it must not be zero.
    """
    half_backlash = errors.sizes.backlash / 2
    for name in robot.joint_names:
        motor = spec.joint(name)
        motor.armature = armature
        # MuJoCo 4 has no parent of a joint's own; all versions have bodies that list theirs.
        body = next(body for body in spec.bodies if any(joint.name == name for joint in body.joints))
        link = body.add_joint(name=spring_name(name), type=motor.type, axis=motor.axis, pos=motor.pos)
        if half_backlash:
            link.limited, link.range = mujoco.mjtLimited.mjLIMITED_TRUE, [-half_backlash, half_backlash]


def has_springs(errors: DrawnErrors) -> bool:
    """Return whether there is compliance or backlash between motors and links."""
    return bool(errors.sizes.springs or errors.sizes.backlash)


def set_springs(model: mujoco.MjModel, robot: RobotModel, errors: DrawnErrors) -> None:
    """Set the stiffness of the springs, evaluated at a step's end (`spring_constraint`): stable with legs of any weight.

    With backlash the joint is free between two stops, which are the springs. The damping h K that results is that of a
    metal part: at 2 Hz it is 0.6 % of the spring's torque.
    """
    step = model.opt.timestep
    for name, stiffness in zip(robot.joint_names, errors.spring_stiffness, strict=True):
        if stiffness and not errors.sizes.backlash:
            joint = model.joint(spring_name(name)).id
            dof = model.jnt_dofadr[joint]
            model.jnt_stiffness[joint] = stiffness
            model.dof_damping[dof], model.dof_armature[dof] = step * stiffness, step**2 * stiffness


def set_stops(model: mujoco.MjModel, robot: RobotModel, errors: DrawnErrors, scale: float) -> None:
    """Set the stiffness of the stops of a backlash, after all else: it needs the inverse weights of the whole robot.

    Args:
        scale: the robot's torques over an A1's.
    """
    if not errors.sizes.backlash:
        return
    usual = errors.sizes.row("springs").in_stress * scale
    for name, stiffness in zip(robot.joint_names, errors.spring_stiffness, strict=True):
        joint = model.joint(spring_name(name)).id
        weight = float(model.dof_invweight0[model.jnt_dofadr[joint]])
        solref, solimp, _ = spring_constraint(stiffness or _TEETH * usual, 0.0, model.opt.timestep, weight)
        model.jnt_solref[joint], model.jnt_solimp[joint] = solref, solimp


class ChangingFriction:
    """Joint friction that depends on motor torques and speeds, set before each engine step.

    It takes half of the simulation time, so views of the model's arrays are kept.

    Args:
        model: compiled model; its friction is changed at each step.
        dof: (nj,) indices of the leg joints in qvel; `qpos` likewise in qpos.
        errors: drawn errors of the robot.

    Attributes:
        needed: whether the engine's own friction is insufficient.
    """

    def __init__(
        self, model: mujoco.MjModel, dof: NDArray[np.intp], qpos: NDArray[np.intp], errors: DrawnErrors
    ) -> None:
        self.needed = bool(errors.sizes.load_friction or errors.sizes.stribeck)
        self._dof, self._qpos, self._errors = dof, qpos, errors
        self._friction: FloatArray = model.dof_frictionloss
        self._kp, self._minus_kd = model.actuator_gainprm[:, 0], model.actuator_biasprm[:, 2]
        limited = model.actuator_forcelimited.astype(bool)
        self._least = np.where(limited, model.actuator_forcerange[:, 0], -np.inf)
        self._most = np.where(limited, model.actuator_forcerange[:, 1], np.inf)

    def act(self, data: mujoco.MjData) -> None:
        """Set the friction of the step that begins now; data.ctrl is that step's."""
        speed = data.qvel[self._dof]
        self._friction[self._dof] = self._errors.sliding_friction(speed, self._motor_torque(data, speed))

    def _motor_torque(self, data: mujoco.MjData, speed: FloatArray) -> FloatArray:
        """Return (nj,) true torques of the motors at a state [Nm]."""
        torque = data.ctrl - data.qpos[self._qpos]
        torque *= self._kp
        torque += self._minus_kd * speed
        return np.minimum(np.maximum(torque, self._least), self._most)
