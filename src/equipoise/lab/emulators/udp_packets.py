"""Robot side of the low-level packets of the Unitree A1 and Go1."""

from __future__ import annotations

import numpy as np

from equipoise.drivers.unitree.motors import MOTORS
from equipoise.drivers.unitree.packet_formats import PacketFormat
from equipoise.drivers.unitree.packets import (
    CELLS,
    COMMANDED,
    SENSED,
    Damage,
    FieldWriter,
    SensorReadings,
    blank_packet,
    checksum_of,
    read_field,
    seal,
)
from equipoise.drivers.unitree.remote_control import KEYS_AT
from equipoise.platform.platform import JointCommand


class StatePacket:
    """Encoder of states. The rounding of the real robot is not documented."""

    def __init__(self, packets: PacketFormat) -> None:
        self._format = packets
        self._bytes, self._record = blank_packet(packets.state, packets.begins)
        self._motors = FieldWriter(self._record["motors"][:MOTORS], (*SENSED, "temperature"), packets.counts, np.rint)
        self._imu = FieldWriter(self._record["imu"], ("gyroscope", "accelerometer"), packets.counts, np.rint)

    def write(self, state: SensorReadings) -> bytearray:
        """Return the packet, valid until the next call; raises SettingsError if a value is not finite."""
        self._motors.write(np.array((state.position, state.velocity, state.torque, state.temperature)))
        self._imu.write(np.array((state.gyroscope, state.accelerometer)))
        self._record["tick"] = state.tick % 2**32
        self._record["remote"][KEYS_AT] = tuple(state.keys.to_bytes(2, "little"))
        if "battery" in self._record.dtype.names:
            battery, cells = self._record["battery"], (state.battery_voltage or 0.0) / CELLS
            battery["charge"] = round(100 * (state.battery_charge or 0.0))
            battery["cells"][:CELLS] = min(round(cells * self._format.counts["cells"]), 255)
        seal(self._format, self._bytes)
        return self._bytes


def read_command(packets: PacketFormat, data: bytes) -> JointCommand | Damage:
    """Decode a command packet, or return the damage that the robot detects."""
    if len(data) != packets.command.itemsize:
        return "wrong length"
    if not data.startswith(packets.begins):
        return "wrong head"
    record = np.frombuffer(data, packets.command)[0]
    if record["checksum"] != checksum_of(data, packets.scrambled):
        return "wrong checksum"
    motors = record["motors"][:MOTORS]
    return JointCommand(*(read_field(motors[name], packets.counts.get(name)) for name in COMMANDED))
