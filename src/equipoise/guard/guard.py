"""The guard: what stands between an experiment and a robot that can break.

It is a platform around a platform. Nothing passes it: `play` is stepped, every command is checked before it is sent, every
sample when it arrives: see `control_loop`. While nobody moves the robot it is held: see `held_robot`. Whatever goes wrong,
and however the program ends, the robot is put down: see `safe_ending`.
"""

from __future__ import annotations

import atexit
import contextlib
import time
from collections.abc import Callable, Generator
from dataclasses import replace

import numpy as np

from equipoise.errors import CommunicationError, MotionError
from equipoise.guard.control_loop import ControlLoop
from equipoise.guard.footing import feet_are_lifted, legs_are_up
from equipoise.guard.held_robot import HeldRobot
from equipoise.guard.limits import Limits
from equipoise.guard.report import GuardReport
from equipoise.guard.safe_ending import SafeEnding
from equipoise.guard.soft_start import soft_start
from equipoise.guard.watchdog import Watchdog
from equipoise.platform.interruptions import Interruptions
from equipoise.platform.piece_log import MotionLog, PieceLog
from equipoise.platform.platform import TURNS, JointCommand, MotionInterrupted, Platform, RobotState, Trajectory
from equipoise.platform.stepping import StepLog, following
from equipoise.platform.tilt_limit import TiltLimit, TiltTest
from equipoise.recording.recording import PHASE, Recording
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import lies, nominal_stance

_LOOK_TIME = 0.3  # [s] of samples before anything moves
_HANGS = 1.0  # [s] after which who steps hangs: it must not keep the motors from being released
_OVER = "the robot was put down and released; start again to move it"


