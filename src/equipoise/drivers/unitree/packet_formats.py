"""Layouts of the low-level packets of the Unitree A1 and Go1.

Each robot has one of two forms, which its answers determine. The A1's compressed form and the Go1's plain one were tested
against packets that the makers' own SDKs sent and accepted (see docs/hardware/unitree-a1-go1.md),
not against packets of a real robot.
The A1's uncompressed structures (its header, packed) and the Go1's scrambled checksum, from one public program, are not
proven.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from equipoise.drivers.unitree.definitions import layout_of
from equipoise.drivers.unitree.udp_settings import Protocol, form_names

_PARTS = {
    "Imu": "float32[4] quat_wxyz, float32[3] gyroscope, float32[3] accelerometer, float32[3] rpy, int8 temperature",
    "MotorCommand": (
        "uint8 mode, float32 position, float32 velocity, float32 torque, float32 kp, float32 kd, uint32[3] reserve"
    ),
    "MotorState": (
        "uint8 mode, float32 position, float32 velocity, float32 acceleration, float32 torque, float32[3] raw, "
        "int8 temperature, uint32[2] reserve"
    ),
    "CompressedCommand": (
        "uint8 mode, float32 position, float32 velocity, int16 torque, int16 kp, int16 kd, uint32[3] reserve"
    ),
    "CompressedState": (
        "uint8 mode, float32 position, float32 velocity, int16 acceleration, int16 torque, float32 raw_position, "
        "float32 raw_velocity, int16 raw_acceleration, int8 temperature, uint32[2] reserve"
    ),
    "Go1Battery": (
        "uint8[2] version, uint8 status, uint8 charge, int32 current, uint16 cycles, int8[4] temperature, uint8[10] cells"
    ),
}
_A1_HEAD = "uint8 level, uint16 version, uint16 robot, uint32 serial, uint8 bandwidth"
_GO1_HEAD = "uint8[2] head, uint8 level, uint8 frame, uint32[2] serial, uint32[2] version, uint16 bandwidth"
_FEET = "int16[4] foot_force, int16[4] foot_force_estimate, uint32 tick"
_TAIL = "uint8[40] remote, uint32 reserve, uint32 checksum"


def _packed(definition: str) -> np.dtype[Any]:
    """Return a packet's structured type, without padding."""
    return layout_of(definition, _PARTS, align=False)


_COUNTS = {"torque": 256.0, "kp": 32.0, "kd": 16.0}  # per Nm, Nm/rad, Nm s/rad in a compressed record


@dataclass(frozen=True, eq=False)
class PacketFormat:
    """Form of a robot's packets.

    Attributes:
        command: structured type of the command packet.
        state: structured type of the state packet.
        begins: first bytes of both packets.
        state_lengths: valid lengths of states [bytes]; longer ones have padding.
        counts: counts per SI unit, for integer fields.
        scrambled: whether the checksum of commands is scrambled; states are then accepted either way.
        bandwidth: value of a field of commands with unknown meaning.
    """

    command: np.dtype[Any]
    state: np.dtype[Any]
    begins: bytes
    state_lengths: tuple[int, ...]
    counts: Mapping[str, float] = field(default_factory=dict[str, float])
    scrambled: bool = False
    bandwidth: int = 0


A1 = PacketFormat(
    _packed(f"{_A1_HEAD}, CompressedCommand[20] motors, uint8[12] led, {_TAIL}"),
    _packed(f"{_A1_HEAD}, Imu imu, CompressedState[20] motors, {_FEET}, {_TAIL}"),
    begins=b"\xff",
    state_lengths=(771,),
    counts=_COUNTS,
)
"""Form of the SDK's `UDP(LOWLEVEL)`, the constructor in public programs: 610 bytes, 771 back."""

A1_STRUCT = PacketFormat(
    _packed(f"{_A1_HEAD}, MotorCommand[20] motors, uint8[12] led, {_TAIL}"),
    _packed(f"{_A1_HEAD}, Imu imu, MotorState[20] motors, {_FEET}, {_TAIL}"),
    begins=b"\xff",
    state_lengths=(891,),
)
"""Form of the SDK with explicit sizes: its structures, without padding; 730 bytes, 891 back."""

GO1 = PacketFormat(
    _packed(f"{_GO1_HEAD}, CompressedCommand[20] motors, uint8[4] battery, {_TAIL}"),
    _packed(f"{_GO1_HEAD}, Imu imu, CompressedState[20] motors, Go1Battery battery, {_FEET}, {_TAIL}"),
    begins=b"\xfe\xef\xff",
    state_lengths=(807, 820),  # public programs receive 13 bytes of zeros more
    counts={**_COUNTS, "cells": 1 / 0.032},
)
"""SDK 3.8.4: 614 bytes, 807 back."""

GO1_SCRAMBLED = dataclasses.replace(GO1, scrambled=True, bandwidth=0xC03A)
"""Form of one public program; the maker's SDK rejects states with such a checksum."""

FORMS: dict[Protocol, dict[str, PacketFormat]] = {
    "a1": {"compressed": A1, "struct": A1_STRUCT},
    "go1": {"plain": GO1, "scrambled": GO1_SCRAMBLED},
}
"""Forms by robot and name, the likeliest first."""


def forms_of(protocol: Protocol, form: str | None) -> dict[str, PacketFormat]:
    """Return the forms of a robot, or the one of a name; raise SettingsError as `form_names`."""
    return {name: FORMS[protocol][name] for name in form_names(protocol, form)}
