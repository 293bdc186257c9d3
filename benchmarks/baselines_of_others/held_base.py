"""Legs that swing on a base at rest, as a MuJoCo model: what fits of trajectories roll out.

The model is of the robot's file, legs trusted, its base held as the accelerometer says that it lies. Joint control, friction
and integrator are those of the simulated robot, in the peers' favour.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco import rollout
from numpy.typing import NDArray

from equipoise.estimator.motors.delay import motor_trial
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.robot.model import RobotModel
from equipoise.simulation import mujoco_model
from equipoise.simulation.drawn_errors import DrawnErrors
from equipoise.simulation.effects import IDEAL

FloatArray = NDArray[np.float64]

GRAVITY = 9.81  # [m/s2]
TIMESTEP = mujoco_model.TIMESTEP  # [s]: with 1 ms delays come out 0.25 ms longer
_STILL = 25  # samples of rest from whose mean a rollout begins


@dataclass(frozen=True, eq=False)
class Swing:
    """What was commanded and seen of joints that swing, beginning at rest.

    Attributes:
        time: (n,) times of the samples [s].
        position: (n, nj) joint positions by the encoders [rad].
        torque: (n, nj) joint torques as reported [Nm]; None: they are not.
        start: (nj,) joint positions by the encoders at rest, when the first sample was taken [rad].
        sent: (m,) times of the commands, from before the first sample on [s].
        target: (m, nj) position targets, each kept until the next [rad].
        kp, kd: gains of all joints [Nm/rad], [Nm s/rad].
        gravity_in_base: (3,) [m/s2].
    """

    time: FloatArray
    position: FloatArray
    torque: FloatArray | None
    start: FloatArray
    sent: FloatArray
    target: FloatArray
    kp: float
    kd: float
    gravity_in_base: FloatArray


@dataclass(frozen=True, eq=False)
class JointParameters:
    """What a model of the joints needs besides the file.

    Attributes:
        armature: (nj,) [kg m2].
        viscous_friction: (nj,) viscous friction [Nm s/rad].
        coulomb_friction: (nj,) Coulomb friction [Nm].
        bias: (nj,) encoder reading less joint position [rad].
        gain: (nj,) true over reported torque.
        delay: of the position loop [s].
    """

    armature: FloatArray
    viscous_friction: FloatArray
    coulomb_friction: FloatArray
    bias: FloatArray
    gain: FloatArray
    delay: float

    @classmethod
    def alike(
        cls, joints: int, armature: float, viscous_friction: float, coulomb_friction: float, delay: float
    ) -> JointParameters:
        """All joints the same, encoders and gains without error."""
        one = np.ones(joints)
        return cls(armature * one, viscous_friction * one, coulomb_friction * one, 0 * one, one, delay)


def read_swing(robot: RobotModel, recording: Recording) -> Swing:
    """From the moment when the joints begin to swing until they stop."""
    trial, moving, rest = motor_trial(recording), recording.phase(Phase.RAMP, Phase.END), recording.phase(Phase.REST)
    assert recording.commands is not None
    assert trial.kp is not None
    assert trial.kd is not None
    up = np.array(robot.imu_in_base.rotation) @ rest.imu.acceleration_in_imu.mean(axis=0)
    joints, commands = moving.joints, recording.commands
    return Swing(
        joints.time, joints.position, joints.torque, rest.joints.position[-_STILL:].mean(axis=0), commands.time,
        commands.position, trial.kp, trial.kd, -GRAVITY * up / np.linalg.norm(up),
    )  # fmt: skip


class HeldBase:
    """The model, and what its encoders would have shown during a swing."""

    def __init__(self, robot: RobotModel, swing: Swing, timestep: float = TIMESTEP) -> None:
        self.swing, self.spec = swing, held_spec(robot, timestep)
        self.spec.option.gravity = swing.gravity_in_base
        self.model: mujoco.MjModel = self.spec.compile()
        joints = [self.model.joint(name).id for name in robot.joint_names]
        self.qpos, self.dof = self.model.jnt_qposadr[joints], self.model.jnt_dofadr[joints]
        self.steps = int(np.ceil(np.ptp(swing.time) / timestep))

    def model_of(self, parameters: JointParameters) -> mujoco.MjModel:
        """A model with these parameters; its control loops close on encoders."""
        model, swing, p = copy.copy(self.model), self.swing, parameters
        losses = p.coulomb_friction, p.viscous_friction, p.armature
        mujoco_model.set_joints(model, self.dof, p.gain * swing.kp, p.gain * swing.kd, losses)  # pyright: ignore
        model.actuator_biasprm[:, 0] = -p.gain * swing.kp * p.bias
        return model

    def initial(self, parameters: JointParameters) -> FloatArray:
        """The engine's state at the first sample."""
        data, kind = mujoco.MjData(self.model), mujoco.mjtState.mjSTATE_FULLPHYSICS
        data.qpos[self.qpos] = self.swing.start - parameters.bias
        state = np.zeros(mujoco.mj_stateSize(self.model, kind))
        mujoco.mj_getState(self.model, data, state, kind)
        return state

    def control(self, delay: float) -> FloatArray:
        """(steps, nj) mean over each step of the targets that have come to act [rad]: smooth in the delay."""
        swing, step = self.swing, self.model.opt.timestep
        edges = swing.time[0] + step * np.arange(self.steps + 1) - delay
        sent = np.concatenate([swing.sent, [max(swing.sent[-1], edges[-1]) + step]])
        turned = np.vstack([np.zeros_like(swing.start), np.cumsum(np.diff(sent)[:, None] * swing.target, axis=0)])
        return np.diff(np.column_stack([np.interp(edges, sent, column) for column in turned.T]), axis=0) / step

    def states(self, sets: Sequence[JointParameters]) -> FloatArray:
        """(sets, steps + 1, ...) the engine's states with each set of parameters, the initial one first."""
        first = np.array([self.initial(one) for one in sets])
        states, _ = rollout.rollout(
            [self.model_of(one) for one in sets], mujoco.MjData(self.model), first,
            np.array([self.control(one.delay) for one in sets]),
        )  # fmt: skip
        return np.concatenate([first[:, None], states], axis=1)

    def shown(self, sets: Sequence[JointParameters]) -> FloatArray:
        """(sets, n, nj) what encoders show with each set of parameters [rad]."""
        path = self.states(sets)[:, :, 1 + self.qpos]
        return self.sampled(path) + np.array([one.bias for one in sets])[:, None]

    def encoders_and_torques(self, parameters: JointParameters, states: FloatArray, target: FloatArray) -> FloatArray:
        """(steps + 1, 2 nj) positions by the encoders [rad] and torques as reported [Nm] by states of as many targets."""
        encoder, speed = states[:, 1 + self.qpos] + parameters.bias, states[:, 1 + self.model.nq + self.dof]
        return np.hstack([encoder, self.swing.kp * (target - encoder) - self.swing.kd * speed])

    def sampled(self, path: FloatArray, age: float = 0.0) -> FloatArray:
        """(..., n, nj) a path (..., steps + 1, nj) of the engine as it was `age` [s] before the samples were taken."""
        at = np.maximum(self.swing.time - self.swing.time[0] - age, 0.0) / self.model.opt.timestep
        before = np.minimum(at.astype(int), self.steps - 1)
        share = (at - before)[:, None]
        return (1 - share) * path[..., before, :] + share * path[..., before + 1, :]


def held_spec(robot: RobotModel, timestep: float) -> mujoco.MjSpec:
    """The robot of the model file whose base does not move and touches nothing."""
    spec = mujoco_model._read(robot.source)
    for joint in [one for one in spec.joints if one.type == mujoco.mjtJoint.mjJNT_FREE]:
        mujoco_model._delete(spec, joint)
    for key in list(spec.keys):
        mujoco_model._delete(spec, key)  # of a floating base
    base = spec.worldbody.first_body()
    base.pos, base.quat, base.alt.type = [0, 0, 0], [1, 0, 0, 0], mujoco.mjtOrientation.mjORIENTATION_QUAT
    mujoco_model._strip(spec)
    mujoco_model._weld_locked_joints(spec, robot)
    errors = DrawnErrors.draw(IDEAL, len(robot.joint_names), 0)
    mujoco_model._add_actuators_and_sensors(spec, robot, base, errors)
    mujoco_model.set_options(spec, timestep)
    return spec
