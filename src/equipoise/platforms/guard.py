"""The guard: what stands between an experiment and a robot that can break.

It is a platform around a platform. Nothing passes it: `play` is stepped, every command is checked before it is sent, every
sample when it arrives. Whatever goes wrong, and however the program ends, the robot is put down: its feet first if two are in
the air, then softly to the floor by damped joints, then the motors are released.
"""

from __future__ import annotations

import atexit
import contextlib
import time
from collections.abc import Callable, Generator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from equipoise.errors import CommunicationError, FallError, LimitError, MotionError, OverrunError, SensorError
from equipoise.platforms.hardware import LoopTiming
from equipoise.platforms.interruptions import Hurry, signals_raise, signals_wait
from equipoise.platforms.limits import JointWatch, Limits
from equipoise.platforms.piece_log import PieceLog
from equipoise.platforms.platform import (
    JointCommand,
    MotionInterrupted,
    Platform,
    RobotState,
    Steps,
    TiltLimit,
    Trajectory,
)
from equipoise.platforms.sample_watch import SampleCounts, SampleWatch
from equipoise.platforms.tilt_watch import TiltWatch
from equipoise.recordings.recording import PHASE, Event, Recording
from equipoise.recordings.run_log import RunLog
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import lies, lying_posture, nominal_stance

FloatArray = NDArray[np.float64]

_LOOK_TIME = 0.3  # [s] of samples before anything moves
_SOFT_START = 1.0  # [s]
_FEET_DOWN, _SINK, _DAMPED = 0.3, 0.5, 1.0  # [s] of the parts of the safe ending
_LIE_DOWN = 2.5  # [s] for a robot of an A1's size
_FIRST_JUMP = 0.1  # [rad] between where a joint is and where it is first sent
_HOPELESS = 0.8  # [rad] of tilt beyond which putting feet down catches nobody
_DAMPING = 2.0  # of the model's kd, when joints only damp
_IN_AIR = ("unload", "lift", "watch", "lower", "replant")  # phases in which feet may be off the floor


@dataclass(frozen=True)
class GuardReport:
    """What a guarded run was like.

    Attributes:
        samples: what arrived.
        commands: how many were sent.
        overruns: how many of them more than a millisecond late; None in simulation.
        stalls: how often the loop fell so far behind that its deadlines began anew; None in simulation.
        late_999: lateness that 99.9 % of the commands stayed below [s]; None in simulation.
        largest_tilt: of the base from upright [rad].
        hottest_motor: [deg C]; None if motors do not say.
        lowest_voltage: of the battery [V]; None if it does not say.
        ending: what the safe ending did, in order.
    """

    samples: SampleCounts
    commands: int
    overruns: int | None
    stalls: int | None
    late_999: float | None
    largest_tilt: float
    hottest_motor: float | None
    lowest_voltage: float | None
    ending: tuple[str, ...]


