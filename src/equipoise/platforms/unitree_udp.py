"""Unitree A1 and Go1 over UDP. Beta: tried against a simulated robot that speaks their packets, never on a real one.

The robot must be in its low-level mode, lying or hanging: docs/unitree-udp.md.
"""

from __future__ import annotations

import socket
import struct
import sys
import threading
import time
from collections import Counter, deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from equipoise.errors import CommunicationError, SettingsError
from equipoise.platforms.platform import ACCEPTS_EVERYTHING, Health, JointCommand, RobotState
from equipoise.platforms.robot_clock import RobotClock
from equipoise.platforms.unitree_packets import CommandPacket, Damage, LowState, MotorCommands, read_state
from equipoise.platforms.unitree_udp_settings import UnitreeUdpSettings
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import nominal_stance
from equipoise.robot.unitree_motors import MOTORS, joints_of_motors

FloatArray = NDArray[np.float64]
Address = tuple[str, int]

_CONTROL_PERIOD = 2e-3  # [s]
_KEPT = 512  # datagrams that wait while nobody reads: a second's
_LARGEST = 2048  # [bytes] of a datagram
_BUFFER = 1 << 20  # [bytes] of datagrams that the system may keep for us; it may grant less
_RELEASES = 5  # some may get lost
_PATIENCE = 3.0  # [s] of packets that cannot be used, and no other
_PAUSE = 0.1  # [s] without a look at the socket; who did not look heard no silence
_TIMESTAMPS = 35  # SO_TIMESTAMPNS, which Python has no name for: the system notes when a datagram arrived
_TIMESTAMP = struct.Struct("@ll")  # seconds and nanoseconds


@dataclass
class PacketCounts:
    """What arrived.

    Attributes:
        samples: good packets.
        damaged: others from the robot, by what is wrong with them.
        strangers: datagrams from elsewhere.
        unread: that were too old when somebody looked.
    """

    samples: int = 0
    damaged: Counter[Damage] = field(default_factory=Counter[Damage])
    strangers: int = 0
    unread: int = 0

    def __str__(self) -> str:
        damaged = [f"{count} of {kind.value}" for kind, count in self.damaged.items()]
        return ", ".join([f"{self.samples} good", *damaged, f"{self.strangers} from elsewhere"])


