"""A second process that lets the robot down if this one dies without a word: kill -9, a crash, a program that hangs.

Nothing that a process does can end safely a process that is gone. So the watchdog reads a pipe: while something comes, all is
well; when nothing has come for too long, or the pipe ends without a goodbye, it connects to the robot itself and damps the
joints until the robot has sunk to the floor.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import select
import subprocess
import sys
import time
import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np

from equipoise.errors import EquipoiseError
from equipoise.platforms.platform import JointCommand
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import nominal_stance

_BEAT, _MOVES, _GOODBYE = b".", b"m", b"q"
_PATIENCE = 2.0  # [s] without a sign of life; garbage collection and page faults take less
_DAMPED = 3.0  # [s]
_DAMPING = 2.0  # of the model's kd


class Watchdog:
    """This side of it. Begins to watch with the first command.

    Args:
        platform: name of the driver.
        robot: what is known about the robot.
        given: the driver's settings.
    """

    def __init__(self, platform: str, robot: RobotModel, given: Mapping[str, Any]) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "equipoise.platforms.watchdog"],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C is for the program, and the program says goodbye
        )
        known = pickle.dumps((platform, robot.source, robot.name, robot.description, dict(given)))
        self._say(len(known).to_bytes(4, "little") + known)

    def moves(self) -> None:
        """From now on the robot must not be left alone."""
        self._say(_MOVES)

    def beat(self) -> None:
        """A sign of life."""
        self._say(_BEAT)

    def dismiss(self) -> None:
        """The robot was released: there is nothing to watch any more."""
        self._say(_GOODBYE)
        if self._process.stdin is not None:
            with contextlib.suppress(OSError):
                self._process.stdin.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout=5.0)

    def _say(self, what: bytes) -> None:
        stdin = self._process.stdin
        if stdin is not None:
            with contextlib.suppress(OSError, ValueError):  # a watchdog that died is no reason to drop the robot
                stdin.write(what)
                stdin.flush()


def main() -> int:
    """The other side."""
    pipe = sys.stdin.fileno()
    size = int.from_bytes(_exactly(pipe, 4), "little")
    platform, source, name, description, given = pickle.loads(_exactly(pipe, size))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        robot = RobotModel(source, name, description)
    _, kd = robot.gains(nominal_stance(robot).hip_height)
    moves = False
    while True:
        ready, _, _ = select.select([pipe], [], [], _PATIENCE)
        said = os.read(pipe, 4096) if ready else b""
        if _GOODBYE in said:
            return 0
        moves = moves or _MOVES in said
        if not said:
            if moves:
                _let_down(platform, robot, given, kd)
            if not ready and not moves:
                continue
            return 1


def _let_down(platform: str, robot: RobotModel, given: Mapping[str, Any], kd: float) -> None:
    """Damp the joints by a connection of one's own."""
    from equipoise.platforms.catalog import open_link  # noqa: PLC0415 - the catalogue starts watchdogs

    try:
        link = open_link(platform, robot, given)
    except EquipoiseError as error:
        print(f"watchdog: the program is gone and the robot cannot be reached: {error}", file=sys.stderr)
        return
    if "gains" not in link.accepts:  # it holds where it was sent last
        link.close()
        return
    print("watchdog: the program is gone; the joints are damped", file=sys.stderr)
    zeros = np.zeros(len(robot.joint_names))
    limp = JointCommand(zeros, kp=zeros, kd=np.full_like(zeros, _DAMPING * kd))
    end = time.monotonic() + _DAMPED
    while time.monotonic() < end:
        with contextlib.suppress(EquipoiseError, OSError):
            link.send(limp)
        time.sleep(link.control_period)
    link.release()
    link.close()


def _exactly(pipe: int, size: int) -> bytes:
    """So many bytes, or as many as there are before the pipe ends."""
    got = b""
    while len(got) < size and (part := os.read(pipe, size - len(got))):
        got += part
    return got


if __name__ == "__main__":
    sys.exit(main())
