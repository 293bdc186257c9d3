"""The messages of Unitree's Go2 and B2 over DDS: their fields, in the order on the wire.

Its uint8 are called byte here, for peace between versions of DDS: `cyclone.py` says why.
"""

from __future__ import annotations

from equipoise.drivers.dds.cyclone import array, byte, float32, int16, int32, int64, sequence, uint16, uint32
from equipoise.drivers.dds.domain import message

MOTORS = 20
"""Places for motors in every message; a quadruped uses the first twelve."""

MotorCmd = message(
    "unitree_go", "MotorCmd",
    mode=byte, q=float32, dq=float32, tau=float32, kp=float32, kd=float32, reserve=array[uint32, 3],
)  # fmt: skip
"""Command of one motor."""

BmsCmd = message("unitree_go", "BmsCmd", off=byte, reserve=array[byte, 3])
"""Command of the battery."""

LowCmd = message(
    "unitree_go", "LowCmd",
    head=array[byte, 2], level_flag=byte, frame_reserve=byte, sn=array[uint32, 2], version=array[uint32, 2],
    bandwidth=uint16, motor_cmd=array[MotorCmd, MOTORS], bms_cmd=BmsCmd, wireless_remote=array[byte, 40],
    led=array[byte, 12], fan=array[byte, 2], gpio=byte, reserve=uint32, crc=uint32,
)  # fmt: skip
"""Command of all motors, every control period."""

IMUState = message(
    "unitree_go", "IMUState",
    quaternion=array[float32, 4], gyroscope=array[float32, 3], accelerometer=array[float32, 3], rpy=array[float32, 3],
    temperature=byte,
)  # fmt: skip
"""State of the IMU; the quaternion is w x y z."""

MotorState = message(
    "unitree_go", "MotorState",
    mode=byte, q=float32, dq=float32, ddq=float32, tau_est=float32, q_raw=float32, dq_raw=float32, ddq_raw=float32,
    temperature=byte, lost=uint32, reserve=array[uint32, 2],
)  # fmt: skip
"""State of one motor."""

BmsState = message(
    "unitree_go", "BmsState",
    version_high=byte, version_low=byte, status=byte, soc=byte, current=int32, cycle=uint16, bq_ntc=array[byte, 2],
    mcu_ntc=array[byte, 2], cell_vol=array[uint16, 15],
)  # fmt: skip
"""State of the battery; `soc` is its charge in per cent, the current is in mA."""

LowState = message(
    "unitree_go", "LowState",
    head=array[byte, 2], level_flag=byte, frame_reserve=byte, sn=array[uint32, 2], version=array[uint32, 2],
    bandwidth=uint16, imu_state=IMUState, motor_state=array[MotorState, MOTORS], bms_state=BmsState,
    foot_force=array[int16, 4], foot_force_est=array[int16, 4], tick=uint32, wireless_remote=array[byte, 40],
    bit_flag=byte, adc_reel=float32, temperature_ntc1=byte, temperature_ntc2=byte, power_v=float32, power_a=float32,
    fan_frequency=array[uint16, 4], reserve=uint32, crc=uint32,
)  # fmt: skip
"""State of the robot, every control period; `tick` counts milliseconds."""

RequestIdentity = message("unitree_api", "RequestIdentity", id=int64, api_id=int64)
"""Number of a request, and the function of the service that it calls."""

RequestLease = message("unitree_api", "RequestLease", id=int64)
"""Lease of a service that has one user at a time."""

RequestPolicy = message("unitree_api", "RequestPolicy", priority=int32, noreply=bool)
"""Treatment of a request by the service."""

RequestHeader = message(
    "unitree_api", "RequestHeader", identity=RequestIdentity, lease=RequestLease, policy=RequestPolicy
)
"""Head of a request."""

Request = message("unitree_api", "Request", header=RequestHeader, parameter=str, binary=sequence[byte])
"""Request to a service; the parameter is JSON."""

ResponseStatus = message("unitree_api", "ResponseStatus", code=int32)
"""Status of a response; zero: done."""

ResponseHeader = message("unitree_api", "ResponseHeader", identity=RequestIdentity, status=ResponseStatus)
"""Head of a response; the identity is the request's."""

Response = message("unitree_api", "Response", header=ResponseHeader, data=str, binary=sequence[byte])
"""Response of a service; the data are JSON."""
