"""Simulated robot in MuJoCo: joint PD inside the engine, motions rolled out at the engine's speed."""

from __future__ import annotations

import mujoco
import numpy as np
from mujoco import rollout

from equipoise.conventions import FloatArray
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance
from equipoise.simulation.mujoco_contacts import floors_of_feet, foothold_heights
from equipoise.simulation.mujoco_drive import ChangingFriction
from equipoise.simulation.mujoco_model import ACCELEROMETER, IMU_SITE, SimulatedRobot
from equipoise.simulation.simulated import SimulatedPlatform, Start
from equipoise.small_arrays import all_of, any_of

_PRESSED = 1e-6  # [m]: largest penetration of the floor when a robot is placed
_STATE, _WHOLE_STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS, mujoco.mjtState.mjSTATE_INTEGRATION
_CONTROL, _PUSHED = int(mujoco.mjtState.mjSTATE_CTRL), int(mujoco.mjtState.mjSTATE_XFRC_APPLIED)


class MujocoPlatform(SimulatedPlatform):
    """A quadruped in MuJoCo.

    Args:
        robot: model that the estimator has; the simulated robot may differ from it by its errors and payload.
        simulated: model of the engine.
        stance: nominal stance, in which (or lying under which) the robot starts.
        start: posture at the start, "standing" or "lying".
        control_period: time between commands [s]; a multiple of the engine's time step.
        data: state of the engine, for observers that share it; its external forces remain applied; default: a new one.
    """

    def __init__(
        self,
        robot: RobotModel,
        simulated: SimulatedRobot,
        stance: Stance,
        start: Start = "standing",
        control_period: float = 2e-3,
        data: mujoco.MjData | None = None,
    ) -> None:
        self._simulated = simulated
        self._model = simulated.model
        self._gains = np.full((2, len(robot.joint_names)), np.nan)  # last ones set in the engine
        super().__init__(robot, simulated.errors, simulated.kp, simulated.kd, self._model.opt.timestep, control_period)
        self._data = mujoco.MjData(self._model) if data is None else data
        self._ahead = mujoco.MjData(self._model)  # scratch: one engine step beyond the present
        self._state_size = mujoco.mj_stateSize(self._model, _STATE)
        self._whole_state = np.empty(mujoco.mj_stateSize(self._model, _WHOLE_STATE))
        self._rollout = rollout.Rollout(nthread=0)
        self._friction = ChangingFriction(self._model, simulated.dof, simulated.qpos, simulated.errors)
        # Columns of a state, after its time: leg joints; their velocities and the base's angular velocity.
        self._positions = 1 + simulated.qpos
        self._speeds = 1 + self._model.nq + np.append(simulated.dof, [3, 4, 5])
        self._imu_rotation = np.zeros(9)
        mujoco.mju_quat2Mat(self._imu_rotation, self._model.site(IMU_SITE).quat)
        self._imu_rotation = self._imu_rotation.reshape(3, 3)
        address = self._model.sensor(ACCELEROMETER).adr[0]
        self._accelerometer = slice(address, address + 3)
        self._floors, self._heading = floors_of_feet(self._model, robot, simulated.errors), 0.0
        self._settle(stance, start)

    def close(self) -> None:
        super().close()
        self._rollout.close()

    def _push(self, force_in_world: FloatArray) -> None:
        """Apply a (3,) force [N] at the base's CoM from now on, in addition to the cable's."""
        self._data.xfrc_applied[self._simulated.base_body, :3] = self._errors.cable_in_world + force_in_world

    def _place(self, joint_position: FloatArray, base_height: float) -> None:
        data, model = self._data, self._model
        data.qpos[:] = model.qpos0
        data.qpos[:7] = [0, 0, base_height, 1, 0, 0, 0]
        data.qpos[self._simulated.qpos] = joint_position
        mujoco.mj_forward(model, data)
        deepest = min((float(contact.dist) for contact in data.contact), default=0.0)
        if deepest < -_PRESSED:  # feet or footholds differ from the estimator's model
            data.qpos[2] -= deepest
            mujoco.mj_forward(model, data)
        self._push(np.zeros(3))

    def _turn_by(self, angle: float) -> None:
        data, turn = self._data, np.zeros(4)
        mujoco.mju_axisAngle2Quat(turn, np.array([0.0, 0, 1]), angle)
        mujoco.mju_mulQuat(data.qpos[3:7], turn, data.qpos[3:7].copy())
        mujoco.mju_rotVecQuat(data.qvel[:3], data.qvel[:3].copy(), turn)
        self._heading += angle
        self._model.geom_pos[self._floors, 2] = foothold_heights(self._simulated.errors, self._heading)

    def _set_clock_to_zero(self) -> None:
        self._data.time = 0.0

    def _base_up(self) -> float:
        up = np.zeros(3)
        mujoco.mju_rotVecQuat(up, np.array([0.0, 0, 1]), self._data.qpos[3:7])
        return float(up[2])

    def _set_gains(self, kp: FloatArray | None, kd: FloatArray | None) -> None:
        super()._set_gains(kp, kd)
        if any_of(self._kp != self._gains[0]) or any_of(self._kd != self._gains[1]):
            self._gains = np.array([self._kp, self._kd])  # the caller may change its arrays
            self._simulated.set_gains(*self._gains)

    def _run(self, control: FloatArray, raw: FloatArray) -> None:
        data, model, joints = self._data, self._model, self._model.nu
        path = np.empty((len(control) + 1, self._state_size))  # the state before each step, and after the last
        mujoco.mj_getState(model, data, path[0], _STATE)
        sensors = self._stepped(path, control) if self._friction.needed else self._rolled(path, control)
        # The engine restarts at time zero when it diverges.
        if not all_of(path[1:, 0] > path[:-1, 0]):
            raise self._became_unstable(path[0, 0])
        mujoco.mj_setState(model, data, path[-1], _STATE)
        # The engine's velocity belongs to the middle of the step before a state: the mean of two belongs to the state.
        speeds = path.take(self._speeds, axis=1)
        means = (speeds[1:] + speeds[:-1]) / 2
        raw[:, :joints] = path[:-1].take(self._positions, axis=1)
        raw[:, joints : 2 * joints] = means[:, :joints]
        raw[:, 2 * joints : -6] = self._reported_torque(sensors[:, :joints], (speeds[1:] - speeds[:-1])[:, :joints])
        raw[:, -6:-3] = means[:, joints:] @ self._imu_rotation
        raw[:, -3:] = sensors[:, self._accelerometer]

    def _rolled(self, path: FloatArray, control: FloatArray) -> FloatArray:
        """Fill in the states after each step; return the engine's (n, ...) sensor values at its start."""
        steps = len(control)
        sensors, inputs = np.empty((1, steps, self._model.nsensordata)), _CONTROL
        pushes = self._data.xfrc_applied.ravel()
        if any_of(pushes != 0):
            inputs |= _PUSHED
            control = np.concatenate([control, np.broadcast_to(pushes, (steps, pushes.size))], axis=1)
        self._rollout.rollout(
            [self._model],
            [self._data],
            path[:1],
            np.ascontiguousarray(control)[None],
            control_spec=inputs,
            skip_checks=True,  # the checks take a fifth of the time of a short rollout
            nstep=steps,
            initial_warmstart=np.array(self._data.qacc_warmstart)[None],
            state=path[None, 1:],
            sensordata=sensors,
        )
        return sensors[0]

    def _stepped(self, path: FloatArray, control: FloatArray) -> FloatArray:
        """Roll out step by step, for inputs that must be set before each step."""
        data, model = self._data, self._model
        sensors = np.empty((len(control), model.nsensordata))
        warm = np.array(data.qacc_warmstart)
        try:
            commanded, sensed = data.ctrl, data.sensordata
            for row, state, seen in zip(control, path[1:], sensors, strict=True):
                commanded[:] = row
                self._friction.act(data)
                mujoco.mj_step(model, data)
                mujoco.mj_getState(model, data, state, _STATE)
                seen[:] = sensed
        except BaseException:
            mujoco.mj_setState(model, data, path[0], _STATE)
            data.qacc_warmstart[:] = warm
            raise
        return sensors

    def _raw_now(self) -> FloatArray:
        data, model, simulated = self._data, self._model, self._simulated
        ahead, state = self._ahead, self._whole_state
        mujoco.mj_getState(model, data, state, _WHOLE_STATE)
        mujoco.mj_setState(model, ahead, state, _WHOLE_STATE)
        if len(self._late_control):
            ahead.ctrl[:] = self._late_control[0]
        if self._friction.needed:
            self._friction.act(ahead)
        mujoco.mj_step(model, ahead)
        before, after = data.qvel, ahead.qvel
        velocity = (before + after) / 2
        return np.concatenate(
            [
                data.qpos[simulated.qpos],
                velocity[simulated.dof],
                self._reported_torque(ahead.sensordata[: model.nu], (after - before)[simulated.dof]),
                velocity[3:6] @ self._imu_rotation,
                ahead.sensordata[self._accelerometer],
            ]
        )

    def _reported_torque(self, torque: FloatArray, speed_change: FloatArray) -> FloatArray:
        """Return (..., nj) reported torques, with the damping at a step's end and the motors' limits."""
        damped = torque / self._errors.torque_gain - self._kd * speed_change
        return np.minimum(np.maximum(damped, -self._robot.effort_limit), self._robot.effort_limit)
