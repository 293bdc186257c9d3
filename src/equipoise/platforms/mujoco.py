"""The simulated robot as a platform: joint PD inside the engine, motions rolled out at the engine's own speed."""

from __future__ import annotations

from typing import Literal

import mujoco
import numpy as np
from mujoco import rollout
from numpy.typing import NDArray

from equipoise.errors import FallError, MotionError, SettingsError
from equipoise.platforms.disturbance import Disturbance
from equipoise.platforms.mujoco_model import ACCELEROMETER, IMU_SITE, SimulatedRobot
from equipoise.platforms.platform import (
    ACCEPTS_EVERYTHING,
    JointCommand,
    MotionInterrupted,
    RobotState,
    TiltLimit,
    Trajectory,
    started_events,
)
from equipoise.recordings.recording import CommandStream, ImuStream, JointStream, Recording
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance, lying_posture

FloatArray = NDArray[np.float64]

_STATE, _WHOLE_STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS, mujoco.mjtState.mjSTATE_INTEGRATION
_SETTLING_TIME = 1.5  # [s] before time zero, so that a calibration does not start with a drop
_LEAST_KP = 1e-6  # [Nm/rad]: torques act through the gain, also those of a joint without one
# Control periods rolled out at once: few where a stop rule is to be tested, else as many as Ctrl-C may wait for.
PERIODS_BETWEEN_STOP_TESTS, _CHUNK = 30, 500


