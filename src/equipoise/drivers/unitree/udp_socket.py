"""UDP socket to a robot, with the system's arrival times of datagrams."""

from __future__ import annotations

import socket
import struct
import sys
import time

from equipoise.errors import CommunicationError

Address = tuple[str, int]

_BUFFER = 1 << 20  # [bytes] of the receive buffer; the system may grant less
_TIMESTAMPS = 35  # SO_TIMESTAMPNS, not defined in Python: the system stamps arriving datagrams
_TIMESTAMP = struct.Struct("@ll")  # seconds and nanoseconds
_LARGEST = 2048  # [bytes] of a datagram


def open_socket(local: Address, second: bool = False) -> socket.socket:
    """Open a non-blocking socket; only the second connection may share its port.

    Raises:
        CommunicationError: the port is taken.
    """
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    opened.setblocking(False)
    opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
    if sys.platform == "linux":
        opened.setsockopt(socket.SOL_SOCKET, _TIMESTAMPS, 1)
    try:
        if second:
            opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        opened.bind(local)
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    except OSError as error:
        opened.close()
        raise CommunicationError(
            f"cannot listen on {local[0]}:{local[1]}: {error.strerror or error}; does another program use the port? "
            "Set local_port or local_address to change it"
        ) from error
    return opened


def address_towards(robot: Address, name: str) -> str:
    """Return this computer's address in the robot's network.

    Args:
        robot: address of the robot.
        name: name of the connection, for the message.

    Raises:
        CommunicationError: the robot's network cannot be reached.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(robot)  # which sends nothing
        except OSError as error:
            raise send_error(name, error) from error
        return str(probe.getsockname()[0])


def send_error(name: str, error: OSError) -> CommunicationError:
    """Return the error of a failed transmission."""
    return CommunicationError(
        f"cannot send to {name}: {error.strerror or error}; is the cable plugged in, and has this computer an address "
        "in the robot's network, as in 192.168.123.162?"
    )


def receive(opened: socket.socket, ahead: float) -> tuple[float, bytes, Address] | None:
    """Return a waiting datagram: time of arrival on the monotonic clock [s], data, and sender; None: there is none.

    Args:
        opened: open socket.
        ahead: time by which the monotonic clock is ahead of the system clock, which stamps arrivals [s].
    """
    try:
        data, notes, _, sender = opened.recvmsg(_LARGEST, socket.CMSG_SPACE(_TIMESTAMP.size))
    except BlockingIOError:
        return None
    return _arrival(notes, ahead), data, sender


def _arrival(notes: list[tuple[int, int, bytes]], ahead: float) -> float:
    """Return the system's arrival time of a datagram, or the present time without a stamp."""
    for level, kind, value in notes:
        if level == socket.SOL_SOCKET and kind == _TIMESTAMPS and len(value) == _TIMESTAMP.size:
            seconds, nanoseconds = _TIMESTAMP.unpack(value)
            return seconds + ahead + 1e-9 * nanoseconds
    return time.monotonic()
