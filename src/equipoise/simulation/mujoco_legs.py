"""Legs of the simulated robot in MuJoCo that differ from the model's, and rotors that spin in them."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from equipoise.conventions import FloatArray
from equipoise.robot.model import RobotModel
from equipoise.simulation.drawn_errors import DrawnErrors
from equipoise.simulation.leg_errors import LegErrors
from equipoise.simulation.mujoco_contacts import foot_geoms

Ids = NDArray[np.intp]


def change_legs(model: mujoco.MjModel, robot: RobotModel, joints: Ids, legs: LegErrors, errors: DrawnErrors) -> None:
    """Change masses, CoMs, lengths and axes of the moving leg links and of all bodies fixed to them.

    Hips are shifted in the base link's frame. Bodies fixed to a link move with its CoM alone: a longer calf has its foot
    farther out and the same mass.

    Args:
        joints: (nj,) ids of the leg joints.
    """
    for index, joint in enumerate(joints):
        on_link = model.body_weldid == model.body_weldid[model.jnt_bodyid[joint]]
        model.body_mass[on_link] *= errors.leg_mass_scale[index]
        model.body_inertia[on_link] *= errors.leg_mass_scale[index] * errors.leg_inertia_scale[index]
    if any(shift.any() for shift in (legs.com_shift, legs.end_shift, legs.hip_shift, legs.axis_turn)):
        _move(model, robot, joints, legs)
    mujoco.mj_setConst(model, mujoco.MjData(model))


def _move(model: mujoco.MjModel, robot: RobotModel, joints: Ids, legs: LegErrors) -> None:
    _clear_shared_frames(model)
    turn = _turns(model)
    bodies = model.jnt_bodyid[joints]
    for body, shift in zip(bodies, legs.com_shift, strict=True):
        for part in np.flatnonzero(model.body_weldid == model.body_weldid[body]):
            model.body_ipos[part] += turn(int(body), int(part)) @ shift
    base = int(model.jnt_bodyid[0])
    for leg, hip in zip(robot.legs.values(), legs.hip_shift, strict=True):
        own = [int(bodies[joint]) for joint in leg.joints]
        model.body_pos[own[0]] += turn(base, int(model.body_parentid[own[0]])) @ hip
        for above, below, joint in zip(own[:-1], own[1:], leg.joints[:-1], strict=True):
            model.body_pos[below] += turn(above, int(model.body_parentid[below])) @ legs.end_shift[joint]
        for foot in foot_geoms(model, leg.name):
            model.geom_pos[foot] += turn(own[-1], int(model.geom_bodyid[foot])) @ legs.end_shift[leg.joints[-1]]
    for joint, rotation in zip(joints, legs.axis_turn, strict=True):
        model.jnt_axis[joint] = np.array(pin.exp3(rotation)) @ model.jnt_axis[joint]


def _turns(model: mujoco.MjModel) -> Callable[[int, int], FloatArray]:
    """Return a function for the (3, 3) rotation from one body's axes to another's, joints at zero."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    axes = np.array(data.xmat).reshape(-1, 3, 3)
    return lambda of, into: axes[into].T @ axes[of]


def _clear_shared_frames(model: mujoco.MjModel) -> None:
    """Clear the compiler's flags for shared frames and its bounding boxes, which do not follow later changes."""
    for flags in (model.body_sameframe, model.geom_sameframe, model.site_sameframe):
        flags[:] = 0
    model.opt.disableflags = int(model.opt.disableflags) | int(mujoco.mjtDisableBit.mjDSBL_MIDPHASE)


def add_rotor_spin(model: mujoco.MjModel, joints: Ids, inertia: FloatArray) -> None:
    """Add the reaction of the spinning rotors to the links that carry the motors.

    A rotor of inertia I_r behind a gear of ratio N turns by N q' in the link that carries it, whose angular velocity about the
    joint's axis a is w. Its energy is I_r (N q' + w)^2 / 2. An armature A = N^2 I_r has the first square, and the link's own
    inertia the last; MuJoCo omits B q' w, B = A / N. The moved link turns by w + q', so the
    term equals an inertia B about a, added to the moved link and subtracted from its carrier and from the armature. With
    locked joints, the robot's inertia is unchanged.

    The bending of springs, a hundredth of the joints' motion, is neglected.

    Args:
        joints: (nj,) ids of the leg joints.
        inertia: (nj,) inertia B of each [kg m2].
    """
    _clear_shared_frames(model)
    turn = _turns(model)
    for joint, spin in zip(joints, inertia, strict=True):
        body = int(model.jnt_bodyid[joint])
        carrier = int(model.body_parentid[body])
        axis = np.array(model.jnt_axis[joint])
        _add_inertia(model, body, spin * np.outer(axis, axis))
        axis = turn(body, carrier) @ axis
        _add_inertia(model, carrier, -spin * np.outer(axis, axis))
    mujoco.mj_setConst(model, mujoco.MjData(model))


def _add_inertia(model: mujoco.MjModel, body: int, tensor: FloatArray) -> None:
    """Add a (3, 3) tensor in a body's axes to its inertia."""
    axes = np.zeros(9)
    mujoco.mju_quat2Mat(axes, model.body_iquat[body])
    axes = axes.reshape(3, 3)
    set_inertia(model, body, axes @ np.diag(model.body_inertia[body]) @ axes.T + tensor)


def set_inertia(model: mujoco.MjModel, body: int, tensor: FloatArray) -> None:
    """Give a body a (3, 3) inertia about its CoM, in its own axes [kg m2]."""
    moments, principal = np.linalg.eigh(tensor)
    principal[:, 2] *= np.sign(np.linalg.det(principal))
    model.body_inertia[body] = moments
    mujoco.mju_mat2Quat(model.body_iquat[body], principal.reshape(9).copy())
