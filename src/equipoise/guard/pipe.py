"""The private pipe between the calibration process and the robot process: objects both ways; neither waits for the other."""

from __future__ import annotations

import contextlib
import pickle
import socket
from typing import Any

_LENGTH = 4  # bytes before each object
_READ = 1 << 16  # bytes taken at once
_BUFFER = 1 << 22  # bytes that the system may keep; it may grant less


class Pipe:
    """One end of the pipe.

    Args:
        end: socket of a pair; nobody else can open it.

    Attributes:
        heard: whether the last `take` received anything, if only a part of an object.
    """

    def __init__(self, end: socket.socket) -> None:
        end.setblocking(False)
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER)
        self._socket = end
        self._coming, self._going = bytearray(), bytearray()
        self.heard = False

    def fileno(self) -> int:
        """Return the descriptor, to wait for what arrives."""
        return self._socket.fileno()

    def post(self, what: Any) -> None:
        """Send an object, as far as the system takes it now; the rest goes with the next `post` or `flush`.

        Raises:
            EOFError: the other end is closed.
        """
        data = pickle.dumps(what, pickle.HIGHEST_PROTOCOL)
        self._going += len(data).to_bytes(_LENGTH, "little") + data
        self.flush()

    def flush(self) -> bool:
        """Send what is left; return whether all of it was taken. Raises EOFError if the other end is closed."""
        try:
            while self._going:
                del self._going[: self._socket.send(self._going)]
        except BlockingIOError:
            return False
        except OSError as error:
            raise EOFError("the other process closed the pipe") from error
        return True

    def take(self) -> list[Any]:
        """Return the objects that have arrived whole. Raises EOFError once the other end is closed and all were returned."""
        ended = self.heard = False
        with contextlib.suppress(BlockingIOError):
            try:
                data = self._socket.recv(_READ)
            except ConnectionError:
                data = b""
            self._coming += data
            ended, self.heard = not data, bool(data)
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
