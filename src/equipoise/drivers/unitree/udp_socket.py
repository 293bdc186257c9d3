"""A UDP socket on the way to a robot, and when the system says that datagrams arrived."""

from __future__ import annotations

import socket
import struct
import sys
import time

from equipoise.errors import CommunicationError

Address = tuple[str, int]

_BUFFER = 1 << 20  # [bytes] of datagrams that the system may keep for us; it may grant less
_TIMESTAMPS = 35  # SO_TIMESTAMPNS, which Python has no name for: the system notes when a datagram arrived
_TIMESTAMP = struct.Struct("@ll")  # seconds and nanoseconds
_LARGEST = 2048  # [bytes] of a datagram


def open_socket(local: Address, beside: bool = False) -> socket.socket:
    """Open a socket that never waits; it shares its port with the second connection alone.

    Raises:
        CommunicationError: the port is taken.
    """
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    opened.setblocking(False)
    opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
    if sys.platform == "linux":
        opened.setsockopt(socket.SOL_SOCKET, _TIMESTAMPS, 1)
    try:
        if beside:
            opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        opened.bind(local)
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    except OSError as error:
        opened.close()
        raise CommunicationError(
            f"cannot listen on {local[0]}:{local[1]}: {error.strerror or error}; does another program talk to the robot? "
            "local_port and local_address choose others"
        ) from error
    return opened


def address_towards(robot: Address, name: str) -> str:
    """Return this computer's address towards a robot, which cannot be reached from another network.

    Args:
        robot: address of the robot.
        name: name of the link, for the message.

    Raises:
        CommunicationError: the robot's network cannot be reached.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(robot)  # which sends nothing
        except OSError as error:
            raise no_way(name, error) from error
        return str(probe.getsockname()[0])


def no_way(name: str, error: OSError) -> CommunicationError:
    """Return the error that nothing can be sent."""
    return CommunicationError(
        f"cannot send to {name}: {error.strerror or error}; is the cable in, and has this computer an address "
        "in the robot's network, as in 192.168.123.162?"
    )


def receive(opened: socket.socket, ahead: float) -> tuple[float, bytes, Address] | None:
    """A datagram that waits: when it arrived by the monotonic clock [s], what, and from where; None: there is none.

    Args:
        opened: socket that was opened.
        ahead: time by which the monotonic clock is ahead of the system's, which notes arrivals [s].
    """
    try:
        data, notes, _, sender = opened.recvmsg(_LARGEST, socket.CMSG_SPACE(_TIMESTAMP.size))
    except BlockingIOError:
        return None
    return _arrival(notes, ahead), data, sender


def _arrival(notes: list[tuple[int, int, bytes]], ahead: float) -> float:
    """Return the time at which the system noted the arrival of a datagram; now, if it did not."""
    for level, kind, value in notes:
        if level == socket.SOL_SOCKET and kind == _TIMESTAMPS and len(value) == _TIMESTAMP.size:
            seconds, nanoseconds = _TIMESTAMP.unpack(value)
            return seconds + ahead + 1e-9 * nanoseconds
    return time.monotonic()
