"""Unitree A1 and Go1 over UDP. Beta: held against packets of the makers' SDKs, never tried on a real robot.

The robot must be in its low-level mode, lying or hanging: docs/hardware/unitree-a1-go1.md.
"""

from __future__ import annotations

import socket
import time
from collections import Counter, deque
from collections.abc import Mapping

import numpy as np

from equipoise.drivers.robot_clock import RobotClock, UnitSearch
from equipoise.drivers.unitree.form_search import FormSearch
from equipoise.drivers.unitree.motors import MOTORS, joints_of_motors
from equipoise.drivers.unitree.packet_formats import forms_of
from equipoise.drivers.unitree.packets import DAMAGES, NOT_CONTROLLED, CommandPacket, SensorReadings
from equipoise.drivers.unitree.remote_control import request_of
from equipoise.drivers.unitree.udp_settings import UnitreeUdpSettings
from equipoise.drivers.unitree.udp_socket import Address, address_towards, no_way, open_socket, receive
from equipoise.errors import CommunicationError, SettingsError
from equipoise.platform.platform import ACCEPTS_EVERYTHING, Health, JointCommand, RobotState
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import nominal_stance

CONTROL_PERIOD = 2e-3  # [s]
_KEPT = (
    64  # newest datagrams that wait until they are read: more of them are a flood, which must not delay a control loop
)
_FETCHED = 128  # datagrams that one call takes out of the socket: at 20,000 a second three times as many as arrive
_RELEASES = 5  # some may get lost
_PATIENCE = 3.0  # [s] of packets that cannot be used, and no other
_PAUSE = 0.1  # [s] without a look at the socket; who did not look heard no silence


