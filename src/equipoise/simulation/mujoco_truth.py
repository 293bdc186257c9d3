"""True parameters and states of the robot in MuJoCo: computed from the engine's model, without code of the estimators."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
from numpy.typing import NDArray

from equipoise.conventions import FloatArray
from equipoise.robot.inertial import InertialParameters, RobotInertia
from equipoise.robot.links import link_names
from equipoise.robot.model import RobotModel
from equipoise.simulation.ground_truth_view import GroundTruth
from equipoise.simulation.leg_errors import in_frame_of_hips
from equipoise.simulation.mujoco_contacts import floors_of_feet, foot_name
from equipoise.simulation.mujoco_loads import SWINGING_LOAD, WATER
from equipoise.simulation.mujoco_model import SimulatedRobot


def simulated_truth(robot: RobotModel, simulated: SimulatedRobot, joint_position: FloatArray) -> RobotInertia:
    """Return the true inertias at a stance, payload and leg errors included; `robot` only determines the knee joints.

    The hips define the base frame. Springs are undeflected. A swinging load is part of the base and counts at the hook of
    its string, where its force acts; water in a payload is at rest.

    Args:
        joint_position: (nj,) true joint positions of the stance [rad].
    """
    model = simulated.links
    data = mujoco.MjData(model)
    data.qpos[:7] = [0, 0, 0, 1, 0, 0, 0]
    data.qpos[simulated.qpos] = joint_position
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    names = np.array([model.body(body).name for body in range(model.nbody)])
    data.xipos[names == SWINGING_LOAD] = data.xpos[names == SWINGING_LOAD]
    on_base = model.body_weldid == model.body_weldid[simulated.base_body]
    on_base |= np.isin(names, (SWINGING_LOAD, WATER))
    knees = [model.jnt_bodyid[model.joint(leg.joint_names[-1]).id] for leg in robot.legs.values()]
    below_knee = np.isin(model.body_weldid, model.body_weldid[knees])
    moving = np.arange(model.nbody) > 0

    def inertia_of(bodies: NDArray[np.bool_]) -> InertialParameters:
        return in_frame_of_hips(_sum(model, data, bodies), simulated.errors)

    return RobotInertia(
        composite=inertia_of(moving), base=inertia_of(on_base), stance_effective=inertia_of(moving & ~below_knee)
    )


def link_truth(robot: RobotModel, simulated: SimulatedRobot) -> dict[str, dict[str, float]]:
    """Mass, first moment about its joint and length of each moving leg link by its name; `robot` determines the links."""
    model = simulated.links
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    names, found = link_names(robot.full_pinocchio), dict[str, dict[str, float]]()
    for leg in robot.legs.values():
        joints = [model.joint(name).id for name in leg.joint_names]
        ends = [*data.xanchor[joints[1:]], data.geom_xpos[model.geom(foot_name(leg.name)).id]]
        for name, joint, end in zip(leg.joint_names, joints, ends, strict=True):
            body, anchor, axis = model.jnt_bodyid[joint], data.xanchor[joint], data.xaxis[joint]
            fixed = model.body_weldid == model.body_weldid[body]
            masses, places = model.body_mass[fixed], data.xipos[fixed] - anchor
            moment = data.xmat[body].reshape(3, 3).T @ (masses @ places)
            link = names[robot.full_pinocchio.getJointId(name)]
            across = np.linalg.norm(np.cross(axis, end - anchor))
            found[link] = {"mass": float(masses.sum()), "length": float(across)}
            found[link] |= {f"moment_{xyz}": float(value) for xyz, value in zip("xyz", moment, strict=True)}
    return found


def _sum(model: mujoco.MjModel, data: mujoco.MjData, bodies: NDArray[np.bool_]) -> InertialParameters:
    """Return the bodies as one, by the parallel axis theorem."""
    masses = model.body_mass[bodies]
    positions = data.xipos[bodies]
    axes = data.ximat[bodies].reshape(-1, 3, 3)
    com = masses @ positions / masses.sum()
    inertia = np.einsum("bij,bj,bkj->ik", axes, model.body_inertia[bodies], axes)
    arms = positions - com
    inertia += np.einsum("b,bk,bk->", masses, arms, arms) * np.eye(3) - np.einsum("b,bi,bj->ij", masses, arms, arms)
    return InertialParameters(float(masses.sum()), com, inertia)


def ground_truth_of(robot: RobotModel, simulated: SimulatedRobot, present: mujoco.MjData) -> Callable[[], GroundTruth]:
    """Return a function for the true state of the simulated robot at the present moment, for evaluation only.

    Args:
        present: state of the engine that the platform moves.
    """
    model, base = simulated.model, simulated.base_body
    data = mujoco.MjData(model)
    feet = [model.geom(foot_name(leg)).id for leg in robot.legs]
    floors = floors_of_feet(model, robot, simulated.errors)
    up = -np.array(simulated.errors.gravity_direction)

    def look() -> GroundTruth:
        data.qpos[:] = present.qpos
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        centres = np.array(data.geom_xpos[feet])
        cosine = float(data.xmat[base].reshape(3, 3)[:, 2] @ up)
        return GroundTruth(
            float(present.time),
            centres,
            centres[:, 2] - model.geom_size[feet, 0] - model.geom_pos[floors, 2],
            np.array(data.subtree_com[0]),
            up,
            float(np.arccos(np.clip(cosine, -1, 1))),
        )

    return look
