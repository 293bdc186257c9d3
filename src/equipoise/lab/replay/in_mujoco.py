"""Replay of motions on two feet in MuJoCo with measured joint positions and a free base.

The tipping motion then depends on the mass distribution only, without motor torques, friction or gains. The joint control is
a thousand times as stiff as the robot's own. The floor passes through both standing feet, and gravity has the direction
measured by the accelerometer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np
from mujoco import rollout
from scipy.interpolate import CubicHermiteSpline

from equipoise.conventions import GRAVITY, FloatArray
from equipoise.errors import FallError
from equipoise.estimator.measurements.lift_samples import LiftSamples
from equipoise.estimator.measurements.tilt_invariant import SensedLift, integral
from equipoise.robot.inertial import InertialParameters
from equipoise.robot.model import LEG_NAMES, RobotModel
from equipoise.robot.stance import nominal_stance
from equipoise.simulation.drawn_errors import DrawnErrors
from equipoise.simulation.effects import EffectSizes
from equipoise.simulation.mujoco_contacts import foot_name
from equipoise.simulation.mujoco_legs import set_inertia
from equipoise.simulation.mujoco_model import TIMESTEP, SimulatedRobot, build_simulated_robot

# Gains over the robot's own: joints then follow within 0.2 mrad, with about the same damping ratio.
_STIFFER, _DAMPED_MORE = 1000.0, 30.0
_PRESSED = 3e-6  # [m], penetration of standing feet
_STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS


class MujocoReplay:
    """Robot in MuJoCo without sensor or actuator errors, with its file's base or another one.

    Args:
        base: mass, CoM and inertia of the base link and the links fixed to it, in the base frame; None: the file's.
    """

    def __init__(self, robot: RobotModel, base: InertialParameters | None = None) -> None:
        stance, joints = nominal_stance(robot), len(robot.joint_names)
        perfect = DrawnErrors.draw(EffectSizes(), joints, seed=0)
        self._robot, self._simulated = robot, build_simulated_robot(robot, stance, perfect, None, TIMESTEP)
        kp, kd = robot.gains(stance.hip_height)
        self._kp, self._kd = np.full(joints, _STIFFER * kp), np.full(joints, _DAMPED_MORE * kd)
        self._simulated.set_gains(self._kp, self._kd)
        self._model = self._simulated.model
        self._model.actuator_forcelimited[:] = 0
        if base is not None:
            _replace_base(self._simulated, base)
        mujoco.mj_setConst(self._model, mujoco.MjData(self._model))  # contact stiffness depends on masses and gains
        self._data, self._rollout = mujoco.MjData(self._model), rollout.Rollout(nthread=0)
        self._feet = [self._model.geom(foot_name(leg)).id for leg in LEG_NAMES]

    def tilt_error(self, joint_names: Sequence[str], lift: LiftSamples, sensed: SensedLift) -> tuple[FloatArray, float]:
        """Return (n,) measured minus simulated tilt in a lift [rad], and the largest joint position error [rad].

        Args:
            joint_names: names of the recorded joint columns.

        Raises:
            FallError: the simulation became unstable.
        """
        columns = [joint_names.index(name) for name in self._robot.joint_names]
        motion = replace(
            sensed, joint_position=sensed.joint_position[:, columns], joint_velocity=sensed.joint_velocity[:, columns]
        )
        angular_velocity, joint_error = self.play(lift.stance_feet, lift.step, motion)
        difference = sensed.angular_velocity_base_in_base - angular_velocity
        about_line = np.einsum("ni,ni->n", sensed.line_in_base, difference)
        return np.asarray(integral(len(difference), lift.step) @ about_line, dtype=float), joint_error

    def play(self, stance_feet: tuple[int, int], step: float, motion: SensedLift) -> tuple[FloatArray, float]:
        """Play a motion from its first sample to its last.

        Args:
            stance_feet: indices of the left and the right standing foot among FL FR RL RR.
            step: time between samples [s].
            motion: joint motion in the model's order, and state of the base at the first sample.

        Returns:
            (n, 3) angular velocity of the base in base axes at the motion's samples [rad/s], and the largest joint position
            error [rad].

        Raises:
            FallError: the simulation became unstable.
        """
        self._begin(stance_feet, motion)
        model, data = self._model, self._data
        measured: FloatArray = np.asarray(step * np.arange(len(motion.joint_position)), dtype=float)
        steps = int(np.ceil(measured[-1] / TIMESTEP))
        time: FloatArray = np.asarray(TIMESTEP * np.arange(steps + 1), dtype=float)
        joints = CubicHermiteSpline(measured, motion.joint_position, motion.joint_velocity)
        sampled = np.minimum(time, measured[-1])
        position, velocity = joints(sampled), joints(sampled, 1)
        # MuJoCo's damping acts on the velocity at the end of a step.
        control = position[:-1] + velocity[1:] * self._kd / self._kp
        initial = np.zeros(mujoco.mj_stateSize(model, _STATE))
        mujoco.mj_getState(model, data, initial, _STATE)
        states, _ = self._rollout.rollout(
            [model], [data], initial[None], control[None], initial_warmstart=np.array(data.qacc_warmstart)[None]
        )
        path: FloatArray = np.concatenate([initial[None], np.asarray(states[0], dtype=float)])
        if not (np.diff(path[:, 0]) > 0).all():  # the engine restarts at time zero when it diverges
            raise FallError(f"the replay of {self._robot.name!r} became unstable; check its inertias")
        speeds = path[:, 1 + int(model.nq) :][:, 3:6]
        turning = np.column_stack([np.interp(measured, time, speeds[:, axis]) for axis in range(3)])
        missed = np.abs(path[:, 1 + self._simulated.qpos] - position).max()
        return turning, float(missed)

    def _begin(self, stance_feet: tuple[int, int], motion: SensedLift) -> None:
        """Set the initial state, with two rolling feet on the floor."""
        model, data, feet = self._model, self._data, [self._feet[foot] for foot in stance_feet]
        mujoco.mj_resetData(model, data)
        data.qpos[:7] = [0, 0, 0, 1, 0, 0, 0]
        data.qpos[self._simulated.qpos] = motion.joint_position[0]
        mujoco.mj_kinematics(model, data)
        left, right = np.array(data.geom_xpos[feet])
        up = motion.up_in_base[0]
        base_to_floor = _onto_the_floor((left - right) / np.linalg.norm(left - right), up)
        mujoco.mju_mat2Quat(data.qpos[3:7], base_to_floor.reshape(9).copy())
        model.opt.gravity[:] = -GRAVITY * base_to_floor @ up
        mujoco.mj_kinematics(model, data)
        contacts = np.array(data.geom_xpos[feet]) - model.geom_size[feet, :1] * [0, 0, 1]
        data.qpos[2] -= contacts[:, 2].min() + _PRESSED
        data.qvel[3:6] = motion.angular_velocity_base_in_base[0]
        data.qvel[self._simulated.dof] = motion.joint_velocity[0]
        mujoco.mj_forward(model, data)
        data.qvel[:3] = -np.mean([self._velocity(foot) for foot in feet], axis=0)
        mujoco.mj_forward(model, data)

    def _velocity(self, foot: int) -> FloatArray:
        """Return the (3,) velocity of a foot's contact point [m/s]."""
        model, data, jacobian = self._model, self._data, np.zeros((3, self._model.nv))
        point = data.geom_xpos[foot] - [0, 0, model.geom_size[foot, 0]]
        mujoco.mj_jac(model, data, jacobian, None, point, model.geom_bodyid[foot])
        return np.asarray(jacobian @ data.qvel, dtype=float)


def _onto_the_floor(line: FloatArray, up: FloatArray) -> FloatArray:
    """Return the (3, 3) rotation from base axes to those of the most level floor that contains a line."""
    normal = up - (up @ line) * line
    normal /= np.linalg.norm(normal)
    return np.array([np.cross(line, normal), line, normal])


def _replace_base(simulated: SimulatedRobot, base: InertialParameters) -> None:
    """Set the inertial parameters of the base body, and zero those of the bodies fixed to it."""
    model, body = simulated.model, simulated.base_body
    fixed = model.body_weldid == model.body_weldid[body]
    model.body_mass[fixed] = 0.0
    model.body_inertia[fixed] = 0.0
    model.body_mass[body], model.body_ipos[body] = base.mass, base.com
    set_inertia(model, body, base.inertia)
    model.body_sameframe[:] = 0  # flags of equal frames, which the compiler sets once
