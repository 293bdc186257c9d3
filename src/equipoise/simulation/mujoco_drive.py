"""Springs and backlash behind motors of the simulated robot in MuJoCo, and friction that depends on load and rest."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from equipoise.conventions import FloatArray
from equipoise.robot.model import RobotModel
from equipoise.simulation.drawn_errors import DrawnErrors

_TEETH = 10.0  # stiffness of the stops of backlash without springs, over that of the springs in `stress`


def as_a_spring(
    stiffness: float, damping: float, timestep: float, inverse_weight: float
) -> tuple[tuple[float, float], tuple[float, float, float, float, float], float]:
    """Parameters with which a constraint pushes as a spring K with a damper D does, taken at a step's end.

    At a step's end a spring that is pressed in by r pushes with K (r + h v') + D v', v' = v + h a being the speed then. So it
    is stable however stiff it is and long the step h; it is damped by h K more, and resists acceleration with h^2 K + h D.
    MuJoCo's constraint pushes with (k r + b v + a) / R, R being (1 - d) / d times the inverse weight that it has worked out.
    With 1 / R = h^2 K + h D, k = K R and b = (h K + D) R the two are the same.

    Args:
        stiffness: stiffness K [N/m] or [Nm/rad].
        damping: damping D [Ns/m] or [Nms/rad].
        timestep: time step h [s].
        inverse_weight: inverse weight of what is pushed, as the engine's model has it [1/kg] or [1/(kg m2)].

    Returns:
        the engine's solref; its solimp; R.
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
    """A second joint behind each leg joint, about the same axis.

    The file's joint becomes the motor's side: command, encoder, torque, friction and rotor are there. The link turns by the
    sum of both.

    Args:
        armature: rotor inertia of the motors' side, as the engine is going to have it [kg m2]; a motor without any would leave
            nothing between two springs.
    """
    play = errors.sizes.backlash / 2
    for name in robot.joint_names:
        motor = spec.joint(name)
        motor.armature = armature
        # MuJoCo 4 has no parent of a joint's own; all versions have bodies that list theirs.
        body = next(body for body in spec.bodies if any(joint.name == name for joint in body.joints))
        link = body.add_joint(name=spring_name(name), type=motor.type, axis=motor.axis, pos=motor.pos)
        if play:
            link.limited, link.range = mujoco.mjtLimited.mjLIMITED_TRUE, [-play, play]


def has_springs(errors: DrawnErrors) -> bool:
    """Return whether there is compliance or backlash between motors and links."""
    return bool(errors.sizes.springs or errors.sizes.backlash)


def set_springs(model: mujoco.MjModel, robot: RobotModel, errors: DrawnErrors) -> None:
    """Stiffness of what is behind the motors, taken at a step's end (`as_a_spring` says how): stable with legs of any weight.

    With play the joint hangs free between two stops, which are the springs. The damping that comes with it, h K, is that of a
    metal part: at 2 Hz it takes 0.6 % of what the spring holds.
    """
    step = model.opt.timestep
    for name, stiffness in zip(robot.joint_names, errors.spring_stiffness, strict=True):
        if stiffness and not errors.sizes.backlash:
            joint = model.joint(spring_name(name)).id
            dof = model.jnt_dofadr[joint]
            model.jnt_stiffness[joint] = stiffness
            model.dof_damping[dof], model.dof_armature[dof] = step * stiffness, step**2 * stiffness


def set_stops(model: mujoco.MjModel, robot: RobotModel, errors: DrawnErrors, scale: float) -> None:
    """Stiffness of the stops of a play. They need the inverse weights of the whole robot, so they come last.

    Args:
        scale: the robot's torques over an A1's.
    """
    if not errors.sizes.backlash:
        return
    usual = errors.sizes.row("springs").in_stress * scale
    for name, stiffness in zip(robot.joint_names, errors.spring_stiffness, strict=True):
        joint = model.joint(spring_name(name)).id
        weight = float(model.dof_invweight0[model.jnt_dofadr[joint]])
        solref, solimp, _ = as_a_spring(stiffness or _TEETH * usual, 0.0, model.opt.timestep, weight)
        model.jnt_solref[joint], model.jnt_solimp[joint] = solref, solimp


class ChangingFriction:
    """Friction of joints that depends on the motors' torques and on their speeds: it is set before each engine step.

    That is half of what such a robot costs: what it reads of the model are views, and no step looks for them.

    Args:
        model: compiled model, whose gains may change, and whose friction does.
        dof: (nj,) indices of the leg joints in qvel; `qpos` likewise in qpos.
        errors: drawn errors of the robot.

    Attributes:
        needed: whether there is any; if not, the engine's own friction is all.
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
