"""Robot process: the sole owner of the bus. It observes, moves and holds the robot, and puts it down in any case.

    python -m equipoise.guard.robot_process DESCRIPTOR

`RemoteRobot` starts it and communicates with it over a socket pair. It puts the robot down when the calibration process
requests it, dies, closes the pipe or sends no heartbeat for `Limits.stall`.
"""

from __future__ import annotations

import contextlib
import dataclasses
import os
import signal
import socket
import sys
import time
import warnings
from typing import Any

from equipoise import _version
from equipoise.drivers.hardware import HardwarePlatform
from equipoise.drivers.platforms import for_platform, open_platform
from equipoise.errors import CommunicationError, EquipoiseError, MotionError, StoppedError
from equipoise.guard.endings import append_ending
from equipoise.guard.pipe import Batch, End, Ended, Pipe, Ready, Setup
from equipoise.guard.robot_loop import MotionOrder, RobotLoop, Tick
from equipoise.platform.platform import Platform
from equipoise.platform.realtime import claim_real_time
from equipoise.robot.model import RobotModel

_BATCH_TIME = 8e-3  # [s] of control periods in a batch
_RUNNABLE = 5  # times the limit, while the calibration process runs or waits for a processor
_SETUP_TIME = 20.0  # [s] in which the first message must come


class RobotProcess:
    """Robot loop with a pipe to the calibration process.

    Args:
        pipe: pipe to the calibration process.
        setup: first message.
        platform: platform of the robot.
        robot: model of the robot.
    """

    def __init__(self, pipe: Pipe, setup: Setup, platform: Platform, robot: RobotModel) -> None:
        self._pipe, self._setup = pipe, setup
        self._loop = RobotLoop(platform, robot, setup.limits)
        self._ticks: list[Tick] = []
        self._batch = max(1, round(_BATCH_TIME / platform.control_period))
        self._done = self._begun = 0
        self._idle = 0.0
        self._last_heartbeat = time.monotonic()
        self._terminated = False
        signal.signal(signal.SIGTERM, self._terminate)

    def run(self, realtime: str) -> None:
        """Run until the robot was put down and released; then report the ending to the pipe and the ending's file."""
        loop = self._loop
        while not loop.over:
            self._take_orders()
            if loop.waits:
                time.sleep(loop.period)
                self._ticks.append(Tick())
            else:
                self._ticks.append(loop.tick())
            self._post_batch()
        report = dataclasses.replace(loop.report(), realtime=realtime)
        if loop.context is not None:
            reason = f" ({report.trouble})" if report.trouble else ""
            append_ending(self._setup.ending_file, ", ".join(report.ending) + reason)
        with contextlib.suppress(EOFError):
            self._pipe.post(Batch(self._ticks, self._done))
            self._pipe.post(Ended(_sendable(loop.trouble), report))
            until = time.monotonic() + 1.0
            while not self._pipe.flush() and time.monotonic() < until:
                time.sleep(1e-3)

    def _take_orders(self) -> None:
        loop, orders, now = self._loop, [], time.monotonic()
        if self._terminated and loop.ending is None:
            loop.end(MotionError("the robot process received SIGTERM"))
        try:
            orders = self._pipe.take()
        except EOFError:
            if loop.ending is None:
                loop.end(CommunicationError("the calibration process died or closed the pipe"))
        # A robot whose time passes only when it is stepped needs no heartbeats.
        if self._pipe.received or not loop.clocked:
            self._last_heartbeat = now
        elif loop.ending is None and self._is_stalled(now - self._last_heartbeat):
            loop.end(
                StoppedError(
                    f"the calibration process sent no heartbeat for {now - self._last_heartbeat:.2f} s: it was stopped "
                    "(Ctrl-Z), or it blocks Python's other threads"
                )
            )
        for order in orders:
            if isinstance(order, MotionOrder):
                self._begun = order.number
                loop.move(order)
            elif isinstance(order, int) and loop.motion is not None and loop.motion.number == order:
                loop.stop_motion()
            elif isinstance(order, End) and order.request:
                loop.obey(order.request, "the operator")
            elif isinstance(order, End):
                loop.end(None, order.urgent)

    def _is_stalled(self, silence: float) -> bool:
        """Return whether the calibration process is stopped or blocked, or has run for too long without a heartbeat.

        On a busy computer it may wait for a processor for longer than `Limits.stall`; the robot is held if it is on four feet.
        """
        context = self._loop.context
        if silence < self._setup.limits.stall or (context is not None and context.lifted):
            return silence > self._setup.limits.stall
        with contextlib.suppress(OSError, IndexError), open(f"/proc/{os.getppid()}/stat", encoding="utf-8") as file:
            if file.read().rpartition(")")[2].split()[0] == "R":  # runs, or waits for a processor
                return silence > _RUNNABLE * self._setup.limits.stall
        return True

    def _post_batch(self) -> None:
        """Send the last control periods in batches, at once after a motion."""
        loop = self._loop
        waited = loop.motion is None and loop.ending is None and self._begun != self._done
        self._done = self._begun if waited else self._done
        self._idle = self._idle + loop.period if loop.motion is None and loop.context is not None else 0.0
        if self._idle > self._setup.limits.idle and loop.ending is None:
            loop.end(StoppedError(f"no motion was requested for {self._idle:.0f} s; the robot was lowered"))
        if waited or len(self._ticks) >= self._batch:
            with contextlib.suppress(EOFError):
                self._pipe.post(Batch(self._ticks, self._done))
            self._ticks = []

    def _terminate(self, *_: object) -> None:
        self._terminated = True


def main() -> int:
    """Open the connection and run. The calibration process handles Ctrl-C and a closed terminal."""
    for name in ("SIGINT", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    pipe = Pipe(socket.socket(fileno=int(sys.argv[1])))
    platform = None
    try:
        setup = _first_message(pipe)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            robot = RobotModel.from_source(setup.source, setup.name, setup.description)
        robot = for_platform(setup.platform, robot)
        # First, so that the threads of the connection inherit the priority.
        realtime = claim_real_time() if setup.realtime else "not requested"
        platform = open_platform(setup.platform, robot, setup.given)
        process = RobotProcess(pipe, setup, platform, robot)
        learned = platform.learn() if isinstance(platform, HardwarePlatform) else dict[str, Any]()
        name = str(getattr(platform, "name", setup.platform))
        pipe.post(Ready(name, platform.joint_names, platform.control_period, platform.accepts, learned, realtime))
    except Exception as error:
        if platform is not None:
            platform.close()
        with contextlib.suppress(EOFError):
            if not isinstance(error, EOFError):  # of the pipe: nothing receives the message
                pipe.post(Ended(_sendable(error), None))
        return 1
    process.run(realtime)
    return 0


def _sendable(error: BaseException | None) -> BaseException | None:
    """Return an error that the calibration process can unpickle."""
    if error is None or isinstance(error, EquipoiseError):
        return error
    return MotionError(f"the robot process failed ({type(error).__name__}: {error})")


def _first_message(pipe: Pipe) -> Setup:
    until = time.monotonic() + _SETUP_TIME
    while time.monotonic() < until:
        for message in pipe.take():
            if not isinstance(message, Setup) or message.version != _version.__version__:
                found = getattr(message, "version", "unknown")
                raise CommunicationError(
                    f"the robot process has version {_version.__version__}, the calibration process {found}: there are two "
                    "installations; remove one"
                )
            return message
        time.sleep(1e-3)
    raise EOFError


if __name__ == "__main__":
    sys.exit(main())
