"""The robot process: sole owner of the bus. It observes, moves and holds the robot, and puts it down, whatever else happens.

    python -m equipoise.guard.robot_process DESCRIPTOR

`RemoteRobot` starts it, and is the only one it talks to, over one end of a socket pair. It ends the robot safely when the
calibration process asks for it, dies, closes the pipe or gives no sign of life for `Limits.stall`.
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
from equipoise.errors import CommunicationError, EquipoiseError, MotionError, OverrunError
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
    """The robot loop, and the pipe to the calibration process.

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
        self._last_sign = time.monotonic()
        self._terminated = False
        signal.signal(signal.SIGTERM, self._terminate)

    def run(self, realtime: str) -> None:
        """Run until the robot was put down and released; then say so, and append it to the ending's file."""
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
        if loop.known is not None:
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
            loop.end(MotionError("the robot process was asked to end (SIGTERM)"))
        try:
            orders = self._pipe.take()
        except EOFError:
            if loop.ending is None:
                loop.end(CommunicationError("the calibration process died or closed the pipe"))
        # A robot whose time passes only when it is stepped is never left alone.
        if self._pipe.heard or not loop.clocked:
            self._last_sign = now
        elif loop.ending is None and self._is_stalled(now - self._last_sign):
            loop.end(
                OverrunError(
                    f"the calibration process gave no sign of life for {now - self._last_sign:.2f} s: it was stopped "
                    "(Ctrl-Z), or it does not let Python's other threads run"
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
        """Return whether the calibration process is stopped, blocked, or has run for too long without a sign of life.

        On a busy computer it may wait for a processor for longer than `Limits.stall`; a robot on four feet is held meanwhile.
        """
        known = self._loop.known
        if silence < self._setup.limits.stall or (known is not None and known.lifted):
            return silence > self._setup.limits.stall
        with contextlib.suppress(OSError, IndexError), open(f"/proc/{os.getppid()}/stat", encoding="utf-8") as file:
            if file.read().rpartition(")")[2].split()[0] == "R":  # runs, or waits for a processor
                return silence > _RUNNABLE * self._setup.limits.stall
        return True

    def _post_batch(self) -> None:
        """Send the last control periods, at once if a motion is over."""
        loop = self._loop
        waited = loop.motion is None and loop.ending is None and self._begun != self._done
        self._done = self._begun if waited else self._done
        self._idle = self._idle + loop.period if loop.motion is None and loop.known is not None else 0.0
        if self._idle > self._setup.limits.idle and loop.ending is None:
            loop.end(OverrunError(f"no motion was asked for in {self._idle:.0f} s; the robot was lowered"))
        if waited or len(self._ticks) >= self._batch:
            with contextlib.suppress(EOFError):
                self._pipe.post(Batch(self._ticks, self._done))
            self._ticks = []

    def _terminate(self, *_: object) -> None:
        self._terminated = True


def main() -> int:
    """Open the connection, and run. Ctrl-C and a closed terminal are for the calibration process."""
    for name in ("SIGINT", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    pipe = Pipe(socket.socket(fileno=int(sys.argv[1])))
    try:
        setup = _first_message(pipe)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            robot = RobotModel.from_source(setup.source, setup.name, setup.description)
        robot = for_platform(setup.platform, robot)
        # First, so that the threads of the connection inherit the priority.
        realtime = claim_real_time() if setup.realtime else "not asked for"
        platform = open_platform(setup.platform, robot, setup.given)
    except EOFError:
        return 1
    except Exception as error:
        with contextlib.suppress(EOFError):
            pipe.post(Ended(_sendable(error), None))
        return 1
    try:
        process = RobotProcess(pipe, setup, platform, robot)
        learned = platform.learn() if isinstance(platform, HardwarePlatform) else dict[str, Any]()
        name = str(getattr(platform, "name", setup.platform))
        pipe.post(Ready(name, platform.joint_names, platform.control_period, platform.accepts, learned, realtime))
    except Exception as error:
        platform.close()
        with contextlib.suppress(EOFError):
            pipe.post(Ended(_sendable(error), None))
        return 1
    process.run(realtime)
    return 0


def _sendable(error: BaseException | None) -> BaseException | None:
    """Return an error that the calibration process knows."""
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
                    f"the robot process is version {_version.__version__}, the calibration process {found}: they are two "
                    "installations; install one"
                )
            return message
        time.sleep(1e-3)
    raise EOFError


if __name__ == "__main__":
    sys.exit(main())
