"""What the simulated robot really weighs: computed from the engine's model, by no code that an estimator uses."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from equipoise.platforms.mujoco_model import SimulatedRobot
from equipoise.robot.inertial import InertialParameters, RobotInertia
from equipoise.robot.model import RobotModel

FloatArray = NDArray[np.float64]


def simulated_truth(robot: RobotModel, simulated: SimulatedRobot, joint_position: FloatArray) -> RobotInertia:
    """The truth at a stance, payload and leg errors included; `robot` only tells which joints are knees.

    Args:
        joint_position: (nj,) true joint positions of the stance [rad].
    """
    model = simulated.model
    data = mujoco.MjData(model)
    data.qpos[:7] = [0, 0, 0, 1, 0, 0, 0]
    data.qpos[simulated.qpos] = joint_position
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    base_weld = model.body_weldid[simulated.base_body]
    knees = [model.jnt_bodyid[model.joint(leg.joint_names[-1]).id] for leg in robot.legs.values()]
    below_knee = np.isin(model.body_weldid, model.body_weldid[knees])
    moving = np.arange(model.nbody) > 0
    return RobotInertia(
        composite=_sum(model, data, moving),
        base=_sum(model, data, model.body_weldid == base_weld),
        stance_effective=_sum(model, data, moving & ~below_knee),
    )


def _sum(model: mujoco.MjModel, data: mujoco.MjData, bodies: NDArray[np.bool_]) -> InertialParameters:
    """The bodies as one, by the parallel axis theorem."""
    masses = model.body_mass[bodies]
    positions = data.xipos[bodies]
    axes = data.ximat[bodies].reshape(-1, 3, 3)
    com = masses @ positions / masses.sum()
    inertia = np.einsum("bij,bj,bkj->ik", axes, model.body_inertia[bodies], axes)
    arms = positions - com
    inertia += np.einsum("b,bk,bk->", masses, arms, arms) * np.eye(3) - np.einsum("b,bi,bj->ij", masses, arms, arms)
    return InertialParameters(float(masses.sum()), com, inertia)
