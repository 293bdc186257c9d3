"""Platform of a real robot in the calibration process; the robot process sends its commands."""

from __future__ import annotations

import atexit
import contextlib
import gc
import os
import queue
import select
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from equipoise.drivers.platforms import open_second
from equipoise.errors import CommunicationError, MotionError
from equipoise.guard.endings import STILL, STILL_TIME, append_ending
from equipoise.guard.guard import PUT_DOWN
from equipoise.guard.limits import Limits
from equipoise.guard.pipe import Batch, End, Ended, Pipe, Ready, Setup
from equipoise.guard.report import GuardReport
from equipoise.guard.robot_loop import MotionOrder
from equipoise.guard.second_connection import SecondConnection
from equipoise.platform.interruptions import Interruptions, Terminated
from equipoise.platform.platform import TURNS, JointCommand, MotionInterrupted, RobotState, Trajectory
from equipoise.platform.realtime import claim_priority
from equipoise.platform.stepping import Recorder
from equipoise.platform.tilt_limit import TiltLimit
from equipoise.recording.event import PHASE, Event
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.recording.run_log import RunLog
from equipoise.robot.model import RobotModel
from equipoise.threads import ONE_THREAD

_STARTS = 60.0  # [s] on a busy computer
_HEARTBEAT = 0.02  # [s] between heartbeats
_POLL = 0.01  # [s] between checks of the robot process
_STOPPED, _SILENT = 0.02, 0.3  # [s] without a message: of a stopped process, of one that hangs
_FIRST = 5.0  # [s] for the first sample
_PIECE_TIME = 0.25  # [s] of a motion that are written at once
_ENDS = 60.0  # [s] for an ending