class Guard:
    """A guarded robot. Use it as a context manager, in the main thread; leaving it, in whatever way, is the safe ending.

    Args:
        platform: platform to be guarded; the guard closes it.
        robot: model of the robot.
        limits: limits that a motion must keep.
        log: log of motions; it is told of each when it begins, and takes pieces of it every quarter of a second while
            it goes on.
        watchdog: function that starts what lets the robot down if this process dies or hangs; called when the robot is
            looked at first.

    Attributes:
        phase: name of the phase of the motion that is played, as its events have it.
    """

    def __init__(
        self,
        platform: Platform,
        robot: RobotModel,
        limits: Limits | None = None,
        log: MotionLog | None = None,
        watchdog: Callable[[], Watchdog] | None = None,
    ) -> None:
        self._platform, self._limits = platform, limits or Limits()
        self._robot, self._stance = robot, nominal_stance(robot)
        self._loop = ControlLoop(platform, robot, self._stance, self._limits)
        self._held = HeldRobot(self._loop, platform.control_period, self._limits.stall, self._end_held)
        self._start_watchdog = watchdog
        self._watchdog: Watchdog | None = None
        self._interruptions = Interruptions()
        self._ending = SafeEnding(
            self._held,
            robot,
            self._stance,
            self._loop.own_gains,
            platform.control_period,
            lambda: self._interruptions.asked,
        )
        self._log = PieceLog(log, platform.control_period)
        self._steps: StepLog | None = None
        self.phase = ""
        self._ended = False
        self._trouble: BaseException | None = None  # what went wrong while nobody moved the robot
        atexit.register(self.close)

    @property
    def control_period(self) -> float:
        return self._platform.control_period

    @property
    def joint_names(self) -> tuple[str, ...]:
        return self._platform.joint_names

    @property
    def accepts(self) -> frozenset[str]:
        return self._platform.accepts - {TURNS}  # what is stepped is not told of phases

    def read(self) -> RobotState:
        """As a platform's; raises what `step` raises, and the robot has been put down by then."""
        with self._ending_on_trouble(), self._held.turn():
            if self._trouble is not None:
                raise self._trouble
            self._be_watched()
            return self._held.read()

    def step(self, command: JointCommand) -> RobotState:
        """As a platform's. When it raises, the robot has been put down.

        Raises:
            LimitError: a joint, a motor or a command is beyond its limits.
            TrackingError: a joint does not follow.
            FallError: the base tilts.
            SensorError, CommunicationError: samples cannot be believed, or none arrive.
            OverrunError: this computer sent nothing for too long.
        """
        with self._ending_on_trouble(), self._interruptions.held():
            self._begin(command)
            self._steps = None  # the next motion does not follow on the last one
            return self._step(command)

    def play(self, trajectory: Trajectory, stop: TiltLimit | None = None) -> Recording:
        """As a platform's; raises what `step` raises, with what was recorded so far, and OutputError."""
        steps: StepLog | None = None
        try:
            with self._ending_on_trouble(), self._interruptions.held():
                self._check_going()
                self._loop.look_ahead(trajectory)
                self._begin(trajectory.command(0))
                ends = () if self._watchdog is None else trajectory.position[[0, -1]]
                legs_up = any(legs_are_up(self._robot, self._stance, end) for end in ends)
                test = TiltTest(stop, self.control_period)
                with self._held.moving():  # what takes time comes before: the first command's deadline is near
                    with self._held.turn():  # the thread that holds may have ended the run meanwhile
                        self._check_going()
                        self._tell_watchdog(legs_up)
                        steps = self._steps = StepLog(self, self._present(), self._steps)
                    self._play(trajectory, test, steps)
                # A robot on two feet does not wait for a disk.
                lifted = feet_are_lifted(self._robot, self._stance, trajectory.position[steps.count - 1])
                self._log.finish(wait=not lifted)
        except KeyboardInterrupt as interrupt:
            recorded = steps.recording(trajectory.events) if steps is not None and steps.count else None
            raise MotionInterrupted(recorded) from interrupt
        except MotionError as error:
            if steps is not None and steps.count and not error.recordings:
                error.recordings = (steps.recording(trajectory.events),)
            raise
        return steps.recording(trajectory.events)

    def close(self) -> None:
        """The safe ending of a robot that is well. May be called twice, and by any thread."""
        self._end(None)

    def report(self) -> GuardReport:
        """What the run was like so far."""
        report = self._loop.report(self._ending.done)
        return report if self._trouble is None else replace(report, trouble=str(self._trouble))

    def __enter__(self) -> Guard:
        self._interruptions.__enter__()
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        try:
            self._end(error)
        finally:
            self._interruptions.__exit__()

    # --- moving

    def _begin(self, first: JointCommand) -> None:
        """Before the first command: look, then take the robot over without a jolt."""
        self._check_going()
        if self._loop.known is not None:
            return
        self._be_watched()
        state = self._loop.read()
        if state.received is not None:
            for _ in range(round(_LOOK_TIME / self.control_period)):
                time.sleep(self.control_period)
                state = self._loop.read()
        self._loop.take_over(state, first)
        lying = lies(self._robot, self._stance, state.joint_position)
        allowed = np.stack([self._robot.lower_limit, self._robot.upper_limit])
        commands = soft_start(first, state, self._loop.own_gains, lying, self.control_period, allowed)
        for number, command in enumerate(commands):
            self._step(command)
            if number == 0 and state.received is not None:  # a simulated robot waits
                self._held.begin(self._watchdog)
            self._interruptions.check()

    def _be_watched(self) -> None:
        """Before anybody decides what to send: it takes seconds, in which limp legs slide."""
        if self._start_watchdog is not None and self._watchdog is None and not self._ended:
            self._watchdog = self._start_watchdog()
            self._watchdog.wait()

    def _play(self, trajectory: Trajectory, test: TiltTest, steps: StepLog) -> None:
        phases = [event for event in trajectory.events if event.name == PHASE]
        self._log.begin(steps, len(trajectory.position), trajectory.events)
        for index in range(len(trajectory.position)):
            while phases and phases[0].time <= (index + 0.5) * self.control_period:
                self.phase = str(phases.pop(0).data.get("name"))
            command = trajectory.command(index)
            state = steps.add(command.position, lambda command=command: self._step(command))
            self._log.step()
            self._interruptions.check()
            if test.reached(state.angular_velocity_in_imu[None], state.joint_position[None]):
                break

    def _tell_watchdog(self, legs_up: bool) -> None:
        """How the robot would have to be let down in this motion, and until the next one begins."""
        if self._watchdog is not None:
            self._watchdog.check()
            self._watchdog.legs_are_up(legs_up)

    def _step(self, command: JointCommand) -> RobotState:
        with self._held.turn():
            self._check_going()
            return self._held.step(command)

    def _check_going(self) -> None:
        """Whoever wants to move the robot hears why it was put down meanwhile."""
        if self._ended:
            raise self._trouble or MotionError(_OVER)

    def _present(self) -> RobotState:
        """The present state, and with it the last one of the motion before, which no recording has yet."""
        return following(self._held.present(), self._steps)

    # --- ending

    @contextlib.contextmanager
    def _ending_on_trouble(self) -> Generator[None]:
        """Put the robot down before anybody else hears of what happened."""
        try:
            yield
        except BaseException as error:
            self._end(error)
            raise

    def _end_held(self, error: BaseException) -> None:
        """By the thread that holds the robot."""
        self._trouble = error
        self._end(error)

    def _end(self, error: BaseException | None) -> None:
        """Put the robot down, release it, and see to it that what was recorded is written; once."""
        with self._interruptions.noted(), self._alone() as alone:
            if self._ended:
                return
            self._ended = True
            self._held.stop()
            atexit.unregister(self.close)
            failures: list[BaseException] = []
            let_go = [lambda: self._put_down(error), self._release] if alone else [self._leave]
            for act in (*let_go, self._keep_ending, self._log.close):
                try:
                    act()
                except BaseException as failure:  # nothing may keep the next act from being tried
                    failures.append(failure)
            if error is None and failures:
                raise failures[0]

    @contextlib.contextmanager
    def _alone(self) -> Generator[bool]:
        """Whether nobody else steps the robot: not if a thread hangs in a step; one that ends the run is waited for."""
        lock = self._held.lock
        alone = lock.acquire(timeout=_HANGS) or (self._ended and lock.acquire())
        try:
            yield alone
        finally:
            if alone:
                lock.release()

    def _put_down(self, error: BaseException | None) -> None:
        found = self._loop.known_after(error)
        if found is not None:
            steps = None if self._steps is None else StepLog(self, self._steps.state, self._steps)
            self._ending.put_down(found, steps)

    def _keep_ending(self) -> None:
        with contextlib.suppress(Exception):  # samples of a robot that went wrong may be no recording
            self._ending.keep(self._log)

    def _leave(self) -> None:
        """Of a robot whose link does not come back from a command: nobody else may use the link meanwhile.

        Released, it would drop. The watchdog, which gets no sign of life any more, damps it over a link of its own.
        """
        if self._watchdog is None:
            self._release()
            return
        self._ending.done.append("left to the watchdog")
        raise CommunicationError(
            f"the link has not come back from a command for {_HANGS:g} s, and the robot is left to the watchdog, which damps "
            "it. Its motors may still hold it: use its own emergency stop"
        )

    def _release(self) -> None:
        try:
            self._platform.close()
        except BaseException as failure:
            self._ending.done.append(f"not released: {failure}")
            raise CommunicationError(
                f"the robot could not be released: {failure}. Its motors may still hold it: use its own emergency stop"
            ) from failure
        self._ending.done.append("released")
        if self._watchdog is not None:  # not if the release failed
            self._watchdog.dismiss()
