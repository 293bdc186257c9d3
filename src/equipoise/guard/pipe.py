"""Private pipe between the calibration process and the robot process, and its messages.

Objects go both ways; neither process waits for the other.
"""

from __future__ import annotations

import contextlib
import pickle
import socket
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from equipoise import _version
from equipoise.guard.limits import Limits
from equipoise.guard.report import GuardReport
from equipoise.guard.robot_loop import Tick
from equipoise.robot.description import RobotDescription
from equipoise.robot.source import ModelSource

_LENGTH = 4  # bytes before each object
_READ = 1 << 16  # bytes per read
_BUFFER = 1 << 22  # bytes of the send buffer; the system may grant less


class Pipe:
    """One end of the pipe.

    Args:
        end: socket of a pair; no other process can open it.

    Attributes:
        received: whether the last `take` received anything, even part of an object.
    """

    def __init__(self, end: socket.socket) -> None:
        end.setblocking(False)
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER)
        self._socket = end
        self._coming, self._going = bytearray(), bytearray()
        self.received = False

    def fileno(self) -> int:
        """Return the descriptor, to wait for data."""
        return self._socket.fileno()

    def post(self, message: Any) -> None:
        """Send an object, as far as the buffer allows; the rest goes with the next `post` or `flush`.

        Raises:
            EOFError: the other end is closed.
        """
        data = pickle.dumps(message, pickle.HIGHEST_PROTOCOL)
        self._going += len(data).to_bytes(_LENGTH, "little") + data
        self.flush()

    def flush(self) -> bool:
        """Send the rest; return whether all of it was sent. Raise EOFError if the other end is closed."""
        try:
            while self._going:
                del self._going[: self._socket.send(self._going)]
        except BlockingIOError:
            return False
        except OSError as error:
            raise EOFError("the other process closed the pipe") from error
        return True

    def take(self) -> list[Any]:
        """Return the complete objects that arrived. Raise EOFError if the other end is closed and none are left."""
        ended = self.received = False
        with contextlib.suppress(BlockingIOError):
            try:
                data = self._socket.recv(_READ)
            except ConnectionError:
                data = b""
            self._coming += data
            ended, self.received = not data, bool(data)
        objects: list[Any] = []
        while len(self._coming) >= _LENGTH:
            end = _LENGTH + int.from_bytes(self._coming[:_LENGTH], "little")
            if len(self._coming) < end:
                break
            objects.append(pickle.loads(memoryview(self._coming)[_LENGTH:end].tobytes()))
            del self._coming[:end]
        if ended and not objects:
            raise EOFError("the other process closed the pipe")
        return objects

    def close(self) -> None:
        """Close this end."""
        self._socket.close()


# --- to the robot process


@dataclass(frozen=True, eq=False)
class Setup:
    """First message. Other messages in this direction: a `MotionOrder`, the number of a motion to end early, `End`, and
    None as a heartbeat.

    Attributes:
        platform, given: name and settings of the platform.
        name, source, description: robot model.
        limits: limits of motions.
        ending_file: path of the file to which the ending is appended; empty: none.
        realtime: whether to claim real-time priority and locked memory.
        version: version of the calibration process.
    """

    platform: str
    given: Mapping[str, Any]
    name: str
    source: ModelSource
    description: RobotDescription
    limits: Limits
    ending_file: str = ""
    realtime: bool = True
    version: str = field(default=_version.__version__)


@dataclass(frozen=True, eq=False)
class End:
    """Request to put the robot down.

    Attributes:
        urgent: whether to skip lowering the robot.
        request: request of the operator, as `RobotState.request`; empty: none.
    """

    urgent: bool = False
    request: str = ""


# --- from the robot process


@dataclass(frozen=True, eq=False)
class Ready:
    """Message that the connection is open.

    Attributes:
        platform: name of the platform in messages.
        joint_names, control_period, accepts: as a platform's.
        learned: detected settings, for the second connection.
        realtime: real-time privileges that the system granted, in words.
    """

    platform: str
    joint_names: tuple[str, ...]
    control_period: float
    accepts: frozenset[str]
    learned: Mapping[str, Any]
    realtime: str


@dataclass(frozen=True, eq=False)
class Batch:
    """Control periods since the last batch.

    Attributes:
        ticks: events of each control period.
        done: number of the last completed motion.
    """

    ticks: list[Tick]
    done: int


@dataclass(frozen=True, eq=False)
class Ended:
    """Last message: the robot was put down, or never moved.

    Attributes:
        error: error that ended the run, or None.
        report: report of the run; None if the connection was never opened.
    """

    error: BaseException | None
    report: GuardReport | None