class UnitreeUdpLink:
    """To a robot in low-level mode: the link of a `HardwarePlatform`.

    Until the first command it is asked for samples by packets that set no torque: it answers whom it hears. The system notes
    when datagrams arrive; they are fetched whenever something is sent or asked for, and read when samples are asked for.

    Args:
        robot: with three joints a leg.
        settings: of an A1 or a Go1.
        beside: another process has the local port, and may hang: it is shared from the first command on, not before, for it
            takes what the robot sends away from the other one. The robot hears the sender that it knows.

    Attributes:
        counts: what arrived so far.

    Raises:
        SettingsError: the robot has other legs.
        CommunicationError: the local port is taken.
    """

    def __init__(self, robot: RobotModel, settings: UnitreeUdpSettings, beside: bool = False) -> None:
        self._settings, self._beside = settings, beside
        self._joint_names = robot.joint_names
        self._joint_of_motor = joints_of_motors(robot, settings.name)
        self._motor_of_joint = np.argsort(self._joint_of_motor)
        kp, kd = robot.gains(nominal_stance(robot).hip_height)
        self._kp, self._kd = np.full(MOTORS, kp), np.full(MOTORS, kd)
        self._zeros = np.zeros(MOTORS)
        self._packets = settings.packets
        self._packet = CommandPacket(self._packets)
        self._passive = bytes(CommandPacket(self._packets).write(MotorCommands.without_torque()))
        self._clock = RobotClock(settings.tick)
        self._robot: Address = (settings.address, settings.port)
        self._arrived: deque[tuple[float, bytes]] = deque(maxlen=_KEPT)
        self._opened = self._looked = self._since = time.monotonic()
        self._heard: float | None = None
        self._asked: float | None = 0.0
        self.counts = PacketCounts()
        self._closed = False
        self._fetching = threading.Lock()
        self._opened_socket = None if beside else self._open_socket()

    @property
    def name(self) -> str:
        return f"{self._settings.name} at {self._settings.address}:{self._settings.port}"

    @property
    def joint_names(self) -> tuple[str, ...]:
        return self._joint_names

    @property
    def accepts(self) -> frozenset[str]:
        return ACCEPTS_EVERYTHING

    @property
    def control_period(self) -> float:
        return _CONTROL_PERIOD

    def receive(self) -> list[RobotState]:
        """As a link's; raises CommunicationError also if only packets arrive that cannot be used."""
        if self._asked is not None and time.monotonic() - self._asked >= _CONTROL_PERIOD:
            self._asked = time.monotonic()
            self._transmit(self._passive)
        self._fetch()
        samples: list[RobotState] = []
        while self._arrived:
            received, data = self._arrived.popleft()
            if self._looked - received > self._settings.silence:  # what the system kept while nobody looked
                self.counts.unread += 1
                continue
            state = read_state(self._packets, data, self._settings.check)
            if isinstance(state, Damage):
                self.counts.damaged[state] += 1
            else:
                samples.append(self._sample(state, received))
        self._note(samples)
        return samples

    def send(self, command: JointCommand) -> None:
        if len(command.position) != MOTORS:
            raise SettingsError(f"commands for {len(command.position)} joints; {self.name} has {MOTORS}")
        self._asked = None
        self._transmit(self._packet.write(self._for_motors(command)))
        self._fetch()

    def release(self) -> None:
        """No torque; the motors' own watchdog sees to it that it stays so."""
        self._asked = None
        for _ in range(0 if self._closed else _RELEASES):
            self._transmit(self._passive)
            time.sleep(_CONTROL_PERIOD)

    def close(self) -> None:
        self._closed = True
        if self._opened_socket is not None:
            self._opened_socket.close()

    @property
    def _socket(self) -> socket.socket:
        if self._opened_socket is None:
            self._opened_socket = self._open_socket()
        return self._opened_socket

    def _open_socket(self) -> socket.socket:
        return _open_socket((self._settings.local_address, self._settings.listens_on), self._beside)

    def _fetch(self) -> None:
        """Take what has arrived out of the socket; two threads may want that."""
        with self._fetching:
            now = time.monotonic()
            if now - self._looked > _PAUSE:
                self._since = now
            self._looked, ahead = now, now - time.time()
            for _ in range(_KEPT):
                try:
                    data, notes, _, sender = self._socket.recvmsg(_LARGEST, socket.CMSG_SPACE(_TIMESTAMP.size))
                except BlockingIOError:
                    return
                except OSError as error:
                    raise CommunicationError(f"cannot hear {self.name}: {error.strerror or error}") from error
                if sender != self._robot:
                    self.counts.strangers += 1
                    continue
                self.counts.unread += len(self._arrived) == _KEPT
                self._arrived.append((_noted(notes, ahead), data))

    def _transmit(self, data: bytes | bytearray) -> None:
        try:
            self._socket.sendto(data, self._robot)
        except BlockingIOError:
            return  # the network is busy: as good as lost on the way
        except OSError as error:
            raise CommunicationError(
                f"cannot send to {self.name}: {error.strerror or error}; is the cable in, and has this computer an address "
                "in the robot's network, as in 192.168.123.162?"
            ) from error

    def _for_motors(self, command: JointCommand) -> MotorCommands:
        order = self._joint_of_motor
        return MotorCommands(
            command.position[order],
            self._zeros if command.velocity is None else command.velocity[order],
            self._zeros if command.torque is None else command.torque[order],
            self._kp if command.kp is None else command.kp[order],
            self._kd if command.kd is None else command.kd[order],
        )

    def _sample(self, state: LowState, received: float) -> RobotState:
        order = self._motor_of_joint
        return RobotState(
            self._clock.time(state.tick, received),
            state.position[order],
            state.velocity[order],
            state.torque[order],
            state.gyroscope,
            state.accelerometer,
            received=received,
            health=Health(state.temperature[order], state.battery_voltage, state.battery_charge),
        )

    def _note(self, samples: list[RobotState]) -> None:
        """Keep count; complain when the robot has fallen silent, or cannot be understood."""
        self.counts.samples += len(samples)
        now = time.monotonic()
        if samples:
            self._heard = samples[-1].received
        elif self._heard is None:
            if now - self._opened > _PATIENCE and (self.counts.damaged or self.counts.strangers):
                raise CommunicationError(
                    f"{self.name} cannot be understood: of what arrived in {_PATIENCE:g} s, {self.counts}. Is it the right "
                    "kind of robot, and its port? 'check = false' takes samples with wrong checksums"
                )
        elif (silent := now - max(self._heard, self._since)) > self._settings.silence:
            raise CommunicationError(
                f"{self.name} has been silent for {silent:.1f} s: is the robot on, is the cable in?"
            )


def open_link(robot: RobotModel, settings: UnitreeUdpSettings) -> UnitreeUdpLink:
    """A link to an A1 or a Go1, which one the settings say."""
    return UnitreeUdpLink(robot, settings)


def open_beside(robot: RobotModel, settings: UnitreeUdpSettings) -> UnitreeUdpLink:
    """The same, for a watchdog: `platforms/catalog.py` says what that is."""
    return UnitreeUdpLink(robot, settings, beside=True)


def _open_socket(local: Address, beside: bool) -> socket.socket:
    """A socket that has its port alone, and shares it afterwards with one that is opened beside it; with no other."""
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


def _noted(notes: list[tuple[int, int, bytes]], ahead: float) -> float:
    """When a datagram arrived by the monotonic clock [s], which is so much ahead of the system's; now, if nobody noted it."""
    for level, kind, value in notes:
        if level == socket.SOL_SOCKET and kind == _TIMESTAMPS and len(value) == _TIMESTAMP.size:
            seconds, nanoseconds = _TIMESTAMP.unpack(value)
            return seconds + ahead + 1e-9 * nanoseconds
    return time.monotonic()
