"""How the Unitree A1 and Go1 lay out their low-level packets.

Beta: this comes from public headers and public programs; no packet of a real robot was seen. Sure are the totals (A1 730
and 891 bytes, Go1 614 and 807), the A1's fields (its header, packed), the Go1's motors and IMU and the unit of its torque,
and the checksum's polynomial. Not proven are

- the scrambling of a Go1's checksum, which the programs that move one do to commands; states are taken either way;
- that the A1's is not scrambled;
- the unit of the Go1's kd: one public program counts 16 to a unit, another 32; if 16 is wrong, joints damp less than meant;
- the Go1's battery: public programs read a byte a cell, and one of them takes its unit to be 32 mV;
- the unit of the tick: programs that use it divide by 1000, older headers say microseconds.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

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
_A1_MOTOR_COMMAND = np.dtype(
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
_A1_MOTOR_STATE = np.dtype(
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
_GO1_MOTOR_COMMAND = np.dtype(
    [
        ("mode", "u1"),
        ("position", "<f4"),
        ("velocity", "<f4"),
        ("torque", "<i2"),
        ("kp", "<u2"),
        ("kd", "<u2"),
        ("reserve", "<u4", 3),
    ]
)
_GO1_MOTOR_STATE = np.dtype(
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


@dataclass(frozen=True, eq=False)
class PacketFormat:
    """How a robot writes numbers.

    Attributes:
        command: what is sent to it.
        state: what it sends.
        begins: first bytes of both packets, by which they are known.
        state_lengths: that states may have [bytes]; what is longer is padding.
        counts: per SI unit, of fields that are integers.
        scrambled: whether the checksum is scrambled.
        bandwidth: a field of commands whose meaning is not known.
    """

    command: np.dtype[Any]
    state: np.dtype[Any]
    begins: bytes
    state_lengths: tuple[int, ...]
    counts: Mapping[str, float] = field(default_factory=dict[str, float])
    scrambled: bool = False
    bandwidth: int = 0


A1 = PacketFormat(
    np.dtype([*_A1_HEAD, ("motors", _A1_MOTOR_COMMAND, 20), ("led", "u1", (4, 3)), *_TAIL]),
    np.dtype([*_A1_HEAD, ("imu", _IMU), ("motors", _A1_MOTOR_STATE, 20), *_FEET, *_TAIL]),
    begins=b"\xff",
    state_lengths=(891,),
)
"""SDK 3.3.1, its structures without padding."""

GO1 = PacketFormat(
    np.dtype([*_GO1_HEAD, ("motors", _GO1_MOTOR_COMMAND, 20), ("battery", "u1", 4), *_TAIL]),
    np.dtype([*_GO1_HEAD, ("imu", _IMU), ("motors", _GO1_MOTOR_STATE, 20), ("battery", _GO1_BATTERY), *_FEET, *_TAIL]),
    begins=b"\xfe\xef\xff",
    state_lengths=(807, 820),  # public programs receive 13 bytes of zeros more
    counts={"torque": 256.0, "kp": 32.0, "kd": 16.0, "cells": 1 / 0.032},
    scrambled=True,
    bandwidth=0xC03A,  # as public programs send it
)
"""SDK 3.8, its structures compressed."""

Protocol = Literal["a1", "go1"]
FORMATS: dict[Protocol, PacketFormat] = {"a1": A1, "go1": GO1}
