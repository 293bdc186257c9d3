"""How the Unitree A1 and Go1 lay out their low-level packets.

Each robot may speak one of two forms; which one, its answers tell. The A1's compressed form and the Go1's plain one are held
against packets that the makers' own SDKs sent and accepted (docs/unitree-udp.md says how); no packet of a real robot was
seen. Not proven are the A1's structures as they are (its header, packed) and the Go1's scrambled checksum, which one public
program sends.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from equipoise.drivers.unitree.udp_settings import Protocol, form_names

_IMU = np.dtype(
    [
        ("quat_wxyz", "<f4", 4),
        ("gyroscope", "<f4", 3),
        ("accelerometer", "<f4", 3),
        ("rpy", "<f4", 3),
        ("temperature", "i1"),
    ]
)
_A1_HEAD = [("level", "u1"), ("version", "<u2"), ("robot", "<u2"), ("serial", "<u4"), ("bandwidth", "u1")]
_MOTOR_COMMAND = np.dtype(
    [
        ("mode", "u1"),
        ("position", "<f4"),
        ("velocity", "<f4"),
        ("torque", "<f4"),
        ("kp", "<f4"),
        ("kd", "<f4"),
        ("reserve", "<u4", 3),
    ]
)
_MOTOR_STATE = np.dtype(
    [
        ("mode", "u1"),
        ("position", "<f4"),
        ("velocity", "<f4"),
        ("acceleration", "<f4"),
        ("torque", "<f4"),
        ("raw", "<f4", 3),
        ("temperature", "i1"),
        ("reserve", "<u4", 2),
    ]
)
_GO1_HEAD = [
    ("head", "u1", 2),
    ("level", "u1"),
    ("frame", "u1"),
    ("serial", "<u4", 2),
    ("version", "<u4", 2),
    ("bandwidth", "<u2"),
]
_COMPRESSED_COMMAND = np.dtype(
    [
        ("mode", "u1"),
        ("position", "<f4"),
        ("velocity", "<f4"),
        ("torque", "<i2"),
        ("kp", "<i2"),
        ("kd", "<i2"),
        ("reserve", "<u4", 3),
    ]
)
_COMPRESSED_STATE = np.dtype(
    [
        ("mode", "u1"),
        ("position", "<f4"),
        ("velocity", "<f4"),
        ("acceleration", "<i2"),
        ("torque", "<i2"),
        ("raw_position", "<f4"),
        ("raw_velocity", "<f4"),
        ("raw_acceleration", "<i2"),
        ("temperature", "i1"),
        ("reserve", "<u4", 2),
    ]
)
_GO1_BATTERY = np.dtype(
    [
        ("version", "u1", 2),
        ("status", "u1"),
        ("charge", "u1"),
        ("current", "<i4"),
        ("cycles", "<u2"),
        ("temperature", "i1", 4),
        ("cells", "u1", 10),
    ]
)
_TAIL = [("remote", "u1", 40), ("reserve", "<u4"), ("checksum", "<u4")]
_FEET = [("foot_force", "<i2", 4), ("foot_force_estimate", "<i2", 4), ("tick", "<u4")]


_COUNTS = {"torque": 256.0, "kp": 32.0, "kd": 16.0}  # per Nm, Nm/rad, Nm s/rad in a compressed record


@dataclass(frozen=True, eq=False)
class PacketFormat:
    """How a robot writes numbers.

    Attributes:
        command: structured type of the command packet.
        state: structured type of the state packet.
        begins: first bytes of both packets, by which they are known.
        state_lengths: lengths that states may have [bytes]; what is longer is padding.
        counts: counts per SI unit, of fields that are integers.
        scrambled: whether the checksum of commands is scrambled; states are then taken either way.
        bandwidth: value of a field of commands whose meaning is not known.
    """

    command: np.dtype[Any]
    state: np.dtype[Any]
    begins: bytes
    state_lengths: tuple[int, ...]
    counts: Mapping[str, float] = field(default_factory=dict[str, float])
    scrambled: bool = False
    bandwidth: int = 0


A1 = PacketFormat(
    np.dtype([*_A1_HEAD, ("motors", _COMPRESSED_COMMAND, 20), ("led", "u1", (4, 3)), *_TAIL]),
    np.dtype([*_A1_HEAD, ("imu", _IMU), ("motors", _COMPRESSED_STATE, 20), *_FEET, *_TAIL]),
    begins=b"\xff",
    state_lengths=(771,),
    counts=_COUNTS,
)
"""What its SDK sends as `UDP(LOWLEVEL)`, the constructor of public programs: 610 bytes, 771 back."""

A1_STRUCT = PacketFormat(
    np.dtype([*_A1_HEAD, ("motors", _MOTOR_COMMAND, 20), ("led", "u1", (4, 3)), *_TAIL]),
    np.dtype([*_A1_HEAD, ("imu", _IMU), ("motors", _MOTOR_STATE, 20), *_FEET, *_TAIL]),
    begins=b"\xff",
    state_lengths=(891,),
)
"""What its SDK sends when it is given the sizes of its structures: those, without padding; 730 bytes, 891 back."""

GO1 = PacketFormat(
    np.dtype([*_GO1_HEAD, ("motors", _COMPRESSED_COMMAND, 20), ("battery", "u1", 4), *_TAIL]),
    np.dtype([*_GO1_HEAD, ("imu", _IMU), ("motors", _COMPRESSED_STATE, 20), ("battery", _GO1_BATTERY), *_FEET, *_TAIL]),
    begins=b"\xfe\xef\xff",
    state_lengths=(807, 820),  # public programs receive 13 bytes of zeros more
    counts={**_COUNTS, "cells": 1 / 0.032},
)
"""SDK 3.8.4: 614 bytes, 807 back."""

GO1_SCRAMBLED = dataclasses.replace(GO1, scrambled=True, bandwidth=0xC03A)
"""As one public program sends it; the maker's SDK rejects states with such a checksum."""

FORMS: dict[Protocol, dict[str, PacketFormat]] = {
    "a1": {"compressed": A1, "struct": A1_STRUCT},
    "go1": {"plain": GO1, "scrambled": GO1_SCRAMBLED},
}
"""By robot and name, the likeliest first."""


def forms_of(protocol: Protocol, form: str | None) -> dict[str, PacketFormat]:
    """What a robot may speak: the form of that name, or any; raises SettingsError as `form_names`."""
    return {name: FORMS[protocol][name] for name in form_names(protocol, form)}