class UnitreeUdpConnection:
    """Connection of a `HardwarePlatform` to a robot in low-level mode.

    Until the first command it is asked for samples by packets that set no torque: it answers whom it hears. By its answers are
    learnt the form of its packets and the unit of its clock; no sample is handed over and no command sent before. The system
    notes when datagrams arrive; they are fetched whenever something is sent or asked for, and read when samples are asked for.

    Args:
        robot: model of a robot with three joints a leg.
        settings: settings of an A1 or a Go1.
        beside: whether another process has the local port, and may hang: it is shared from the first command on, not
            before, for it takes what the robot sends away from the other one. The robot hears the sender that it knows.

    Attributes:
        counts: numbers of packets that arrived so far: "good" ones, those of each of `DAMAGES`, "from elsewhere", and "unread"
            ones, which were too old.

    Raises:
        SettingsError: the robot has other legs.
        CommunicationError: the local port is taken, or the robot's network cannot be reached.
    """

    def __init__(self, robot: RobotModel, settings: UnitreeUdpSettings, beside: bool = False) -> None:
        self._settings, self._beside = settings, beside
        self.name, self.joint_names = f"{settings.name} at {settings.address}:{settings.port}", robot.joint_names
        self.accepts, self.control_period = ACCEPTS_EVERYTHING, CONTROL_PERIOD
        self._joint_of_motor = joints_of_motors(robot, settings.name)
        self._motor_of_joint = np.argsort(self._joint_of_motor)
        self._own_gains = robot.gains(nominal_stance(robot).hip_height)
        forms = forms_of(settings.protocol, settings.form)
        self._packets = {name: CommandPacket(form) for name, form in forms.items()}
        self._passive = {name: bytes(packet.write(NOT_CONTROLLED)) for name, packet in self._packets.items()}
        self._forms = FormSearch(forms, settings.check)
        self._unit = UnitSearch()
        self._clock = None if settings.tick is None else RobotClock(settings.tick)
        self._untimed: list[tuple[SensorReadings, float]] = []
        self._robot: Address = (settings.address, settings.port)
        self._arrived: deque[tuple[float, bytes]] = deque(maxlen=_KEPT)
        self._opened = self._looked = self._since = time.monotonic()
        self._heard: float | None = None
        self._asked: float | None = 0.0
        self.counts: Counter[str] = Counter()
        self.unchecked = not settings.check
        self._closed = False
        self._opened_socket = None if beside else self._open_socket()

    @property
    def rejected(self) -> int:
        """Number of packets that arrived and were left out: damaged, or from elsewhere."""
        return sum(self.counts[kind] for kind in (*DAMAGES, "from elsewhere"))

    def learn(self) -> Mapping[str, str]:
        """Settings that the robot's answers tell; raises CommunicationError if it does not answer."""
        return {"form": self._spoken()}

    def receive(self) -> list[RobotState]:
        """Return the samples that have arrived; raise CommunicationError also if only packets arrive that cannot be used."""
        if self._asked is not None:
            self._ask()
        self._fetch()
        states: list[tuple[SensorReadings, float]] = []
        while self._arrived:
            received, data = self._arrived.popleft()
            if self._looked - received > self._settings.silence:  # what the system kept while nobody looked
                self.counts["unread"] += 1
                continue
            state = self._forms.read(data)
            if isinstance(state, str):
                self.counts[state] += 1
            else:
                states.append((state, received))
        self._note(states)
        return self._samples(states)

    def send(self, command: JointCommand) -> None:
        """Send a command; wait until the robot has answered, and raise CommunicationError if it does not."""
        if len(command.position) != MOTORS:
            raise SettingsError(f"commands for {len(command.position)} joints; {self.name} has {MOTORS}")
        packet = self._packets[self._spoken()]
        self._asked = None
        self._transmit(packet.write(JointCommand(*command.table(*self._own_gains)[:, self._joint_of_motor])))
        self._fetch()

    def release(self) -> None:
        """No torque; the motors' own watchdog sees to it that it stays so."""
        self._asked = None
        forms = self._passive if self._forms.learnt is None else (self._forms.learnt,)
        for _ in range(0 if self._closed else _RELEASES):
            for form in forms:
                self._transmit(self._passive[form])
            time.sleep(CONTROL_PERIOD)

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
        local = self._settings.local_address or address_towards(self._robot, self.name)
        return open_socket((local, self._settings.listens_on), self._beside)

    def _ask(self) -> None:
        """For a sample, once a control period, in the form that is known or tried."""
        now = time.monotonic()
        if self._asked is None or now - self._asked >= CONTROL_PERIOD:
            self._asked = now
            if (form := self._forms.asks_in(now)) is not None:
                self._transmit(self._passive[form])

    def _spoken(self) -> str:
        """The form that the robot speaks; who commands without having sensed waits for it here."""
        until = time.monotonic() + _PATIENCE
        while self._forms.learnt is None:
            if time.monotonic() > until:
                self.receive()  # complains if it answers what cannot be understood
                raise CommunicationError(
                    f"{self.name} has answered to no packets ({', '.join(self._packets)}) in {_PATIENCE:g} s: is it on, in "
                    "low-level mode, and the cable in? 'form' says which packets it speaks, if you know"
                )
            self._ask()
            self._fetch()
            time.sleep(CONTROL_PERIOD / 4)
        return self._forms.learnt

    def _fetch(self) -> None:
        """Take what has arrived out of the socket."""
        now = time.monotonic()
        if now - self._looked > _PAUSE:
            self._since = now
        before, self._looked, ahead = self._looked, now, now - time.time()
        for _ in range(_FETCHED):
            try:
                datagram = receive(self._socket, ahead)
            except OSError as error:
                raise CommunicationError(f"cannot hear {self.name}: {error.strerror or error}") from error
            if datagram is None:
                return
            received, data, sender = datagram
            if sender != self._robot:
                self.counts["from elsewhere"] += 1
                continue
            self.counts["unread"] += len(self._arrived) == _KEPT
            received = min(max(received, before), now)  # the system's clock may have been set meanwhile
            self._forms.hear(data, received)
            self._arrived.append((received, data))

    def _transmit(self, data: bytes | bytearray) -> None:
        try:
            self._socket.sendto(data, self._robot)
        except BlockingIOError:
            return  # the network is busy: as good as lost on the way
        except OSError as error:
            raise no_way(self.name, error) from error

    def _samples(self, states: list[tuple[SensorReadings, float]]) -> list[RobotState]:
        """With times; those that arrive before the unit of the robot's clock is known come as soon as it is."""
        if self._clock is None:
            self._untimed += states
            for state, received in states:
                self._unit.hear(state.tick, received)
            if self._unit.learnt is None:
                return []
            self._clock, states, self._untimed = RobotClock(self._unit.learnt), self._untimed, []
        return [self._sample(state, self._clock.time(state.tick, received), received) for state, received in states]

    def _sample(self, state: SensorReadings, taken: float, received: float) -> RobotState:
        order = self._motor_of_joint
        return RobotState(
            taken,
            state.position[order],
            state.velocity[order],
            state.torque[order],
            state.gyroscope,
            state.accelerometer,
            received=received,
            health=Health(state.temperature[order], state.battery_voltage, state.battery_charge),
            request=request_of(state.keys),
        )

    def _note(self, states: list[tuple[SensorReadings, float]]) -> None:
        """Keep count; complain when the robot has fallen silent, or cannot be understood."""
        self.counts["good"] += len(states)
        now = time.monotonic()
        if states:
            self._heard = states[-1][1]
        elif self._heard is None:
            if now - self._opened > _PATIENCE and self.rejected:
                damaged = "".join(f"{self.counts[kind]} of {kind}, " for kind in DAMAGES if self.counts[kind])
                raise CommunicationError(
                    f"{self.name} cannot be understood: of what arrived in {_PATIENCE:g} s, {self.counts['good']} good, "
                    f"{damaged}{self.counts['from elsewhere']} from elsewhere. Is it the right kind of robot, and its port? "
                    "'check = false' takes samples with wrong checksums"
                )
        elif (silent := now - max(self._heard, self._since)) > self._settings.silence:
            raise CommunicationError(
                f"{self.name} has been silent for {silent:.1f} s: is the robot on, is the cable in?"
            )


def open_connection(robot: RobotModel, settings: UnitreeUdpSettings) -> UnitreeUdpConnection:
    """Open the connection to an A1 or a Go1; the settings determine which."""
    return UnitreeUdpConnection(robot, settings)


def open_beside(robot: RobotModel, settings: UnitreeUdpSettings) -> UnitreeUdpConnection:
    """Open the second connection, as `open_second` of `drivers/platforms.py` describes it."""
    return UnitreeUdpConnection(robot, settings, beside=True)