class RemoteRobot:
    """Robot that the robot process owns. Use it as a context manager, in the main thread; leaving it is the safe ending.

    A thread of this process sends heartbeats and receives the robot process's messages. It damps the robot over a second
    connection if that process is killed, stopped or hangs.

    Args:
        platform: name of the platform.
        robot: model of the robot.
        given: settings of the platform by name.
        log: log of motions.
        ending_file: path of the file to which the ending is appended.
        limits: limits of motions.
        realtime: whether the robot process claims real-time priority and locked memory.

    Attributes:
        realtime: real-time privileges that the system granted, in words.
        warning: warning that the robot has no second connection, or empty.

    Raises:
        SettingsError, MissingDependencyError: the connection cannot be opened.
        CommunicationError: the connection cannot be opened, or the robot process does not start or has another version.
    """

    def __init__(
        self,
        platform: str,
        robot: RobotModel,
        given: Mapping[str, Any],
        log: RunLog | None = None,
        ending_file: Path | None = None,
        limits: Limits | None = None,
        realtime: bool = True,
    ) -> None:
        self._robot, self._limits, self._log = robot, limits or Limits(), log
        self._ending_file = "" if ending_file is None else str(ending_file.absolute())
        self._interruptions = Interruptions()
        self._messages: queue.SimpleQueue[Batch | Ended] = queue.SimpleQueue()
        self._state: RobotState | None = None
        self._commanded = False  # whether a command was sent to the robot
        self._number, self._done, self._written = 0, 0, 0
        self._read = self._closed = False
        self._report: GuardReport | None = None
        self._trouble: BaseException | None = None
        self._ended = threading.Event()
        ours, theirs = socket.socketpair()
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "equipoise.guard.robot_process", str(theirs.fileno())],
                pass_fds=(theirs.fileno(),),
                env={**os.environ, **ONE_THREAD, "PYTHONPATH": os.pathsep.join(sys.path)},
                start_new_session=True,  # Ctrl-C is for this process
            )
        self._pipe, self._posting = Pipe(ours), threading.Lock()
        gc.collect()
        gc.freeze()  # a collection of all imported objects would delay heartbeats by 150 ms
        try:
            model = robot.name, robot.source, robot.description
            self._post(Setup(platform, dict(given), *model, self._limits, self._ending_file, realtime))
            ready = self._wait_until_ready()
        except BaseException:
            self._process.kill()
            self._process.wait()
            self._pipe.close()
            raise
        self.name, self.joint_names, self.control_period = ready.platform, ready.joint_names, ready.control_period
        self.accepts, self.realtime = ready.accepts - {TURNS}, ready.realtime
        self._recorder = Recorder(self.joint_names, self.control_period)
        self._second = SecondConnection(robot, lambda: open_second(platform, robot, {**given, **ready.learned}))
        self._last_message = time.monotonic()
        self._thread = threading.Thread(target=self._listen, name="robot", daemon=True)
        self._thread.start()
        try:
            self._second.open()
        except BaseException:
            self.close()
            raise
        self.warning = "" if self._second.ready else (
            f"platform {platform!r} has no second connection that accepts gains: if the robot process dies or hangs, only "
            "the robot's own motor boards can damp the joints. Keep the battery within reach"
        )  # fmt: skip
        atexit.register(self.close)

    # --- the platform

    def read(self) -> RobotState:
        """Return the newest state; raise the errors of `play`.

        The first call waits some seconds until the joints are at rest: limp legs slide.
        """
        until, before = time.monotonic() + _FIRST + self._limits.silence, None
        since = until
        while not self._read and not self._ended.is_set() and time.monotonic() < until:
            self._take_messages(wait=0.05)
            if self._state is None:
                continue
            here = self._state.joint_position
            if before is None or np.abs(here - before).max() > STILL:
                before, since = here, time.monotonic()
            self._read = time.monotonic() - since > STILL_TIME
        self._take_messages()
        self._require_going()
        if self._state is None:
            raise CommunicationError(
                f"{self.name} sent no sample for {_FIRST:g} s: is the robot on, and is its cable plugged in?"
            )
        self._read = True
        return self._state

    def step(self, command: JointCommand) -> RobotState:
        """Send one command; raise the errors of `play`."""
        self.play(Trajectory.of(command))
        assert self._state is not None
        return self._state

    def play(self, trajectory: Trajectory, stop: TiltLimit | None = None) -> Recording:
        """Play a motion. The recording is written to the log every quarter of a second.

        Raises:
            MotionInterrupted: Ctrl-C; carries the recording so far.
            MotionError: the robot was put down; carries the recording so far. See `Guard.step` for its types.
            OutputError: the log cannot be written.
        """
        try:
            with self._interruptions.held():
                self._play(trajectory, stop)
        except BaseException as error:
            self._end(error)
            raise
        return self._recorder.recording(trajectory.events)

    def close(self) -> None:
        """Put the robot down and end the robot process. May be called twice."""
        self._end(None)

    def report(self) -> GuardReport:
        """Return the report of the run; it is complete once the robot was put down."""
        return self._report or GuardReport(realtime=self.realtime)

    def stop(self, request: str) -> None:
        """Put the robot down at the operator's request, a value of `RobotState.request`; may be called from any thread."""
        self._post(End(request=request))

    def __enter__(self) -> RemoteRobot:
        self._interruptions.__enter__()
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        try:
            self._end(error)
        finally:
            self._interruptions.__exit__()

    # --- a motion

    def _play(self, trajectory: Trajectory, stop: TiltLimit | None) -> None:
        self._take_messages()
        self._require_going()
        self._recorder.begin()
        self._number, self._written = self._number + 1, 0
        if self._log is not None:
            self._log.begin(len(trajectory.position), trajectory.trial)
        stop_requested = None if stop is None else stop.stop_requested
        self._post(MotionOrder(self._number, trajectory, stop and replace(stop, stop_requested=None)))
        while self._done < self._number:
            self._take_messages(wait=0.05)
            self._write_piece(trajectory, whole=False)
            if stop_requested is not None and stop_requested():
                stop_requested = None
                self._post(self._number)
            self._raise_waiting_signal(trajectory)
            if self._ended.is_set():
                raise self._with_recording(self._trouble or MotionError(PUT_DOWN), trajectory)
        self._write_piece(trajectory, whole=True)

    def _take_messages(self, wait: float = 0.0) -> None:
        """Take what the robot process has sent; wait for something for a time [s]."""
        with contextlib.suppress(queue.Empty):
            message = self._messages.get(timeout=wait) if wait else self._messages.get_nowait()
            while True:
                if isinstance(message, Ended):
                    self._report, self._trouble = message.report, message.error or self._trouble
                    self._ended.set()
                else:
                    self._take_batch(message)
                message = self._messages.get_nowait()

    def _take_batch(self, batch: Batch) -> None:
        for tick in batch.ticks:
            target = tick.target if tick.motion == self._number else None
            self._recorder.take(target, tick.sent, tick.samples)
            if tick.samples:
                self._state = tick.samples[-1]
        self._done = batch.done

    def _write_piece(self, trajectory: Trajectory, whole: bool) -> None:
        new = self._recorder.count - self._written
        if self._log is None or new == 0 or (not whole and new * self.control_period < _PIECE_TIME):
            return
        piece = self._recorder.recording(trajectory.events, self._written)
        self._written = self._recorder.count
        self._log.add(piece)

    def _with_recording(self, error: BaseException, trajectory: Trajectory) -> BaseException:
        """Add the recording of the motion to an error, and return it."""
        self._write_piece(trajectory, whole=True)
        recorded = self._recorder.recorded(trajectory.events)
        if isinstance(error, MotionError) and recorded is not None and not error.recordings:
            error.recordings = (recorded,)
        return error

    def _raise_waiting_signal(self, trajectory: Trajectory) -> None:
        """Raise MotionInterrupted with the recording so far, if a signal waits."""
        try:
            self._interruptions.check()
        except KeyboardInterrupt as interrupt:
            self._write_piece(trajectory, whole=True)
            raise MotionInterrupted(self._recorder.recorded(trajectory.events)) from interrupt

    def _require_going(self) -> None:
        if self._ended.is_set():
            raise self._trouble or MotionError(PUT_DOWN)

    # --- the end

    def _end(self, error: BaseException | None) -> None:
        """Have the robot put down, and wait for it; a second signal or SIGTERM skips lowering it."""
        if self._closed:
            return
        with self._interruptions.noted():
            self._closed = True
            atexit.unregister(self.close)
            self._recorder.begin()
            self._number = 0  # the ending's commands belong to no motion
            urgent = any(isinstance(each, Terminated) for each in (error, error and error.__cause__))
            self._post(End(urgent=urgent))
            until = time.monotonic() + _ENDS
            while not self._ended.is_set() and time.monotonic() < until:
                self._take_messages(wait=0.05)
                if self._interruptions.asked and not urgent:
                    urgent = True
                    self._post(End(urgent=True))
            self._thread.join(timeout=_ENDS)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(timeout=2.0)
            self._pipe.close()
            self._second.close()
            gc.unfreeze()
            self._log_ending()

    def _log_ending(self) -> None:
        """Write the recording of the ending to the log."""
        if self._log is None or self._recorder.count < 2:
            return
        with contextlib.suppress(Exception):  # the run may have ended because of the disk
            self._log.begin(self._recorder.count)
            self._log.add(self._recorder.recording((Event(0.0, PHASE, {"name": Phase.ENDING}),)))

    # --- the robot process

    def _post(self, message: Any) -> None:
        """Send a message; `_listen` detects the end of the robot process."""
        with self._posting, contextlib.suppress(EOFError):
            self._pipe.post(message)

    def _wait_until_ready(self) -> Ready:
        until, last_heartbeat, failure = time.monotonic() + _STARTS, 0.0, f"was not ready within {_STARTS:g} s"
        while time.monotonic() < until:
            try:
                select.select([self._pipe], [], [], _POLL)
                for message in self._pipe.take():
                    if isinstance(message, Ready):
                        return message
                    if isinstance(message, Ended):
                        raise message.error or CommunicationError("the robot process ended before it was ready")
                if time.monotonic() - last_heartbeat > _HEARTBEAT:
                    last_heartbeat = time.monotonic()
                    self._post(None)
            except EOFError:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    self._process.wait(timeout=1.0)
                failure = f"died before it was ready (exit code {self._process.poll()})"
                break
        raise CommunicationError(
            f"the robot process {failure}; the robot was not moved. Check the connection with 'equipoise doctor'"
        )

    def _listen(self) -> None:
        """Send heartbeats and receive messages until the robot process ends or does not answer."""
        claim_priority()  # of this thread alone
        last_heartbeat = 0.0
        while not self._ended.is_set():
            select.select([self._pipe], [], [], _POLL)
            try:
                messages = self._pipe.take()
                now = time.monotonic()
                if now - last_heartbeat > _HEARTBEAT:
                    last_heartbeat = now
                    self._post(None)
            except (EOFError, OSError, ValueError):
                self._lose("died")
                return
            for message in messages:
                self._last_message = now
                if isinstance(message, Batch):
                    self._commanded = self._commanded or any(tick.target is not None for tick in message.ticks)
                self._messages.put(message)
                if isinstance(message, Ended):
                    return
            silent = now - self._last_message
            if self._commanded and (silent > _SILENT or (silent > _STOPPED and self._is_stopped())):
                self._lose("was stopped" if self._is_stopped() else f"sent nothing for {silent:.2f} s")
                return

    def _is_stopped(self) -> bool:
        """Return whether the robot process was stopped, as by Ctrl-Z."""
        flags = os.WSTOPPED | os.WEXITED | os.WNOHANG | os.WNOWAIT
        with contextlib.suppress(ChildProcessError):
            found = os.waitid(os.P_PID, self._process.pid, flags)
            return found is not None and found.si_code == os.CLD_STOPPED
        return False

    def _lose(self, how: str) -> None:
        """Kill a robot process that does not answer, so that it sends no commands, and damp the robot."""
        self._process.kill()
        done = self._second.damp() if self._commanded else "the robot had not been moved"
        error = CommunicationError(f"the robot process {how}; {done}")
        if self._commanded:
            append_ending(self._ending_file, str(error))
        report = GuardReport(realtime=self.realtime, ending=(done,), trouble=str(error))
        self._messages.put(Ended(error, report))