class Guard:
    """A guarded robot. Use it as a context manager; leaving it, in whatever way, is the safe ending.

    Args:
        platform: to be guarded; the guard closes it.
        robot: what is known about it.
        limits: how far it may go.
        log: is told of every motion when it begins, and takes pieces of it every quarter of a second while it goes on.

    Attributes:
        phase: of the motion that is played, as its events name it.
    """

    def __init__(
        self,
        platform: Platform,
        robot: RobotModel,
        limits: Limits | None = None,
        log: RunLog | None = None,
    ) -> None:
        self._platform, self._robot = platform, robot
        self._limits = limits = limits or Limits()
        self._stance = nominal_stance(robot)
        period = platform.control_period
        self._samples = SampleWatch(robot, period, limits.silence)
        hip_height = self._stance.hip_height
        self._joints = JointWatch(limits, robot, hip_height, period, "gains" in platform.accepts)
        self._tilt = TiltWatch(np.array(robot.imu_in_base.rotation))
        kp, kd = robot.gains(hip_height)
        count = len(platform.joint_names)
        self._kp, self._kd = np.full(count, kp), np.full(count, kd)
        self._log = PieceLog(log, period)
        self._last: JointCommand | None = None
        self._planted: JointCommand | None = None
        self._state: RobotState | None = None
        self._steps: Steps | None = None
        self.phase = ""
        self._in_air = False
        self._stepped = 0.0
        self._commands = 0
        self._hottest: float | None = None
        self._lowest: float | None = None
        self._ending: list[str] = []
        self._ended = False
        self._signals = contextlib.ExitStack()
        atexit.register(self.close)

    @property
    def control_period(self) -> float:
        return self._platform.control_period

    @property
    def joint_names(self) -> tuple[str, ...]:
        return self._platform.joint_names

    @property
    def accepts(self) -> frozenset[str]:
        return self._platform.accepts

    def read(self) -> RobotState:
        self._samples.forgive()
        state = self._platform.read()
        if state.received is not None and time.monotonic() - state.received > self._limits.silence:
            raise CommunicationError(
                f"no sample has arrived for {time.monotonic() - state.received:.1f} s: is the robot still on, is the cable in?"
            )
        self._state = state = self._samples.check(state, None)
        self._tilt.feel(state)
        return state

    def step(self, command: JointCommand) -> RobotState:
        """As a platform's.

        Raises:
            LimitError: a joint, a motor or a command is beyond its limits.
            TrackingError: a joint does not follow.
            FallError: the base tilts.
            SensorError, CommunicationError: samples cannot be believed, or none arrive.
        """
        with self._ending_on_trouble():
            self._begin(command)
            return self._step(command)

    def play(self, trajectory: Trajectory, stop: TiltLimit | None = None) -> Recording:
        """As a platform's; raises what `step` raises, with what was recorded so far, and OverrunError.

        The robot has been put down by then.
        """
        steps: Steps | None = None
        try:
            with self._ending_on_trouble():
                self._begin(trajectory.command(0))
                steps = self._steps = Steps(self, self._start(), self._steps)
                self._play(trajectory, stop, steps)
        except KeyboardInterrupt as interrupt:
            recorded = steps.recording(trajectory.events) if steps is not None and steps.count else None
            raise MotionInterrupted(recorded) from interrupt
        except MotionError as error:
            if steps is not None and steps.count and not error.recordings:
                error.recordings = (steps.recording(trajectory.events),)
            raise
        return steps.recording(trajectory.events)

    def close(self) -> None:
        """Lie down, damp, release."""
        self._end(None)

    def report(self) -> GuardReport:
        """What the run was like so far."""
        timing = getattr(self._platform, "timing", None)
        late = timing.lateness if isinstance(timing, LoopTiming) and len(timing.lateness) else None
        return GuardReport(
            replace(self._samples.counts),
            self._commands,
            None if late is None else timing.overruns,  # pyright: ignore[reportOptionalMemberAccess]
            None if late is None else timing.lost,  # pyright: ignore[reportOptionalMemberAccess]
            None if late is None else float(np.quantile(late, 0.999)),
            self._tilt.largest,
            self._hottest,
            self._lowest,
            tuple(self._ending),
        )

    def __enter__(self) -> Guard:
        self._signals.enter_context(signals_raise())
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        try:
            self._end(error)
        finally:
            self._signals.close()

    # --- moving

    def _play(self, trajectory: Trajectory, stop: TiltLimit | None, steps: Steps) -> None:
        turned = np.zeros(3)
        phases = [event for event in trajectory.events if event.name == PHASE]
        self._stepped = time.monotonic()
        self._log.begin(len(trajectory.position), trajectory.events)
        try:
            for index in range(len(trajectory.position)):
                while phases and phases[0].time <= (index + 0.5) * self.control_period:
                    self._enter(phases.pop(0))
                command = trajectory.command(index)
                state = steps.add(command.position, lambda command=command: self._step(command))
                self._check_pace(state)
                self._log.written(steps)
                turned = turned + state.angular_velocity * self.control_period
                if stop is not None and stop.reached(turned):
                    break
        finally:
            self._log.finish(steps)

    def _enter(self, phase: Event) -> None:
        self.phase = str(phase.data.get("name"))
        self._in_air = self.phase in _IN_AIR

    def _step(self, command: JointCommand) -> RobotState:
        if self._ended:
            raise MotionError("the robot was put down and released; start again to move it")
        before = self._last
        assert before is not None  # `_begin` saw to it
        assert self._state is not None
        self._joints.check_command(command, before.position, self._state.joint_position)
        state = self._state = self._samples.check(self._send(command), command.position)
        self._joints.check_state(state, command)
        self._note_health(state)
        tilt = max(self._tilt.feel(sample) for sample in (*state.earlier, state))
        if tilt > (self._limits.tilt_in_lift if self._in_air else self._limits.tilt):
            raise FallError(f"the base leans by {np.degrees(tilt):.0f} deg: the robot is falling")
        if not self._in_air:
            self._planted = command
        return state

    def _send(self, command: JointCommand) -> RobotState:
        self._last = command
        self._commands += 1
        return self._platform.step(command)

    def _start(self) -> RobotState:
        """The present state, and with it the last one of the motion before, which no recording has yet."""
        last = None if self._steps is None else self._steps.state
        state = self.read()
        return state if last is None or last.time >= state.time else replace(state, earlier=(last, *state.earlier))

    def _check_pace(self, state: RobotState) -> None:
        now = time.monotonic()
        if state.received is not None and now - self._stepped > self._limits.stall:
            raise OverrunError(
                f"this computer sent nothing for {(now - self._stepped) * 1000:.0f} ms while the robot moved: end other "
                "programs, or give this one a core of its own"
            )
        self._stepped = now

    def _note_health(self, state: RobotState) -> None:
        if state.health is None:
            return
        if state.health.motor_temperature is not None:
            self._hottest = max(self._hottest or -np.inf, float(state.health.motor_temperature.max()))
        if state.health.battery_voltage is not None:
            self._lowest = min(self._lowest or np.inf, state.health.battery_voltage)

    # --- beginning

    def _begin(self, first: JointCommand) -> None:
        """Before the first command: look, then let gains and torques grow where the joints are."""
        if self._last is not None:
            return
        state = self.read()
        if state.received is not None:
            for _ in range(round(_LOOK_TIME / self.control_period)):
                time.sleep(self.control_period)
                state = self.read()
        here = state.joint_position
        jump = np.abs(first.position - here)
        if jump.max() > _FIRST_JUMP:
            joint = int(np.argmax(jump))
            raise LimitError(
                f"the first command would move joint {self.joint_names[joint]!r} at once from {here[joint]:.3f} to "
                f"{first.position[joint]:.3f} rad; motions start where the robot is"
            )
        lying = lies(self._robot, self._stance, here)
        self._last = self._planted = JointCommand(first.position)
        for share in _ramp(_SOFT_START, self.control_period):
            self._step(self._softened(replace(first, velocity=None), share if lying else 1.0, share))

    def _softened(self, command: JointCommand, stiffness: float, load: float) -> JointCommand:
        """A command with a share of the gains and of the feed-forward torque."""
        kp = self._kp if command.kp is None else command.kp
        kd = self._kd if command.kd is None else command.kd
        gains = stiffness < 1 and "gains" in self.accepts
        return replace(
            command,
            torque=None if command.torque is None else load * command.torque,
            kp=stiffness * kp if gains else command.kp,
            kd=kd if gains else command.kd,
        )

    # --- ending

    @contextlib.contextmanager
    def _ending_on_trouble(self) -> Generator[None]:
        """Put the robot down before anybody else hears of what happened."""
        try:
            yield
        except BaseException as error:
            self._end(error)
            raise

    def _end(self, error: BaseException | None) -> None:
        """Feet down if that is still sensible; lie down if all is well; damp; release."""
        if self._ended:
            return
        self._ended = True
        atexit.unregister(self.close)
        with signals_wait() as hurry:
            try:
                if self._last is not None:
                    for stage in (self._put_feet_down, self._lie_down, self._damp):
                        self._tried(stage, error, hurry)
            finally:
                try:
                    self._platform.close()
                    self._ending.append("released")
                finally:
                    self._log.close()

    def _tried(
        self, stage: Callable[[BaseException | None, Hurry], None], error: BaseException | None, hurry: Hurry
    ) -> None:
        """A stage of the ending that fails must not keep the next one from being tried."""
        with contextlib.suppress(Exception):
            stage(error, hurry)

    def _put_feet_down(self, error: BaseException | None, hurry: Hurry) -> None:
        sensible = not isinstance(error, (SensorError, CommunicationError)) and self._tilt.tilt < _HOPELESS
        if not (self._in_air and sensible and self._planted is not None and self._last is not None):
            return
        self._ending.append("feet down")
        self._glide(self._last, self._planted, _FEET_DOWN, hurry)
        self._in_air = False

    def _lie_down(self, error: BaseException | None, hurry: Hurry) -> None:
        """Only a robot that is well is trusted to do this."""
        well = error is None or isinstance(error, (KeyboardInterrupt, SystemExit)) or not isinstance(error, MotionError)
        if (
            not well
            or hurry.asked
            or self._state is None
            or lies(self._robot, self._stance, self._state.joint_position)
        ):
            return
        self._ending.append("lying down")
        assert self._last is not None
        position, _ = lying_posture(self._robot, self._stance)
        down = JointCommand(position, torque=None if self._last.torque is None else np.zeros_like(position))
        self._glide(self._last, down, _LIE_DOWN * self._stance.clock, hurry)

    def _damp(self, error: BaseException | None, hurry: Hurry) -> None:
        """Gains fade, then joints only damp: a standing robot sinks to the floor."""
        assert self._last is not None
        if "gains" not in self.accepts:
            return
        self._ending.append("damped")
        last = self._last
        for share in 1 - _ramp(_SINK, self.control_period):
            self._send(replace(self._softened(last, share, share), kd=_DAMPING * self._kd))
        limp = JointCommand(last.position, kp=np.zeros_like(self._kp), kd=_DAMPING * self._kd)
        for _ in range(round(_DAMPED / self.control_period)):
            self._send(limp)

    def _glide(self, start: JointCommand, end: JointCommand, duration: float, hurry: Hurry) -> None:
        """From one command to another, unwatched: this is the ending already."""
        zeros = np.zeros_like(start.position)
        torques = [zeros if command.torque is None else command.torque for command in (start, end)]
        for share in _ramp(duration, self.control_period):
            if hurry.asked:
                return
            position = start.position + share * (end.position - start.position)
            torque = torques[0] + share * (torques[1] - torques[0])
            self._state = self._send(JointCommand(position, torque=torque if "torque" in self.accepts else None))


def _ramp(duration: float, period: float) -> FloatArray:
    """(n,) from just above 0 to 1, starting and ending at rest."""
    share = np.arange(1, max(1, round(duration / period)) + 1) / max(1, round(duration / period))
    return share**3 * (10 - 15 * share + 6 * share**2)
