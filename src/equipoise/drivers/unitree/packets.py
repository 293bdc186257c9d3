"""Encoding and decoding of the low-level packets of the Unitree A1 and Go1.

`equipoise.drivers.unitree.packet_formats` describes how far they are tested.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from equipoise.conventions import FloatArray
from equipoise.drivers.unitree.crc import crc32_words
from equipoise.drivers.unitree.motors import MOTORS, STOP_POSITION, STOP_VELOCITY
from equipoise.drivers.unitree.packet_formats import PacketFormat
from equipoise.drivers.unitree.remote_control import KEYS_AT
from equipoise.errors import SettingsError
from equipoise.platform.platform import JointCommand

_SERVO = 0x0A
_SCRAMBLE = 0xEDCAB9DE
_CHECKSUM_SIZE = 4
CELLS = 6  # of a Go1's battery
COMMANDED = ("position", "velocity", "torque", "kp", "kd")
SENSED = ("position", "velocity", "torque")
_GAINS = ("kp", "kd")  # never negative: the robots' response to negative counts is not known


Damage = Literal["wrong length", "wrong head", "wrong checksum"]
"""Fault of a packet."""
DAMAGES: tuple[Damage, ...] = get_args(Damage)
"""All kinds of damage, the least severe last."""
NOT_CONTROLLED = JointCommand(np.full(MOTORS, STOP_POSITION), np.full(MOTORS, STOP_VELOCITY), *np.zeros((3, MOTORS)))
"""Command without position, velocity and torque."""


@dataclass(frozen=True, eq=False)
class SensorReadings:
    """Readings of joints and IMU; joints in the order FR FL RR RL.

    Attributes:
        position: (12,) joint positions [rad].
        velocity: (12,) joint velocities [rad/s].
        torque: (12,) joint torques estimated by the motors [Nm].
        temperature: (12,) temperatures of the motors [deg C].
        gyroscope: (3,) angular velocity in the IMU frame [rad/s].
        accelerometer: (3,) specific force in the IMU frame, +g upward at rest [m/s2].
        tick: count of the robot's clock, modulo 2^32.
        battery_charge: battery charge, from 0 to 1; None: not reported.
        battery_voltage: battery voltage [V]; None: not reported.
        keys: pressed keys of the remote control, as `remote_control.keys_of`.
    """

    position: FloatArray
    velocity: FloatArray
    torque: FloatArray
    temperature: FloatArray
    gyroscope: FloatArray
    accelerometer: FloatArray
    tick: int
    battery_charge: float | None = None
    battery_voltage: float | None = None
    keys: int = 0


class CommandPacket:
    """Reusable command packet: at 500 Hz nothing should be allocated."""

    def __init__(self, packets: PacketFormat) -> None:
        self._format = packets
        self._bytes, record = blank_packet(packets.command, packets.begins)
        record["bandwidth"] = packets.bandwidth
        motors = record["motors"]
        motors["mode"], motors["position"], motors["velocity"] = _SERVO, STOP_POSITION, STOP_VELOCITY
        self._motors = FieldWriter(motors[:MOTORS], COMMANDED, packets.counts, np.trunc)  # as the makers' SDKs

    def write(self, command: JointCommand) -> bytearray:
        """Return the packet, which the next call overwrites. Values are limited to the ranges of their fields.

        Args:
            command: command of the twelve motors, complete and in their order.

        Raises:
            SettingsError: a command is not a number.
        """
        self._motors.write(np.array([getattr(command, name) for name in COMMANDED]))
        seal(self._format, self._bytes)
        return self._bytes


def read_state(packets: PacketFormat, data: bytes, check: bool = True) -> SensorReadings | Damage:
    """Read a state packet, as the driver does.

    Args:
        packets: packet format of the robot.
        data: bytes of one datagram.
        check: whether a wrong checksum counts as damage.
    """
    if len(data) not in packets.state_lengths:
        return "wrong length"
    if not data.startswith(packets.begins):
        return "wrong head"
    data = data[: packets.state.itemsize]
    record = np.frombuffer(data, packets.state)[0]
    if check and not _is_whole(packets, data, record["checksum"]):
        return "wrong checksum"
    motors, imu = record["motors"][:MOTORS], record["imu"]
    return SensorReadings(
        *(read_field(motors[name], packets.counts.get(name)) for name in (*SENSED, "temperature")),
        gyroscope=read_field(imu["gyroscope"]),
        accelerometer=read_field(imu["accelerometer"]),
        tick=int(record["tick"]),
        keys=int.from_bytes(record["remote"][KEYS_AT].tobytes(), "little"),
        **_battery(packets, record),
    )


def _battery(packets: PacketFormat, record: Any) -> dict[str, float]:
    if "battery" not in (packets.state.names or ()):
        return {}
    battery = record["battery"]
    voltage = float(read_field(battery["cells"], packets.counts["cells"]).sum())
    return {"battery_charge": float(battery["charge"]) / 100, "battery_voltage": voltage}


class FieldWriter:
    """Writer of several fields from rows of values."""

    def __init__(self, record: Any, names: tuple[str, ...], counts: Mapping[str, float], whole: np.ufunc) -> None:
        self._views: list[NDArray[Any]] = [record[name] for name in names]
        kinds = [view.dtype for view in self._views]
        limits = [np.iinfo(kind) if kind.kind in "iu" else np.finfo(kind) for kind in kinds]
        lowest = [0.0 if name in _GAINS else float(limit.min) for name, limit in zip(names, limits, strict=True)]
        self._counts = np.array([counts.get(name, 1.0) for name in names])[:, None]
        self._low = np.array(lowest)[:, None] / self._counts
        self._high = np.array([float(limit.max) for limit in limits])[:, None] / self._counts
        self._rows = [row for row, kind in enumerate(kinds) if kind.kind in "iu"]
        self._whole = whole

    def write(self, values: FloatArray) -> None:
        """Write (n, width) values in SI units, limited to the fields' ranges, as whole counts in integer fields.

        They are converted to float32 first, as in the SDKs' structures: there 12.5 - 1e-9 is 12.5, possibly one count more.
        """
        if not np.isfinite(values).all():
            raise SettingsError(f"commands must be finite numbers, not {values}")
        np.minimum(np.maximum(values, self._low, out=values), self._high, out=values)
        counted = values.astype(np.float32) * self._counts
        for row in self._rows:
            self._whole(counted[row], out=counted[row])
        for view, row in zip(self._views, counted, strict=True):
            view[:] = row


def blank_packet(layout: np.dtype[Any], begins: bytes) -> tuple[bytearray, Any]:
    """Return a packet's bytes, and a record that shares them."""
    data = bytearray(layout.itemsize)
    data[: len(begins)] = begins
    return data, np.frombuffer(data, layout)[0]


def read_field(view: NDArray[Any], counts: float | None = None) -> FloatArray:
    """Return a field's values in SI units, from counts per unit."""
    with np.errstate(invalid="ignore"):  # a signalling NaN is a NaN
        values = view.astype(float)
    return values if counts is None else values / counts


def seal(packets: PacketFormat, data: bytearray) -> None:
    """Write a packet's checksum at its end."""
    data[-_CHECKSUM_SIZE:] = checksum_of(data, packets.scrambled).to_bytes(_CHECKSUM_SIZE, "little")


def _is_whole(packets: PacketFormat, state: bytes, checksum: int) -> bool:
    """Return whether a state's checksum is correct; with scrambled commands, either kind is."""
    return checksum == checksum_of(state, False) or (packets.scrambled and checksum == checksum_of(state, True))


def checksum_of(data: bytes | bytearray, scrambled: bool) -> int:
    """Return the checksum of all whole words but the last; bytes after a multiple of four are excluded."""
    plain = crc32_words(data[: (len(data) // _CHECKSUM_SIZE - 1) * _CHECKSUM_SIZE])
    if not scrambled:
        return plain
    mixed = plain ^ _SCRAMBLE
    return mixed >> 8 | (mixed & 0xFF) << 24
