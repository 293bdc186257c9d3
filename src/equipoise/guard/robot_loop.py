"""The loop that owns a robot. `RobotLoop.tick` is one control period; nothing else commands the robot.

The same tick runs in the robot process, at a fixed rate with a real robot or an emulator, and in lockstep with a simulated
one.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.drivers.hardware import HardwarePlatform
from equipoise.errors import (
    CommunicationError,
    HealthError,
    OtherCommanderError,
    OverrunError,
    StopRequestedError,
)
from equipoise.guard.base_checks import BaseChecks
from equipoise.guard.clearance_checks import ClearanceChecks
from equipoise.guard.command_checks import CommandChecks
from equipoise.guard.endings import Ending
from equipoise.guard.force_limit import ForceLimit
from equipoise.guard.joint_checks import JointChecks
from equipoise.guard.known import Check, Known
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

_LOOK_TIME = 0.3  # [s] of samples before anything moves
_FRESH_TIME = 0.1  # [s] in which a sample must arrive after a while without commands
_SOUND = (HealthError, StopRequestedError, OverrunError)  # after a command: the robot itself is well
DAMP = "damp"
"""Request of a remote control, or of the operator, to damp the robot at once."""


@dataclass(frozen=True, eq=False)
class MotionOrder:
    """A motion that the loop is to make.

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
        motion: number of the motion to which the command belongs; 0: none.
        target: (nj,) joint position targets that were sent [rad], or None if nothing was sent.
        sent: time at which the command was sent, by the monotonic clock [s]; None in simulation.
        samples: accepted samples that arrived after the command.
    """

    motion: int = 0
    target: FloatArray | None = None
    sent: float | None = None
    samples: tuple[RobotState, ...] = ()


class RobotLoop:
    """A robot that is observed, moved, held and at last put down, one control period at a time.

    Args:
        platform: platform of the robot.
        robot: model of the robot.
        limits: limits that motions must keep.

    Attributes:
        known: state of the robot under command; None before the first command.
        state: newest accepted state; None before the first one.
        motion: motion that is being made, or None: the robot is held.
        phase: name of the phase of that motion.
        ending: ending that has begun, or None.
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
        self._up = TiltFilter(np.array(robot.imu_in_base.rotation))
        self._forces = ForceLimit(self._limits, robot, self.stance, (kp, kd), self.period)
        self._report = GuardReport(self._samples.counts)
        self._looked = 0.0
        self._commands: Iterator[JointCommand | None] = iter(())
        self._upcoming: JointCommand | None = None
        self._soft = False  # whether the upcoming command belongs to the soft start
        self._sent_at: float | None = None
        self._request = ""  # of the remote control, in the newest samples
        self.known: Known | None = None
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
        """Check a whole motion before it begins; raise MotionError, or SettingsError, if it must not be made."""
        self._command_checks.check_shape(trajectory.position[0])
        self._clear.check_ahead(trajectory)

    def move(self, motion: MotionOrder) -> None:
        """Make a motion, after a soft start if it is the first one. An ending that has begun goes on instead."""
        if self.ending is None:
            self.motion, self._commands = motion, self._commands_of(motion)
            self._prepare()

    def stop_motion(self) -> None:
        """End the present motion early; the robot is held where it was sent last."""
        self.motion, self._upcoming = None, None

    def end(self, error: BaseException | None, urgent: bool = False, sound: bool = True) -> None:
        """Begin to put the robot down.

        Args:
            error: error that ends the run; None: the run is over.
            urgent: whether to skip lowering it.
            sound: whether the robot obeys and stands. A robot that does not is damped at once.
        """
        self.trouble = self.trouble or error
        if isinstance(error, OverrunError) and self.ending is None:
            self._look_again()
        if self.ending is not None and sound:
            self.ending.urgent = self.ending.urgent or urgent
            return
        if self.ending is not None and self.ending.unsound:
            return
        done = [] if self.ending is None else self.ending.done
        if done:
            done[-1] += f", stopped: {error}"
        self.motion = None
        self.ending = Ending(self, sound, urgent, done)
        self._commands = self.ending.commands() if self._was_commanded else iter(())
        if isinstance(error, OtherCommanderError):
            self.ending.done.append("left to the other program")
            self._commands = iter(())
        self._prepare()

    # --- one control period

    def tick(self) -> Tick:
        """Run one control period: choose a command, check, bound and send it, wait, and check the samples that arrive."""
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
            if self.clocked:  # what fails at once would use up the ending's control periods at once
                time.sleep(max(0.0, due - time.monotonic()))
            self._fail(error, sound=not sent or isinstance(error, _SOUND))
        else:
            self._prepare()
        if self._request and not self.over:
            self.obey(self._request, "the remote control")
        return tick

    def _choose(self) -> tuple[JointCommand | None, int]:
        """Return the command of this period and the number of its motion; between motions the last command is held."""
        if self._upcoming is not None:
            return self._upcoming, 0 if self.motion is None or self._soft else self.motion.number
        return (None, 0) if self.known is None or self.ending is not None else (self.known.sent.held(), 0)

    def _checked(self, command: JointCommand) -> JointCommand:
        """Return the command with its force bounded; raise MotionError if it must not be sent."""
        assert self.known is not None
        if self.watched:
            for check in self._before:
                check(command, self.known)
            if self.own_gains is not None:
                return self._forces.bounded(command, self.known.state, self.known.lifted)
        return command

    def _step(self, command: JointCommand, bounded: JointCommand) -> RobotState:
        assert self.known is not None
        before, now = self._sent_at, time.monotonic()
        self._check_gap(before, now)
        self.known.sent, self.known.bounded, self._sent_at = command, bounded, now
        state = self.platform.step(bounded)
        if self._hardware is not None:
            self._sent_at = self._hardware.sent_at
        elif before is None:  # the first command may have waited for the robot's own controller
            self._sent_at = time.monotonic()
        if state.received is None:
            self._sent_at = None
        self._check_gap(before, self._sent_at)
        return state

    def _check_gap(self, before: float | None, now: float | None) -> None:
        """Raise OverrunError if too long a time passed between two commands."""
        if before is None or now is None or not self.watched or now - before <= self._limits.stall:
            return
        self._sent_at = now
        raise OverrunError(
            f"no command was sent for {(now - before) * 1000:.0f} ms while the robot was moved or held: the robot process was "
            "stopped, this computer was asleep, or other programs were in the way. See "
            "docs/hardware/safety.md#real-time-priority"
        )

    def _observe(self) -> tuple[RobotState, ...]:
        """Sense a robot that is not commanded yet."""
        if self.clocked:
            time.sleep(self.period)
        state = self.platform.read()
        silent = 0.0 if state.received is None else time.monotonic() - state.received
        if silent > self._limits.silence and self.ending is None:
            raise CommunicationError(
                f"no sample has arrived for {silent:.1f} s: is the robot still on, is the cable in?"
            )
        self._looked += self.period
        return self._accept(state, None)

    def _accept(self, state: RobotState, command: JointCommand | None) -> tuple[RobotState, ...]:
        """Return the samples that are fresh and plausible, oldest first; raise SensorError or CommunicationError."""
        arrived = [state] if self._hardware is None else self._hardware.arrived
        if self._hardware is not None:
            self._samples.counts.rejected = self._hardware.rejected
        target = None if command is None else command.position
        fresh = self._samples.accept(arrived, target, tolerant=not self.watched)
        for sample in fresh:
            self._up.update(sample)
        if fresh:
            self.state = max(fresh, key=lambda sample: sample.time)
            if self.known is not None:
                self.known.state = self.state
        if command is not None:
            self._report.note(state)
        if self.ending is not None:
            self.ending.observe(fresh)
        self._request = next((sample.request for sample in fresh if sample.request), "")
        return tuple(fresh)

    def obey(self, request: str, source: str) -> None:
        """Put the robot down as the operator asks: `DAMP` at once, anything else lowers it."""
        damp = request == DAMP
        how = "damp the robot" if damp else "lie down"
        self.end(StopRequestedError(f"{source} asked to {how}: the run was ended"), sound=not damp)

    def _check_after(self, command: JointCommand) -> None:
        assert self.known is not None
        if self.watched:
            for check in self._after:
                check(command, self.known)

    @property
    def watched(self) -> bool:
        """Return whether commands and samples are checked: not while the robot is damped."""
        return self.ending is None or not self.ending.unsound

    @property
    def waits(self) -> bool:
        """Return whether nothing has to be done: time passes only when the platform is stepped, and no motion is requested."""
        return self.state is not None and not self.clocked and self.motion is None and self.ending is None

    @property
    def clocked(self) -> bool:
        """Return whether the robot's time passes without steps: simulated platforms give no time of arrival."""
        return self.state is not None and self.state.received is not None

    @property
    def _was_commanded(self) -> bool:
        return self.known is not None and (self._hardware is None or self._hardware.commanded)

    def _fail(self, error: BaseException, sound: bool) -> None:
        """End by an error. An ending goes on: while the robot is damped, whatever fails; else while the robot is sound."""
        if self.ending is None:
            self.end(error, sound=sound)
            return
        self.ending.observe(())
        self.ending.urgent = self.ending.urgent or isinstance(error, KeyboardInterrupt)
        if self.ending.unsound or isinstance(error, (*_SOUND, KeyboardInterrupt)):  # the motor is still hot, say
            self._prepare()
        else:
            self.end(error, sound=False)

    def _look_again(self) -> None:
        """Sense a robot to which nothing was sent for a while: it may have sunk. What had arrived meanwhile is old."""
        with contextlib.suppress(Exception):
            began, state = time.monotonic(), self.platform.read()
            while state.received is not None and state.received < began and time.monotonic() < began + _FRESH_TIME:
                state = self.platform.read()
            if self.known is not None and np.isfinite(state.joint_position).all():
                self.known.state = self.state = state

    def _prepare(self) -> None:
        """Choose the next command of the motion or of the ending; without one, the motion or the run is over."""
        if self.over or (self.motion is None and self.ending is None):
            return
        try:
            self._upcoming = next(self._commands)
        except StopIteration:
            self._upcoming = None
            if self.ending is not None:
                self._release()
            self.motion = None
        except BaseException as error:  # the robot must not be taken over; or its ending fails, and it is damped
            self.motion = self._upcoming = None
            self.end(error, sound=self.ending is None)
            if not isinstance(error, Exception):
                raise

    def _commands_of(self, motion: MotionOrder) -> Iterator[JointCommand | None]:
        first = motion.trajectory.command(0)
        if self.known is None:
            while self.state is None or (self.state.received is not None and self._looked < _LOOK_TIME):
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
        """Begin to command the robot where it is, without a jolt; raise MotionError, SensorError or FallError before."""
        for check in self._at_rest:
            check(first, Known(state, first, first, first, self._up))
        here = JointCommand(state.joint_position)
        self.known = Known(state, here, here, here, self._up)
        limp = lies(self.robot, self.stance, state.joint_position)
        allowed = np.stack([self.robot.lower_limit, self.robot.upper_limit])
        yield from soft_start(first, state, self.own_gains, limp, self.period, allowed)

    # --- the end

    def _release(self) -> None:
        """Release the motors; nothing is commanded any more."""
        assert self.ending is not None
        try:
            self.platform.close()
            self.ending.done.append("released")
        except Exception as failure:
            self.ending.done.append(f"not released: {failure}")
            self.trouble = self.trouble or CommunicationError(
                f"the robot could not be released: {failure}. Its motors may still hold it: use its own emergency stop"
            )
        self.over = True

    def report(self) -> GuardReport:
        """Return what the run was like so far."""
        timing = None if self._hardware is None else self._hardware.timing
        done = () if self.ending is None else tuple(self.ending.done)
        trouble = "" if self.trouble is None else str(self.trouble)
        self._report.unchecked = self._hardware is not None and self._hardware.unchecked
        return self._report.with_end(timing, self._up.largest, done, trouble)