class MujocoPlatform:
    """A quadruped in MuJoCo. It shows what hardware shows: encoders, reported torques, gyroscope and accelerometer.

    Args:
        robot: what the estimator knows; the simulated robot may differ from it by its errors and payload.
        simulated: the engine's model.
        stance: the nominal stance, in which (or lying under which) the robot starts.
        start: "standing" or "lying".
        control_period: [s]; a multiple of the engine's time step.
        data: the engine's state, for those who also watch the simulation from outside; default: one of its own.
        disturbance: what acts on the robot from outside.
    """

    def __init__(
        self,
        robot: RobotModel,
        simulated: SimulatedRobot,
        stance: Stance,
        start: Literal["standing", "lying"] = "standing",
        control_period: float = 2e-3,
        data: mujoco.MjData | None = None,
        disturbance: Disturbance | None = None,
    ) -> None:
        self._robot = robot
        self._simulated = simulated
        self._model = simulated.model
        self._data = mujoco.MjData(self._model) if data is None else data
        self._ahead = mujoco.MjData(self._model)  # scratch: one engine step beyond the present
        self._rollout = rollout.Rollout(nthread=0)
        self._disturbance = disturbance or Disturbance(simulated)
        self._substeps = _whole_steps(control_period, self._model.opt.timestep)
        self._kp, self._kd = simulated.kp, simulated.kd
        self._closed = False
        self._imu_rotation = np.zeros(9)
        mujoco.mju_quat2Mat(self._imu_rotation, self._model.site(IMU_SITE).quat)
        self._imu_rotation = self._imu_rotation.reshape(3, 3)
        address = self._model.sensor(ACCELEROMETER).adr[0]
        self._accelerometer = slice(address, address + 3)
        self._raw_past = np.zeros((0, self._raw_width))
        self._late_control = np.zeros((0, self._model.nu))
        self._periods = 0
        self._settle(stance, start)

    @property
    def control_period(self) -> float:
        return self._substeps * self._model.opt.timestep

    @property
    def joint_names(self) -> tuple[str, ...]:
        return self._robot.joint_names

    @property
    def accepts(self) -> frozenset[str]:
        return ACCEPTS_EVERYTHING

    def read(self) -> RobotState:
        raw = np.concatenate([self._raw_past, self._raw_now()[None]])
        sample = self._sensed(raw, len(raw) - 1, 1, self._periods)
        joints = len(self.joint_names)
        position, velocity, torque = sample[0, : 3 * joints].reshape(3, joints)
        return RobotState(self._time(self._periods), position, velocity, torque, sample[0, -6:-3], sample[0, -3:])

    def step(self, command: JointCommand) -> RobotState:
        velocity, torque = command.velocity, command.torque
        self._set_gains(command.kp, command.kd)
        trajectory = Trajectory(
            command.position[None],
            None if velocity is None else velocity[None],
            None if torque is None else torque[None],
        )
        self._advance(self._control(trajectory))
        return self.read()

    def play(self, trajectory: Trajectory, stop: TiltLimit | None = None) -> Recording:
        self._set_gains(None, None)
        return self._play(trajectory, stop)

    def _play(self, trajectory: Trajectory, stop: TiltLimit | None = None) -> Recording:
        control = self._control(trajectory)
        samples: list[FloatArray] = []
        first = self._periods
        turned = np.zeros(3)
        try:
            chunk = _CHUNK if stop is None else PERIODS_BETWEEN_STOP_TESTS
            for begin in range(0, len(trajectory.position), chunk):
                end = min(begin + chunk, len(trajectory.position))
                samples.append(self._roll(control[begin * self._substeps : end * self._substeps]))
                if stop is not None:
                    path = turned + np.cumsum(samples[-1][:, -6:-3], axis=0) * self.control_period
                    turned = path[-1]
                    if stop.reached(path):
                        break
        except KeyboardInterrupt:
            raise MotionInterrupted(self._recording(trajectory, samples, first) if samples else None) from None
        return self._recording(trajectory, samples, first)

    def close(self) -> None:
        self._closed = True
        self._rollout.close()

    def __enter__(self) -> MujocoPlatform:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    @property
    def _raw_width(self) -> int:
        return 3 * len(self.joint_names) + 6

    def _time(self, periods: int | NDArray[np.intp]) -> float:
        return periods * self.control_period  # pyright: ignore[reportReturnType]

    def _settle(self, stance: Stance, start: Literal["standing", "lying"]) -> None:
        """Put the robot on the floor and let it come to rest under its own joint control."""
        data, model = self._data, self._model
        position, height = stance.joint_position, stance.base_height
        if start == "lying":
            position, height = lying_posture(self._robot, stance)
        data.qpos[:] = model.qpos0
        data.qpos[:7] = [0, 0, height, 1, 0, 0, 0]
        data.qpos[self._simulated.qpos] = position
        mujoco.mj_forward(model, data)
        hold = self._with_zeros(np.array(position)[None])
        self._late_control = np.repeat(hold, self._late_steps, axis=0)
        self._roll(np.repeat(hold, round(_SETTLING_TIME / model.opt.timestep), axis=0))
        self._raw_past = self._raw_past[-self._past_steps :]
        self._periods = 0
        data.time = 0.0
        up = np.zeros(3)
        mujoco.mju_rotVecQuat(up, np.array([0.0, 0, 1]), data.qpos[3:7])
        if not up[2] > 0.9:
            raise FallError(f"{self._robot.name!r} fell over before it was asked to move; is its stance stable?")

    @property
    def _late_steps(self) -> int:
        return round(self._simulated.errors.sizes.command_delay / self._model.opt.timestep)

    @property
    def _past_steps(self) -> int:
        sizes = self._simulated.errors.sizes
        return int(np.ceil((sizes.sensor_delay + abs(sizes.imu_clock_offset)) / self._model.opt.timestep)) + 2

    def _with_zeros(self, position: FloatArray) -> FloatArray:
        """The loop closes on the encoders: what they misread, the joint is off by."""
        return position - self._simulated.errors.joint_zero

    def _set_gains(self, kp: FloatArray | None, kd: FloatArray | None) -> None:
        """Gains in force until the next command; None is the platform's own."""
        simulated, scale = self._simulated, self._simulated.errors.torque_gain
        self._kp = simulated.kp if kp is None else kp
        self._kd = simulated.kd if kd is None else kd
        if not (np.min(self._kp) >= 0 and np.min(self._kd) >= 0):
            raise SettingsError("joint gains kp and kd must be numbers of zero or more")
        self._kp = np.maximum(self._kp, _LEAST_KP)
        self._model.actuator_gainprm[:, 0] = self._kp * scale
        self._model.actuator_biasprm[:, 1] = -self._kp * scale
        self._model.actuator_biasprm[:, 2] = -self._kd * scale

    def _control(self, trajectory: Trajectory) -> FloatArray:
        """(n substeps, nu) position targets; feed-forward folds into the target of a PD loop."""
        if self._closed:
            raise MotionError("the simulated robot is closed; simulate it again to move it")
        joints = len(self.joint_names)
        if trajectory.position.shape[1] != joints:
            raise SettingsError(
                f"commands for {trajectory.position.shape[1]} joints; {self._robot.name!r} has {joints}"
            )
        target = self._with_zeros(trajectory.position)
        if trajectory.velocity is not None:
            target = target + trajectory.velocity * self._kd / self._kp
        if trajectory.torque is not None:
            target = target + trajectory.torque / self._kp
        return np.repeat(target, self._substeps, axis=0)

    def _roll(self, control: FloatArray) -> FloatArray:
        """Roll the engine forward and return the samples (n, 3 nj + 6) sensed at each control period's start."""
        first, past = self._periods, len(self._raw_past)
        return self._sensed(self._advance(control), past, len(control) // self._substeps, first)

    def _advance(self, control: FloatArray) -> FloatArray:
        """Roll the engine forward; returns raw sensor values at every engine step, the kept past first."""
        delayed = np.concatenate([self._late_control, control])
        control = delayed[: len(control)]
        data, model, simulated = self._data, self._model, self._simulated
        size = mujoco.mj_stateSize(model, _STATE)
        initial = np.zeros(size)
        mujoco.mj_getState(model, data, initial, _STATE)
        states, sensors = self._rollout.rollout(
            model,
            data,
            initial[None],
            self._disturbance.beside(control)[None],
            control_spec=self._disturbance.spec,
            initial_warmstart=np.array(data.qacc_warmstart)[None],
        )
        states, sensors = states[0], sensors[0]
        # The engine restarts at time zero when it diverges.
        if not (states[0, 0] > initial[0] and (states[1:, 0] > states[:-1, 0]).all()):
            raise FallError(
                f"the simulation of {self._robot.name!r} became unstable at t = {initial[0]:.2f} s; "
                "are its inertias and gains plausible?"
            )
        mujoco.mj_setState(model, data, states[-1], _STATE)
        # The engine's velocity belongs to the middle of the step before a state: the mean of two belongs to the state.
        moving = slice(1 + model.nq, 1 + model.nq + model.nv)
        velocities = states[:, moving].copy()
        velocities[0] += initial[moving]
        velocities[1:] += states[:-1, moving]
        velocities /= 2
        past, joints = len(self._raw_past), model.nu
        history = np.empty((past + len(states), self._raw_width))
        history[:past] = self._raw_past
        raw = history[past:]
        raw[0, :joints], raw[1:, :joints] = initial[1 + simulated.qpos], states[:-1, 1 + simulated.qpos]
        raw[:, joints : 2 * joints] = velocities[:, simulated.dof]
        np.divide(sensors[:, :joints], simulated.errors.torque_gain, out=raw[:, 2 * joints : 3 * joints])
        raw[:, -6:-3] = velocities[:, 3:6] @ self._imu_rotation
        raw[:, -3:] = sensors[:, self._accelerometer]
        self._late_control = delayed[len(control) :]
        self._raw_past = history[len(history) - min(len(history), self._past_steps) :]
        self._periods += len(control) // self._substeps
        return history

    def _raw_now(self) -> FloatArray:
        """The raw sensor values of the present state, as `_roll` will find them when the robot moves on.

        A command that acts at once is not known yet: the last one stands for it.
        """
        data, model, simulated = self._data, self._model, self._simulated
        ahead, state = self._ahead, np.zeros(mujoco.mj_stateSize(model, _WHOLE_STATE))
        mujoco.mj_getState(model, data, state, _WHOLE_STATE)
        mujoco.mj_setState(model, ahead, state, _WHOLE_STATE)
        if len(self._late_control):
            ahead.ctrl[:] = self._late_control[0]
        mujoco.mj_step(model, ahead)
        velocity = (data.qvel + ahead.qvel) / 2
        return np.concatenate(
            [
                data.qpos[simulated.qpos],
                velocity[simulated.dof],
                ahead.sensordata[: model.nu] / simulated.errors.torque_gain,
                velocity[3:6] @ self._imu_rotation,
                ahead.sensordata[self._accelerometer],
            ]
        )

    def _sensed(self, raw: FloatArray, first: int, count: int, period: int) -> FloatArray:
        """Delay, clock offset, bias and noise: raw values at every engine step to samples at every control period.

        Args:
            first: row of the first sample's moment.
            count: of samples.
            period: number of the first sample's control period, which its noise is keyed by.
        """
        errors = self._simulated.errors
        step = self._model.opt.timestep
        joints = 3 * len(self.joint_names)
        joint_steps = -errors.sizes.sensor_delay / step
        imu_steps = joint_steps + errors.sizes.imu_clock_offset / step
        samples = np.empty((count, raw.shape[1]))
        ticks = first + self._substeps * np.arange(count)
        samples[:, :joints] = _at(raw[:, :joints], ticks, joint_steps)
        samples[:, joints:] = _at(raw[:, joints:], ticks, imu_steps)
        samples[:, : len(self.joint_names)] += errors.joint_zero
        samples[:, -6:-3] += errors.gyro_bias
        samples[:, -3:] += errors.accelerometer_bias
        return samples + errors.noise(period, count)

    def _recording(self, trajectory: Trajectory, samples: list[FloatArray], first: int) -> Recording:
        stacked = np.concatenate(samples)
        joints = len(self.joint_names)
        time = np.asarray(self._time(first + np.arange(len(stacked))))
        position, velocity, torque, gyro, acceleration = np.split(stacked, [joints, 2 * joints, 3 * joints, -3], axis=1)
        return Recording(
            self.joint_names,
            JointStream(time, position, velocity, torque),
            ImuStream(time, gyro, acceleration),
            CommandStream(time, trajectory.position[: len(stacked)]),
            started_events(trajectory.events, float(time[0]), float(time[-1])),
        )


def _whole_steps(control_period: float, timestep: float) -> int:
    """Engine steps per control period."""
    steps = round(control_period / timestep) if timestep > 0 else 0
    if steps < 1 or not np.isclose(steps * timestep, control_period, rtol=1e-9):
        raise SettingsError(
            f"the engine's time step is {timestep:g} s; it must go a whole number of times into the control period of "
            f"{control_period:g} s"
        )
    return steps


def _at(raw: FloatArray, ticks: NDArray[np.intp], offset: float) -> FloatArray:
    """Rows at ticks + offset engine steps, linear in between, the ends held."""
    whole = int(np.floor(offset + 1e-9))  # a delay of four steps is not one of 3.9999999999
    fraction = offset - whole
    before = raw.take(ticks + whole, axis=0, mode="clip")
    if fraction < 1e-6:
        return before
    return (1 - fraction) * before + fraction * raw.take(ticks + whole + 1, axis=0, mode="clip")
