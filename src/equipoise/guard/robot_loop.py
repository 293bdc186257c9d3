"""Control loop that owns a robot. `RobotLoop.tick` is one control period; nothing else commands the robot.

The robot process runs it at a fixed rate with a real robot or an emulator; simulated robots are stepped in lockstep.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.drivers.hardware import HardwarePlatform
from equipoise.errors import STOP_REQUESTED, CommunicationError, MotionError, StoppedError
from equipoise.guard.base_checks import BaseChecks
from equipoise.guard.check_context import Check, CheckContext
from equipoise.guard.clearance_checks import ClearanceChecks
from equipoise.guard.command_checks import CommandChecks
from equipoise.guard.endings import Ending
from equipoise.guard.force_limit import ForceLimit
from equipoise.guard.joint_checks import JointChecks
from equipoise.guard.limits import Limits
from equipoise.guard.report import GuardReport
from equipoise.guard.sample_filter import SampleFilter
from equipoise.guard.soft_start import soft_start
from equipoise.guard.tilt_filter import TiltFilter
from equipoise.platform.platform import JointCommand, Platform, RobotState, Trajectory
from equipoise.platform.tilt_limit import TiltLimit, TiltTest
from equipoise.recording.recording import PHASE
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import lies, nominal_stance

_OBSERVE_TIME = 0.3  # [s] of samples before the first command
_FRESH_TIME = 0.1  # [s] in which a sample must arrive after a pause without commands
DAMP = "damp"
"""Request of the remote control or the operator to damp the robot at once."""


@dataclass(frozen=True, eq=False)
class MotionOrder:
    """Motion for the loop.

    Attributes:
        number: number of the motion, from 1.
        trajectory: commands of the motion.
        stop: limit at which it ends early, or None.
    """

    number: int
    trajectory: Trajectory
    stop: TiltLimit | None = None


@dataclass(frozen=True, eq=False)
class Tick:
    """Events of one control period.

    Attributes:
        motion: number of the command's motion; 0: none.
        target: (nj,) sent joint position targets [rad], or None if nothing was sent.
        sent: time at which the command was sent, on the monotonic clock [s]; None in simulation.
        samples: accepted samples that arrived after the command.
    """

    motion: int = 0
    target: FloatArray | None = None
    sent: float | None = None
    samples: tuple[RobotState, ...] = ()


class RobotLoop:
    """Loop that observes, moves and holds a robot, and finally puts it down, one control period at a time.

    Args:
        platform: platform of the robot.
        robot: model of the robot.
        limits: limits of motions.

    Attributes:
        context: state of the robot under command; None before the first command.
        state: newest accepted state; None before the first one.
        motion: current motion, or None: the robot is held.
        phase: name of the phase of that motion.
        ending: current ending, or None.
        trouble: error that ended the run, or None.
        over: whether the robot was put down and released.
    """

    def __init__(self, platform: Platform, robot: RobotModel, limits: Limits | None = None) -> None:
        self.platform, self.robot, self._limits = platform, robot, limits or Limits()
        self.stance, self.period = nominal_stance(robot), platform.control_period
        gains = robot.gains(self.stance.hip_height)
        kp, kd = np.full((2, len(robot.joint_names)), np.array(gains)[:, None])
        self.own_gains = (kp, kd) if "gains" in platform.accepts else None
        self._hardware = platform if isinstance(platform, HardwarePlatform) else None
        self._samples = SampleFilter(robot, self.period, self._limits.silence)
        self._tilt_filter = TiltFilter(np.array(robot.imu_in_base.rotation))
        self._forces = ForceLimit(self._limits, robot, self.stance, (kp, kd), self.period)
        self._report = GuardReport(self._samples.counts)
        self._observed = 0.0
        self._commands: Iterator[JointCommand | None] = iter(())
        self._upcoming: JointCommand | None = None
        self._soft = False  # whether the upcoming command belongs to the soft start
        self._sent_at: float | None = None
        self._request = ""  # from the remote control, in the newest samples
        self.context: CheckContext | None = None
        self.state: RobotState | None = None
        self.motion: MotionOrder | None = None
        self.phase = ""
        self.ending: Ending | None = None
        self.trouble: BaseException | None = None
        self.over = False

        commands = self._command_checks = CommandChecks(self._limits, robot, gains, self.period)
        joints = JointChecks(self._limits, robot, self.stance.hip_height, self.period, self.own_gains is not None)
        base, self._clear = BaseChecks(self._limits, robot, self.stance), ClearanceChecks(robot, self.stance)
        self._at_rest: tuple[Check, ...] = (*commands.at_rest, *joints.at_rest, *base.at_rest, *self._clear.at_rest)
        self._before: tuple[Check, ...] = (*commands.in_motion, *self._clear.in_motion)
        self._after: tuple[Check, ...] = (*joints.in_motion, *base.in_motion, *joints.health)

    # --- orders

    def look_ahead(self, trajectory: Trajectory) -> None:
        """Check a whole motion before it begins; raise MotionError or SettingsError if it must not be executed."""
        self._command_checks.check_shape(trajectory.position[0])
        self._clear.check_ahead(trajectory)

    def move(self, motion: MotionOrder) -> None:
        """Begin a motion, after a soft start if it is the first one. A current ending continues instead."""
        if self.ending is None:
            self.motion, self._commands = motion, self._commands_of(motion)
            self._prepare()

    def stop_motion(self) -> None:
        """End the current motion early; hold the robot at its last target."""
        self.motion, self._upcoming = None, None

    def end(self, error: BaseException | None, urgent: bool = False, controllable: bool = True) -> None:
        """Begin to put the robot down.

        Args:
            error: error that ends the run; None: the run is complete.
            urgent: whether to skip lowering it.
            controllable: whether the robot stands and follows its targets. Otherwise it is damped at once.
        """
        self.trouble = self.trouble or error
        if self.ending is None and self._is_out_of_date():
            self._look_again()
        if self.ending is not None and controllable:
            self.ending.urgent = self.ending.urgent or urgent
            return
        if self.ending is not None and not self.ending.controllable:
            return
        done = [] if self.ending is None else self.ending.done
        if done:
            done[-1] += f", stopped: {error}"
        self.motion = None
        self.ending = Ending(self, controllable, urgent, done)
        commanded = self.context is not None and (self._hardware is None or self._hardware.commanded)
        self._commands = self.ending.commands() if commanded else iter(())
        if isinstance(error, MotionError) and error.other_commander:
            self.ending.done.append("left to the other program")
            self._commands = iter(())
        self._prepare()

    # --- one control period

    def tick(self) -> Tick:
        """Run one control period: choose, check, bound and send a command, wait, and check the samples."""
        tick, sent, self._request = Tick(), False, ""
        due = time.monotonic() + self.period
        if self.over:
            return tick
        try:
            command, number = self._choose()
            if command is None:
                tick = Tick(samples=self._observe())
            else:
                bounded = self._checked(command)
                sent = True
                state = self._step(command, bounded)
                tick = Tick(number, bounded.position, self._sent_at, self._accept(state, command))
                self._check_after(command)
        except BaseException as error:
            if self.ending is None and not isinstance(error, Exception):
                raise
            if self.clocked:  # otherwise immediate failures would use up the ending's control periods
                time.sleep(max(0.0, due - time.monotonic()))
            self._fail(error, controllable=not sent or isinstance(error, StoppedError))
        else:
            self._prepare()
        if self._request and not self.over:
            self.obey(self._request, "the remote control")
        return tick

    def _choose(self) -> tuple[JointCommand | None, int]:
        """Return the command of this period and the number of its motion; hold the last command between motions."""
        if self._upcoming is not None:
            return self._upcoming, 0 if self.motion is None or self._soft else self.motion.number
        return (None, 0) if self.context is None or self.ending is not None else (self.context.sent.held(), 0)

    def _checked(self, command: JointCommand) -> JointCommand:
        """Return the command with its force bounded; raise MotionError if it must not be sent."""
        assert self.context is not None
        if self.watched:
            for check in self._before:
                check(command, self.context)
            if self.own_gains is not None:
                return self._forces.bounded(command, self.context.state, self.context.lifted)
        return command

    def _step(self, command: JointCommand, bounded: JointCommand) -> RobotState:
        assert self.context is not None
        before, now = self._sent_at, time.monotonic()
        self._check_gap(before, now)
        self.context.sent, self.context.bounded, self._sent_at = command, bounded, now
        state = self.platform.step(bounded)
        if self._hardware is not None:
            self._sent_at = self._hardware.sent_at
        elif before is None:  # the robot's own controller may have delayed the first command
            self._sent_at = time.monotonic()
        if state.received is None:
            self._sent_at = None
        self._check_gap(before, self._sent_at)
        return state

    def _check_gap(self, before: float | None, now: float | None) -> None:
        """Raise StoppedError if too long a time passed between two commands."""
        if before is None or now is None or not self.watched or now - before <= self._limits.stall:
            return
        self._sent_at = now
        raise StoppedError(
            f"no command was sent for {(now - before) * 1000:.0f} ms while the robot was moved or held: the robot process was "
            "stopped, this computer was suspended, or other programs used its processors. See "
            "docs/hardware/safety.md#real-time-priority"
        )

    def _observe(self) -> tuple[RobotState, ...]:
        """Read a robot that is not commanded yet."""
        if self.clocked:
            time.sleep(self.period)
        state = self.platform.read()
        silent = 0.0 if state.received is None else time.monotonic() - state.received
        if silent > self._limits.silence and self.ending is None:
            raise CommunicationError(
                f"no sample has arrived for {silent:.1f} s: is the robot still on, and is the cable plugged in?"
            )
        self._observed += self.period
        return self._accept(state, None)

    def _accept(self, state: RobotState, command: JointCommand | None) -> tuple[RobotState, ...]:
        """Return the samples that are fresh and plausible, oldest first; raise MotionError."""
        arrived = [state] if self._hardware is None else self._hardware.arrived
        if self._hardware is not None:
            self._samples.counts.rejected = self._hardware.rejected
        target = None if command is None else command.position
        fresh = self._samples.accept(arrived, target, tolerant=not self.watched)
        for sample in fresh:
            self._tilt_filter.update(sample)
        if fresh:
            self.state = max(fresh, key=lambda sample: sample.time)
            if self.context is not None:
                self.context.state = self.state
        if command is not None:
            self._report.note(state)
        if self.ending is not None:
            self.ending.observe(fresh)
        self._request = next((sample.request for sample in fresh if sample.request), "")
        return tuple(fresh)

    def obey(self, request: str, source: str) -> None:
        """Put the robot down at the operator's request: `DAMP` damps it at once, any other request lowers it."""
        damp = request == DAMP
        action = "damp the robot" if damp else "lower the robot"
        error = StoppedError(f"the run ended because {source} asked to {action}", exit_code=STOP_REQUESTED)
        self.end(error, controllable=not damp)

    def _check_after(self, command: JointCommand) -> None:
        assert self.context is not None
        if self.watched:
            for check in self._after:
                check(command, self.context)

    @property
    def watched(self) -> bool:
        """Return whether commands and samples are checked: always, except while the robot is damped."""
        return self.ending is None or self.ending.controllable

    @property
    def waits(self) -> bool:
        """Return whether the loop is idle: time passes only when the platform is stepped, and no motion is requested."""
        return self.state is not None and not self.clocked and self.motion is None and self.ending is None

    @property
    def clocked(self) -> bool:
        """Return whether the robot's time passes without steps: simulated platforms report no time of arrival."""
        return self.state is not None and self.state.received is not None

    def _fail(self, error: BaseException, controllable: bool) -> None:
        """Begin or continue the ending after an error; a failure during lowering damps the robot."""
        if self.ending is None:
            self.end(error, controllable=controllable)
            return
        self.ending.observe(())
        self.ending.urgent = self.ending.urgent or isinstance(error, KeyboardInterrupt)
        # A motor may still be hot, for example.
        if not self.ending.controllable or isinstance(error, (StoppedError, KeyboardInterrupt)):
            self._prepare()
        else:
            self.end(error, controllable=False)

    def _is_out_of_date(self) -> bool:
        """Return whether the newest state is old, as after a pause of this program."""
        received = None if self.state is None else self.state.received
        return received is not None and time.monotonic() - received > _FRESH_TIME

    def _look_again(self) -> None:
        """Read the robot after a pause without commands: it may have sunk, and waiting samples are old."""
        with contextlib.suppress(Exception):
            began, state = time.monotonic(), self.platform.read()
            while state.received is not None and state.received < began and time.monotonic() < began + _FRESH_TIME:
                state = self.platform.read()
            if self.context is not None and np.isfinite(state.joint_position).all():
                self.context.state = self.state = state

    def _prepare(self) -> None:
        """Choose the next command of the motion or the ending; without one, end the motion or the run."""
        if self.over or (self.motion is None and self.ending is None):
            return
        try:
            self._upcoming = next(self._commands)
        except StopIteration:
            self._upcoming = None
            if self.ending is not None:
                self._release()
            self.motion = None
        except BaseException as error:  # a check before the first command fails; or the ending fails: damp the robot
            self.motion = self._upcoming = None
            self.end(error, controllable=self.ending is None)
            if not isinstance(error, Exception):
                raise

    def _commands_of(self, motion: MotionOrder) -> Iterator[JointCommand | None]:
        first = motion.trajectory.command(0)
        if self.context is None:
            while self.state is None or (self.state.received is not None and self._observed < _OBSERVE_TIME):
                yield None
            self._soft = True
            yield from self._take_over(self.state, first)
        self._soft = False
        test, phases = TiltTest(motion.stop, self.period), [e for e in motion.trajectory.events if e.name == PHASE]
        for index in range(len(motion.trajectory.position)):
            while phases and phases[0].time <= (index + 0.5) * self.period:
                self.phase = str(phases.pop(0).data.get("name"))
            yield motion.trajectory.command(index)
            state = self.state
            if state is None or test.reached(state.angular_velocity_in_imu[None], state.joint_position[None]):
                return

    def _take_over(self, state: RobotState, first: JointCommand) -> Iterator[JointCommand]:
        """Check the robot, then yield the soft start's commands; raise MotionError or FallError."""
        for check in self._at_rest:
            check(first, CheckContext(state, first, first, first, self._tilt_filter))
        here = JointCommand(state.joint_position)
        self.context = CheckContext(state, here, here, here, self._tilt_filter)
        limp = lies(self.robot, self.stance, state.joint_position)
        allowed = np.stack([self.robot.lower_limit, self.robot.upper_limit])
        yield from soft_start(first, state, self.own_gains, limp, self.period, allowed)

    # --- the end

    def _release(self) -> None:
        """Release the motors; no more commands are sent."""
        assert self.ending is not None
        try:
            self.platform.close()
            self.ending.done.append("released")
        except Exception as failure:
            self.ending.done.append(f"not released: {failure}")
            self.trouble = self.trouble or CommunicationError(
                f"the robot was not released: {failure}. Its motors may still hold it: use its own emergency stop"
            )
        self.over = True

    def report(self) -> GuardReport:
        """Return a copy of the report of the run so far."""
        report, hardware = replace(self._report, samples=replace(self._report.samples)), self._hardware
        report.largest_tilt = self._tilt_filter.largest
        report.ending = () if self.ending is None else tuple(self.ending.done)
        report.trouble = "" if self.trouble is None else str(self.trouble)
        report.unchecked = hardware is not None and hardware.unchecked
        if hardware is not None and hardware.lateness:
            report.late_999, report.work = float(np.quantile(hardware.lateness, 0.999)), float(np.median(hardware.work))
            report.latest = max(hardware.lateness)
            report.overruns, report.stalls = hardware.overruns, hardware.stalls
        return report
