"""A second process that lets the robot down if this one dies without a word or hangs: kill -9, a crash, Ctrl-Z, a loop.

Nothing that a process does can end safely a process that is gone. So the watchdog reads a pipe: while something comes, all is
well; when nothing has come for too long, or the pipe ends without a goodbye, it damps the joints by a connection of its own
until the robot has sunk to the floor. It has that connection before the robot moves, and says what it did afterwards: a
terminal that is gone, too, must not keep it from anything.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import select
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from equipoise.drivers.hardware import Link
from equipoise.errors import CommunicationError
from equipoise.guard.footing import damping_time
from equipoise.platform.platform import JointCommand
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import nominal_stance

_BEAT, _MOVES, _GOODBYE, _READY = b".", b"m", b"q", b"r"
_LEGS = {True: b"u", False: b"d"}
_PATIENCE = 2.0  # [s] without a sign of life; the guard lets a hung program's robot down before
_REACHED = 15.0  # [s] in which a command must go out
_AGAIN = 1.0  # [s] after which a connection over which nothing goes out is made anew
_STARTS = 60.0  # [s] on a busy computer


class Watchdog:
    """This side of it.

    Args:
        platform: name of the driver.
        robot: model of the robot.
        given: the driver's settings.
        log: path of the file for what it did, made if it did something; its standard error is this program's and may be
            gone by then.
    """

    def __init__(self, platform: str, robot: RobotModel, given: Mapping[str, Any], log: Path | None = None) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "equipoise.guard.watchdog"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            bufsize=0,
            start_new_session=True,  # Ctrl-C is for the program, and the program says goodbye
        )
        path = None if log is None else str(log.absolute())
        known = pickle.dumps((platform, robot.source, robot.name, robot.description, dict(given), path))
        self._say(len(known).to_bytes(4, "little") + known)

    def wait(self) -> None:
        """Until it watches; raises CommunicationError if it cannot: then the robot is not moved."""
        stdout = self._process.stdout
        ready = stdout is not None and select.select([stdout], [], [], _STARTS)[0]
        if not ready or stdout is None or stdout.read(1) != _READY:
            raise CommunicationError(
                f"the watchdog, which lets the robot down if this program dies, did not start within {_STARTS:g} s: nothing "
                "was moved. What it says itself stands above; 'equipoise doctor' looks at the connection"
            )
        if self._process.stdin is not None:  # one that hangs must not keep the robot waiting
            os.set_blocking(self._process.stdin.fileno(), False)

    def check(self) -> None:
        """Before a motion; raises CommunicationError if it watches no longer."""
        if self._process.poll() is not None:
            raise CommunicationError(
                "the watchdog, which lets the robot down if this program dies, has ended itself (exit code "
                f"{self._process.returncode}): start again"
            )

    def moves(self) -> None:
        """From now on the robot must not be left alone."""
        self._say(_MOVES)

    def legs_are_up(self, up: bool) -> None:
        """Whether legs of a lying robot are turned up in the motion that begins: damped, they come down slowly."""
        self._say(_LEGS[up])

    def beat(self) -> None:
        """A sign of life."""
        self._say(_BEAT)

    def dismiss(self) -> None:
        """The robot was released: there is nothing to watch any more."""
        self._say(_GOODBYE)
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with contextlib.suppress(OSError):
                    pipe.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout=5.0)

    def _say(self, what: bytes) -> None:
        rest = what
        with contextlib.suppress(OSError, ValueError):  # a watchdog that died is no reason to drop the robot
            while rest and self._process.stdin is not None:
                rest = rest[self._process.stdin.write(rest) or len(rest) :]


@dataclass
class _Hand:
    """What the watchdog holds the robot by.

    Attributes:
        platform, robot, given: name, model and settings, as the watchdog has them.
        link: link to the robot; None: to be opened when it is needed.
    """

    platform: str
    robot: RobotModel
    given: Mapping[str, Any]
    link: Link | None = None

    def open(self) -> Link:
        """The link, opened if it is not."""
        from equipoise.drivers.catalog import open_beside  # noqa: PLC0415 - drivers import much

        if self.link is None:
            self.link = open_beside(self.platform, self.robot, self.given)
        return self.link

    def drop(self) -> None:
        """Close the link."""
        with contextlib.suppress(Exception):
            if self.link is not None:
                self.link.close()
        self.link = None

    def let_down(self, legs_up: bool) -> str:
        """Damp the joints, from the first command that goes out until the robot has sunk; what was done, in words."""
        zeros, stance = np.zeros(len(self.robot.joint_names)), nominal_stance(self.robot)
        kd = self.robot.gains(stance.hip_height)[1]
        limp = JointCommand(zeros, kp=zeros, kd=np.full_like(zeros, kd))
        sent, trouble = 0, "nothing went out"
        opened = time.monotonic()
        until = opened + _REACHED
        while (now := time.monotonic()) < until:
            try:
                link = self.open()
                if "gains" not in link.accepts:
                    return "it holds where it was sent last: it takes no gains"
                link.send(limp)
                until = until if sent else now + damping_time(stance, legs_up)
                sent += 1
                opened = now
                time.sleep(link.control_period)
            except Exception as error:
                trouble = str(error)
                if now - opened > _AGAIN:
                    self.drop()
                    opened = now
                time.sleep(2e-3)
        with contextlib.suppress(Exception):
            self.open().release()
        self.drop()
        return f"its joints were damped ({sent} commands)" if sent else f"the robot could not be damped: {trouble}"


def main() -> int:
    """The other side. What ends the program, or all of its service, is not to end this before the robot is down."""
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    pipe = sys.stdin.fileno()
    size = int.from_bytes(_exactly(pipe, 4), "little")
    platform, source, name, description, given, log = pickle.loads(_exactly(pipe, size))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        hand = _Hand(platform, RobotModel.from_source(source, name, description), given)
    nominal_stance(hand.robot)  # computed before it is needed
    hand.open()
    os.write(sys.stdout.fileno(), _READY)
    why, legs_up = _watch(pipe)
    if why is None:
        hand.drop()
        return 0
    _tell(f"watchdog: {why}; {hand.let_down(legs_up)}", log)
    return 1


def _watch(pipe: int) -> tuple[str | None, bool]:
    """Until the robot needs to be let down: why, None if it does not; and whether its legs are up."""
    moves = legs_up = False
    while True:
        ready, _, _ = select.select([pipe], [], [], _PATIENCE)
        said = os.read(pipe, 4096) if ready else b""
        moves = moves or _MOVES in said
        up, down = said.rfind(_LEGS[True]), said.rfind(_LEGS[False])
        legs_up = legs_up if up == down else up > down
        if _GOODBYE in said or (ready and not said and not moves):
            return None, legs_up
        if moves and not said:
            return "the program is gone" if ready else f"the program gave no sign of life for {_PATIENCE:g} s", legs_up


def _tell(what: str, log: str | None) -> None:
    """Where somebody may read it; whatever is gone of that."""
    with contextlib.suppress(Exception):
        if log is not None:
            with open(log, "a", encoding="utf-8") as file:
                print(f"{time.strftime('%Y-%m-%d %H:%M:%S')} {what}", file=file)
    with contextlib.suppress(Exception):
        print(what, file=sys.stderr, flush=True)


def _exactly(pipe: int, size: int) -> bytes:
    """So many bytes, or as many as there are before the pipe ends."""
    got = b""
    while len(got) < size and (part := os.read(pipe, size - len(got))):
        got += part
    return got


if __name__ == "__main__":
    sys.exit(main())
