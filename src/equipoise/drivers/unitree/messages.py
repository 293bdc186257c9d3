"""What Unitree's Go2 and B2 say and hear over DDS: the layouts of its messages, field by field in their order on the wire.

Its uint8 are called byte here, for peace between versions of DDS: `cyclone.py` says why.
"""

# No `from __future__ import annotations` here: the types are read from the annotations when a class is made.

from dataclasses import dataclass

from equipoise.drivers.dds.cyclone import (
    IdlStruct,
    array,
    byte,
    float32,
    int16,
    int32,
    int64,
    sequence,
    uint16,
    uint32,
)

Bytes = sequence[byte]
MOTORS = 20
"""Places for motors in every message; a quadruped uses the first twelve."""


@dataclass
class MotorCmd(IdlStruct, typename="unitree_go.msg.dds_.MotorCmd_"):
    """Of one motor."""

    mode: byte
    q: float32
    dq: float32
    tau: float32
    kp: float32
    kd: float32
    reserve: array[uint32, 3]


@dataclass
class BmsCmd(IdlStruct, typename="unitree_go.msg.dds_.BmsCmd_"):
    """To the battery."""

    off: byte
    reserve: array[byte, 3]


@dataclass
class LowCmd(IdlStruct, typename="unitree_go.msg.dds_.LowCmd_"):
    """To all motors, every control period."""

    head: array[byte, 2]
    level_flag: byte
    frame_reserve: byte
    sn: array[uint32, 2]
    version: array[uint32, 2]
    bandwidth: uint16
    motor_cmd: array[MotorCmd, MOTORS]
    bms_cmd: BmsCmd
    wireless_remote: array[byte, 40]
    led: array[byte, 12]
    fan: array[byte, 2]
    gpio: byte
    reserve: uint32
    crc: uint32


@dataclass
class IMUState(IdlStruct, typename="unitree_go.msg.dds_.IMUState_"):
    """Of the IMU; the quaternion is w x y z."""

    quaternion: array[float32, 4]
    gyroscope: array[float32, 3]
    accelerometer: array[float32, 3]
    rpy: array[float32, 3]
    temperature: byte


@dataclass
class MotorState(IdlStruct, typename="unitree_go.msg.dds_.MotorState_"):
    """Of one motor."""

    mode: byte
    q: float32
    dq: float32
    ddq: float32
    tau_est: float32
    q_raw: float32
    dq_raw: float32
    ddq_raw: float32
    temperature: byte
    lost: uint32
    reserve: array[uint32, 2]


@dataclass
class BmsState(IdlStruct, typename="unitree_go.msg.dds_.BmsState_"):
    """Of the battery; `soc` is its charge in per cent, the current is in mA."""

    version_high: byte
    version_low: byte
    status: byte
    soc: byte
    current: int32
    cycle: uint16
    bq_ntc: array[byte, 2]
    mcu_ntc: array[byte, 2]
    cell_vol: array[uint16, 15]


@dataclass
class LowState(IdlStruct, typename="unitree_go.msg.dds_.LowState_"):
    """Of everything, every control period; `tick` counts milliseconds."""

    head: array[byte, 2]
    level_flag: byte
    frame_reserve: byte
    sn: array[uint32, 2]
    version: array[uint32, 2]
    bandwidth: uint16
    imu_state: IMUState
    motor_state: array[MotorState, MOTORS]
    bms_state: BmsState
    foot_force: array[int16, 4]
    foot_force_est: array[int16, 4]
    tick: uint32
    wireless_remote: array[byte, 40]
    bit_flag: byte
    adc_reel: float32
    temperature_ntc1: byte
    temperature_ntc2: byte
    power_v: float32
    power_a: float32
    fan_frequency: array[uint16, 4]
    reserve: uint32
    crc: uint32


@dataclass
class RequestIdentity(IdlStruct, typename="unitree_api.msg.dds_.RequestIdentity_"):
    """Which request this is, and which function of the service it calls."""

    id: int64
    api_id: int64


@dataclass
class RequestLease(IdlStruct, typename="unitree_api.msg.dds_.RequestLease_"):
    """Of services that only one may use at a time."""

    id: int64


@dataclass
class RequestPolicy(IdlStruct, typename="unitree_api.msg.dds_.RequestPolicy_"):
    """How the service should treat a request."""

    priority: int32
    noreply: bool


@dataclass
class RequestHeader(IdlStruct, typename="unitree_api.msg.dds_.RequestHeader_"):
    """Before a request's parameters."""

    identity: RequestIdentity
    lease: RequestLease
    policy: RequestPolicy


@dataclass
class Request(IdlStruct, typename="unitree_api.msg.dds_.Request_"):
    """To a service; the parameter is JSON."""

    header: RequestHeader
    parameter: str
    binary: Bytes


@dataclass
class ResponseStatus(IdlStruct, typename="unitree_api.msg.dds_.ResponseStatus_"):
    """Zero: done."""

    code: int32


@dataclass
class ResponseHeader(IdlStruct, typename="unitree_api.msg.dds_.ResponseHeader_"):
    """Before a response's data; the identity is the request's."""

    identity: RequestIdentity
    status: ResponseStatus


@dataclass
class Response(IdlStruct, typename="unitree_api.msg.dds_.Response_"):
    """From a service; the data are JSON."""

    header: ResponseHeader
    data: str
    binary: Bytes
