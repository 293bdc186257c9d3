"""Emulator of an A1 or Go1 with their UDP packets, over a network that loses, repeats and reorders them.

    equipoise lab emulate unitree-udp --protocol go1 --robot unitree_a1 --loss 0.02 --reorder 0.02

It works with any quadruped with three joints per leg, with one packet format. As the real robots do, it answers the first
address that sends a valid command in that format. It sends nothing before, and ignores other packets.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Callable

import numpy as np

from equipoise.drivers.unitree.motors import MOTORS, joints_of_motors
from equipoise.drivers.unitree.packet_formats import forms_of
from equipoise.drivers.unitree.packets import SensorReadings
from equipoise.drivers.unitree.remote_control import keys_of
from equipoise.drivers.unitree.udp import CONTROL_PERIOD
from equipoise.drivers.unitree.udp_socket import Address
from equipoise.errors import SettingsError
from equipoise.lab.emulators.faults import ActiveFaults, FaultySamples
from equipoise.lab.emulators.options import UnitreeUdpOptions
from equipoise.lab.emulators.udp_packets import StatePacket, read_command
from equipoise.lab.emulators.unitree_motors import of_motor_boards
from equipoise.platform.platform import JointCommand, RobotState
from equipoise.robot.model import RobotModel

_VOLTAGE = 24.96  # [V] of a Go1's battery
_LARGEST = 2048  # [bytes] of a datagram
_MOST_OVERTAKING = 4  # largest number of packets that overtake another
_RAMP_STEP = 0.25  # [s] between log lines of gains


class FaultyNetwork:
    """Network in one direction."""

    def __init__(self, options: UnitreeUdpOptions, direction: int) -> None:
        self._options = options
        self._draw = np.random.default_rng([options.network_seed, direction])
        self._late: list[tuple[int, bytes]] = []
        self._passed = 0

    def carry(self, packet: bytes) -> list[bytes]:
        """Return the packets that arrive when one is sent: none, one or several, some of them sent before."""
        shares = self._options.loss, self._options.duplicate, self._options.reorder
        lost, doubled, overtaken = self._draw.random(3) < shares
        self._passed += 1
        due = [late for until, late in self._late if until <= self._passed]
        self._late = [(until, late) for until, late in self._late if until > self._passed]
        if lost:
            return due
        copies = [packet] * (2 if doubled else 1)
        if overtaken:
            self._late.append((self._passed + int(self._draw.integers(1, _MOST_OVERTAKING + 1)), copies.pop()))
        return copies + due


class UnitreeUdpWire:
    """Robot side of the protocol.

    Args:
        robot: model of the simulated robot.
        options: settings of the protocol and of the network.
        log: function that logs an entry.
    """

    def __init__(self, robot: RobotModel, options: UnitreeUdpOptions, log: Callable[..., None]) -> None:
        self._options, self._log = options, log
        self._joint_of_motor = joints_of_motors(robot, "the protocol")
        self._motor_of_joint = np.argsort(self._joint_of_motor)
        self._packets = next(iter(forms_of(options.protocol, options.form).values()))
        self._packet, self._faulty = StatePacket(self._packets), FaultySamples(CONTROL_PERIOD)
        self._inward, self._outward = FaultyNetwork(options, 0), FaultyNetwork(options, 1)
        self._client: Address | None = None
        self._gains: tuple[float, float] | None = None
        self._gains_logged = -np.inf
        self._position = np.zeros(MOTORS)
        self.received = self.damaged = self.sent = 0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.bind((options.address, options.port))

    def commands(self) -> list[JointCommand]:
        """Return the commands as in `Wire`. Packets without torque before the first other packet only request samples."""
        commands: list[JointCommand] = []
        for data in self._arrived():
            read = read_command(self._packets, data)
            if isinstance(read, str):
                self.damaged += 1
                continue
            self.received += 1
            if self._gains is not None or not _requests_samples(read):
                commands.append(self._for_joints(read))
        return commands

    def publish(self, state: RobotState, faults: ActiveFaults) -> None:
        self._position = state.joint_position
        if self._client is None:
            return
        packet = bytes(self._packet.write(self._from_joints(state, faults)))
        for sample in self._faulty.sent(packet, faults):
            for data in self._outward.carry(sample):
                self._socket.sendto(data, self._client)
                self.sent += 1

    def close(self) -> None:
        self._log(received=self.received, damaged=self.damaged, sent=self.sent)
        self._socket.close()

    def _arrived(self) -> list[bytes]:
        arrived: list[bytes] = []
        while True:
            try:
                data, sender = self._socket.recvfrom(_LARGEST)
            except (BlockingIOError, ConnectionError):
                return arrived
            if self._client is None and not isinstance(read_command(self._packets, data), str):
                self._client = sender
                self._log(client=sender)
            arrived += self._inward.carry(data) if sender == self._client else []

    def _for_joints(self, motors: JointCommand) -> JointCommand:
        """Return the command that the motor boards execute."""
        table = motors.table(0.0, 0.0)[:, self._motor_of_joint]
        self._note_gains((round(float(table[3].mean()), 3), round(float(table[4].mean()), 3)))
        return of_motor_boards(table, self._position, np.ones(MOTORS, dtype=bool))

    def _note_gains(self, gains: tuple[float, float]) -> None:
        """Log new gains, at most once per ramp step."""
        if gains != self._gains and time.monotonic() - self._gains_logged > _RAMP_STEP:
            self._gains_logged = time.monotonic()
            self._log(kp=gains[0], kd=gains[1])
            self._gains = gains

    def _from_joints(self, state: RobotState, faults: ActiveFaults) -> SensorReadings:
        order = self._joint_of_motor
        velocity, torque, tick = state.joint_velocity, state.joint_torque, self._options.tick
        if velocity is None or torque is None:
            raise SettingsError("the simulated robot must measure joint velocities and torques")
        return SensorReadings(
            state.joint_position[order],
            velocity[order],
            torque[order],
            np.full(MOTORS, faults.temperature),
            state.angular_velocity_in_imu,
            state.acceleration_in_imu,
            self._options.first_tick + (round(state.time / tick) if tick else 0),
            faults.charge,
            _VOLTAGE,
            keys_of(faults.press),
        )


def _requests_samples(motors: JointCommand) -> bool:
    return not any(getattr(motors, name).any() for name in ("kp", "kd", "torque"))
