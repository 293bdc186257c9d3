"""Platform of a simulated robot in any engine: commands arrive late, sensors err, motions are recorded."""

from __future__ import annotations

from abc import abstractmethod
from typing import Literal

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import FallError, MotionError, SettingsError
from equipoise.platform.platform import (
    ACCEPTS_EVERYTHING,
    TURNS,
    JointCommand,
    MotionInterrupted,
    RobotState,
    Trajectory,
)
from equipoise.platform.ramp import smooth_step
from equipoise.platform.stepped import SteppedPlatform
from equipoise.platform.stepping import started_events
from equipoise.platform.tilt_limit import TiltLimit, TiltTest
from equipoise.recording.event import PHASE
from equipoise.recording.phases import Phase
from equipoise.recording.recording import CommandStream, ImuStream, JointStream, Recording
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance, lying_posture
from equipoise.simulation.drawn_errors import DrawnErrors
from equipoise.simulation.samples import Samples
from equipoise.small_arrays import all_of

Start = Literal["standing", "lying"]

_SETTLING_TIME = 1.5  # [s] before time zero, so that a calibration does not start with a drop
_LEAST_KP = 1e-6  # [Nm/rad]: torques act through the gain, also those of a joint without one
# Control periods rolled out at once: few where a stop rule is to be tested, else as many as Ctrl-C may wait for.
PERIODS_BETWEEN_STOP_TESTS, _CHUNK = 5, 500


