"""Unitree A1 and Go1 over UDP. Beta: tested against packets of the makers' SDKs, not on a real robot.

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
from equipoise.drivers.unitree.udp_socket import Address, address_towards, open_socket, receive, send_error
from equipoise.errors import CommunicationError, SettingsError
from equipoise.platform.platform import ACCEPTS_EVERYTHING, Health, JointCommand, RobotState
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import nominal_stance

CONTROL_PERIOD = 2e-3  # [s]
_KEPT = 64  # newest datagrams that are kept until they are decoded: a flood of them must not delay a control loop
_FETCHED = 128  # datagrams per read of the socket: at 20,000 a second three times as many as arrive
_RELEASES = 5  # some may get lost
_PATIENCE = 3.0  # [s] with invalid packets only
_PAUSE = 0.1  # [s] between reads of the socket; a longer pause does not count as the robot's silence


class UnitreeUdpConnection:
    """Connection of a `HardwarePlatform` to a robot in low-level mode.

    Until the first command, packets without torque request samples: the robot answers each packet. Its answers determine the
    form of its packets and the unit of its clock; before that no sample is returned and no command sent. The system stamps
    arriving datagrams; they are fetched at every call, and decoded in `receive`.

    Args:
        robot: model of a robot with three joints a leg.
        settings: settings of an A1 or a Go1.
        second: whether another process has the local port, and may hang. The port is shared from the first command on, not
            earlier, because it diverts the robot's packets from the other process. The robot receives the known sender.

    Attributes:
        counts: numbers of received packets: "good" ones, those of each of `DAMAGES`, "from elsewhere", and "unread" ones,
            which were too old.

    Raises:
        SettingsError: the robot has other legs.
        CommunicationError: the local port is taken, or the robot's network cannot be reached.
    """

    def __init__(self, robot: RobotModel, settings: UnitreeUdpSettings, second: bool = False) -> None:
        self._settings, self._second = settings, second
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
        self._last_received: float | None = None
        self._requested: float | None = 0.0
        self.counts: Counter[str] = Counter()
        self.unchecked = not settings.check
        self._closed = False
        self._opened_socket = None if second else self._open_socket()

    @property
    def rejected(self) -> int:
        """Number of rejected packets: damaged, or from elsewhere."""
        return sum(self.counts[kind] for kind in (*DAMAGES, "from elsewhere"))

    def learn(self) -> Mapping[str, str]:
        """Return the settings that the robot's answers determine; raise CommunicationError if it does not answer."""
        return {"form": self._form()}

    def receive(self) -> list[RobotState]:
        """Return the samples that have arrived; raise CommunicationError also if only invalid packets arrive."""
        if self._requested is not None:
            self._request()
        self._fetch()
        states: list[tuple[SensorReadings, float]] = []
        while self._arrived:
            received, data = self._arrived.popleft()
            if self._looked - received > self._settings.silence:  # kept by the system during a pause
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
        packet = self._packets[self._form()]
        self._requested = None
        self._transmit(packet.write(JointCommand(*command.table(*self._own_gains)[:, self._joint_of_motor])))
        self._fetch()

    def release(self) -> None:
        """Send packets without torque; the motors' own watchdog maintains this."""
        self._requested = None
        forms = self._passive if self._forms.form is None else (self._forms.form,)
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
        return open_socket((local, self._settings.listens_on), self._second)

    def _request(self) -> None:
        """Request a sample, once per control period, in the detected form or the next one to test."""
        now = time.monotonic()
        if self._requested is None or now - self._requested >= CONTROL_PERIOD:
            self._requested = now
            if (form := self._forms.request_form(now)) is not None:
                self._transmit(self._passive[form])

    def _form(self) -> str:
        """Return the robot's packet form; wait for its detection."""
        until = time.monotonic() + _PATIENCE
        while self._forms.form is None:
            if time.monotonic() > until:
                self.receive()  # raises if the robot's answers are invalid
                raise CommunicationError(
                    f"{self.name} has answered no packets ({', '.join(self._packets)}) in {_PATIENCE:g} s: is it on, in "
                    "low-level mode, and the cable plugged in? Set 'form' to its packet form if you know it"
                )
            self._request()
            self._fetch()
            time.sleep(CONTROL_PERIOD / 4)
        return self._forms.form

    def _fetch(self) -> None:
        """Read the arrived datagrams from the socket."""
        now = time.monotonic()
        if now - self._looked > _PAUSE:
            self._since = now
        before, self._looked, ahead = self._looked, now, now - time.time()
        for _ in range(_FETCHED):
            try:
                datagram = receive(self._socket, ahead)
            except OSError as error:
                raise CommunicationError(f"cannot receive from {self.name}: {error.strerror or error}") from error
            if datagram is None:
                return
            received, data, sender = datagram
            if sender != self._robot:
                self.counts["from elsewhere"] += 1
                continue
            self.counts["unread"] += len(self._arrived) == _KEPT
            received = min(max(received, before), now)  # the system's clock may have been set meanwhile
            self._forms.add(data, received)
            self._arrived.append((received, data))

    def _transmit(self, data: bytes | bytearray) -> None:
        try:
            self._socket.sendto(data, self._robot)
        except BlockingIOError:
            return  # the network is busy: equivalent to a lost packet
        except OSError as error:
            raise send_error(self.name, error) from error

    def _samples(self, states: list[tuple[SensorReadings, float]]) -> list[RobotState]:
        """Return samples with times; keep them until the unit of the robot's clock is detected."""
        if self._clock is None:
            self._untimed += states
            for state, received in states:
                self._unit.add(state.tick, received)
            if self._unit.unit is None:
                return []
            self._clock, states, self._untimed = RobotClock(self._unit.unit), self._untimed, []
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
        """Count packets; raise CommunicationError for a silent robot or only invalid packets."""
        self.counts["good"] += len(states)
        now = time.monotonic()
        if states:
            self._last_received = states[-1][1]
        elif self._last_received is None:
            if now - self._opened > _PATIENCE and self.rejected:
                damaged = "".join(f"{self.counts[kind]} of {kind}, " for kind in DAMAGES if self.counts[kind])
                raise CommunicationError(
                    f"{self.name} sends no valid packets: in {_PATIENCE:g} s {self.counts['good']} good, "
                    f"{damaged}{self.counts['from elsewhere']} from elsewhere. Is it the right kind of robot, and its port? "
                    "'check = false' accepts samples with wrong checksums"
                )
        elif (silent := now - max(self._last_received, self._since)) > self._settings.silence:
            raise CommunicationError(
                f"{self.name} has been silent for {silent:.1f} s: is the robot on, and is the cable plugged in?"
            )


def open_connection(robot: RobotModel, settings: UnitreeUdpSettings) -> UnitreeUdpConnection:
    """Open the connection to an A1 or a Go1; the settings determine which."""
    return UnitreeUdpConnection(robot, settings)


def open_second_connection(robot: RobotModel, settings: UnitreeUdpSettings) -> UnitreeUdpConnection:
    """Open the second connection; see `open_second` of `drivers/platforms.py`."""
    return UnitreeUdpConnection(robot, settings, second=True)