class SimulatedPlatform(SteppedPlatform):
    """A quadruped in an engine, with the sensors of hardware: encoders, reported torques, gyroscope and accelerometer.

    The engine takes one row of joint position targets per step, and returns a row of raw sensor values of the state at that
    step's start (3 nj + 6: positions, velocities, reported torques, gyroscope, accelerometer; no noise, delay or offset).
    A subclass ends its `__init__` with `_settle`.

    Args:
        robot: model that the estimator has; the simulated robot may differ from it by its errors and payload.
        errors: errors of its sensors and actuators.
        kp, kd: (nj,) the platform's own gains [Nm/rad], [Nm s/rad].
        timestep: time step of the engine [s].
        control_period: time between commands [s]; a multiple of the time step.
    """

    def __init__(
        self,
        robot: RobotModel,
        errors: DrawnErrors,
        kp: FloatArray,
        kd: FloatArray,
        timestep: float,
        control_period: float,
    ) -> None:
        super().__init__(robot)
        self._robot, self._errors = robot, errors
        self._own_kp, self._own_kd = kp, kd
        self._kp, self._kd = kp, kd
        self._timestep = timestep
        self._substeps = _whole_steps(control_period, timestep)
        self.control_period, self.accepts = self._substeps * timestep, ACCEPTS_EVERYTHING | {TURNS}
        self._closed = False
        self._samples = Samples(errors, len(self.joint_names), timestep, self._substeps)
        self._raw_past = np.zeros((0, self._raw_width))
        self._late_control = np.zeros((0, len(self.joint_names)))
        self._periods = 0

    @abstractmethod
    def _place(self, joint_position: FloatArray, base_height: float) -> None:
        """Place the robot at a posture and height [m], level and at rest."""

    @abstractmethod
    def _run(self, control: FloatArray, raw: FloatArray) -> None:
        """Advance by one engine step for each row of (n, nj) targets [rad], and fill in (n, 3 nj + 6) raw sensor values.

        An interrupted call leaves the state unchanged.

        Raises:
            FallError: the simulation is unstable.
        """

    @abstractmethod
    def _raw_now(self) -> FloatArray:
        """Return (3 nj + 6,) raw sensor values of the present state, as `_run` will compute them.

        The last command stands for one without delay, which is not available yet.
        """

    @abstractmethod
    def _set_clock_to_zero(self) -> None:
        """Set the engine's clock to zero, for observers of the engine."""

    @abstractmethod
    def _turn_by(self, angle: float) -> None:
        """Rotate the robot about the floor's normal through its base's origin, to its left [rad]."""

    @abstractmethod
    def _base_up(self) -> float:
        """Return the cosine of the angle between the base's z axis and the floor's normal."""

    def read(self) -> RobotState:
        raw = self._raw_past
        if not self._samples.late:
            raw = np.concatenate([raw, self._samples.filtered(self._raw_now()[None], keep=False)])
        sample = self._samples.sensed(raw, len(self._raw_past), 1, self._periods)
        return self._samples.state(sample[0], self._periods)

    def step(self, command: JointCommand) -> RobotState:
        self._set_gains(command.kp, command.kd)
        self._advance(self._control(Trajectory.of(command)))
        return self.read()

    def play(self, trajectory: Trajectory, stop: TiltLimit | None = None) -> Recording:
        command = trajectory.command(0)
        self._set_gains(command.kp, command.kd)
        control, turns = self._control(trajectory), _turns(trajectory)
        samples: list[FloatArray] = []
        first = self._periods
        joints = len(self.joint_names)
        test = TiltTest(stop, self.control_period)
        try:
            chunk = _CHUNK if stop is None else PERIODS_BETWEEN_STOP_TESTS
            chunk = chunk if turns is None else 1
            for begin in range(0, len(trajectory.position), chunk):
                end = min(begin + chunk, len(trajectory.position))
                turn = 0.0 if turns is None else float(turns[begin])
                samples.append(self._roll(control[begin * self._substeps : end * self._substeps], turn))
                seen = self._samples.shown(samples[-1], self._periods - len(samples[-1]))
                if test.reached(seen[:, -6:-3], seen[:, :joints]):
                    break
        except KeyboardInterrupt:
            raise MotionInterrupted(self._recording(trajectory, samples, first) if samples else None) from None
        return self._recording(trajectory, samples, first)

    def close(self) -> None:
        self._closed = True

    @property
    def _raw_width(self) -> int:
        return 3 * len(self.joint_names) + 6

    def _settle(self, stance: Stance, start: Start) -> None:
        """Put the robot on the floor and let it come to rest under its own joint control."""
        position, height = stance.joint_position, stance.base_height
        if start == "lying":
            position, height = lying_posture(self._robot, stance)
        self._place(position, height)
        hold = self._with_zeros(np.array(position)[None])
        self._late_control = np.repeat(hold, round(self._errors.sizes.command_delay / self._timestep), axis=0)
        self._roll(np.repeat(hold, round(_SETTLING_TIME / self._timestep), axis=0))
        self._raw_past = self._raw_past[-self._samples.past_steps :]
        self._periods = 0
        self._set_clock_to_zero()
        if not self._base_up() > 0.9:
            raise FallError(f"{self._robot.name!r} fell over before the first motion; check that its stance is stable")

    def _with_zeros(self, position: FloatArray) -> FloatArray:
        """Return the joint targets at which the encoders read a position, since the loop closes on them."""
        target = position - self._errors.drawn["joint_offset"]
        return target - self._errors.encoder_error(target) if self._errors.sizes.encoder_eccentricity else target

    def _set_gains(self, kp: FloatArray | None, kd: FloatArray | None) -> None:
        """Set the gains until the next command; None is the platform's own."""
        self._kp = self._own_kp if kp is None else kp
        self._kd = self._own_kd if kd is None else kd
        if not (all_of(self._kp >= 0) and all_of(self._kd >= 0)):
            raise SettingsError("joint gains kp and kd must be numbers of zero or more")
        self._kp = np.maximum(self._kp, _LEAST_KP)

    def _control(self, trajectory: Trajectory) -> FloatArray:
        """Return (n substeps, nj) position targets; feed-forward is included in the target of the PD loop."""
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

    def _roll(self, control: FloatArray, turn: float = 0.0) -> FloatArray:
        """Roll the engine forward and return the samples (n, 3 nj + 6) sensed at each control period's start.

        Args:
            turn: angle by which the lying robot is turned meanwhile [rad].
        """
        first, past = self._periods, len(self._raw_past)
        return self._samples.sensed(self._advance(control, turn), past, len(control) // self._substeps, first)

    def _advance(self, control: FloatArray, turn: float = 0.0) -> FloatArray:
        """Roll the engine forward; return raw sensor values at every engine step, those of the past first."""
        delayed = np.concatenate([self._late_control, control])
        past = len(self._raw_past)
        history = np.empty((past + len(control), self._raw_width))
        history[:past] = self._raw_past
        self._run(delayed[: len(control)], history[past:])
        if turn:
            self._turn_by(turn)
            force_in_imu = history[past:, -3:].mean(axis=0)  # approximately gravity alone
            up_in_imu = force_in_imu / np.linalg.norm(force_in_imu)
            history[past:, -6:-3] += turn / (len(control) * self._timestep) * up_in_imu
        history[past:] = self._samples.filtered(history[past:])
        self._late_control = delayed[len(control) :]
        self._raw_past = history[len(history) - min(len(history), self._samples.past_steps) :]
        self._periods += len(control) // self._substeps
        return history

    def _became_unstable(self, time: float) -> FallError:
        return FallError(
            f"the simulation of {self._robot.name!r} became unstable at t = {time:.2f} s; check its inertias and gains"
        )

    def _recording(self, trajectory: Trajectory, samples: list[FloatArray], first: int) -> Recording:
        stacked = np.concatenate(samples)
        joints, count = len(self.joint_names), len(stacked)
        time, there = self._samples.time(first + np.arange(count)), self._samples.arrived(first, count)
        stamps = self._samples.stamps(first, count)[there]
        columns = np.split(stacked[there], [joints, 2 * joints, 3 * joints, -3], axis=1)
        position, velocity, torque, gyro, acceleration = columns
        return Recording(
            self.joint_names,
            JointStream(stamps, position, velocity, torque),
            ImuStream(stamps, gyro, acceleration),
            CommandStream(time, trajectory.position[:count]),
            started_events(trajectory.events, float(time[0]), float(time[-1])),
        )


def _turns(trajectory: Trajectory) -> FloatArray | None:
    """Return (n,) the angle by which the robot is turned in each control period, half a turn in all [rad]; None: it is not."""
    if not any(event.name == PHASE and event.data.get("name") == Phase.TURN for event in trajectory.events):
        return None
    return np.pi * np.diff(smooth_step(len(trajectory.position)), prepend=0.0)


def _whole_steps(control_period: float, timestep: float) -> int:
    """Return the engine steps per control period."""
    steps = round(control_period / timestep) if timestep > 0 else 0
    if steps < 1 or not np.isclose(steps * timestep, control_period, rtol=1e-9):
        raise SettingsError(
            f"the engine's time step is {timestep:g} s; the control period of "
            f"{control_period:g} s must be a whole multiple of it"
        )
    return steps
