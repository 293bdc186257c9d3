"""The ROS 2 messages that a robot's joints and IMU speak, as DDS types.

A ROS message `pkg/msg/Name` is the DDS type `pkg::msg::dds_::Name_`, a topic `/x` is the DDS topic `rt/x`; fields and their
order are those of the public .msg definitions. cyclonedds takes a JointState of 12 joints apart in 24 us, an Imu in 21 us.
None of them holds a uint8, which is what crashes cyclonedds 0.10 when 11 announces it.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

from equipoise.drivers.dds.cyclone import array, float64, int32, sequence, uint32
from equipoise.drivers.dds.domain import RawSample, message, raw

_LITTLE_ENDIAN = b"\0\1\0\0"  # of plain CDR, before a sample
_STRINGS, _NUMBERS, _COVARIANCE = sequence[str], sequence[float64], array[float64, 9]

Time = message("builtin_interfaces", "Time", sec=int32, nanosec=uint32)
Duration = message("builtin_interfaces", "Duration", sec=int32, nanosec=uint32)
Header = message("std_msgs", "Header", stamp=Time, frame_id=str)
Vector3 = message("geometry_msgs", "Vector3", x=float64, y=float64, z=float64)
Quaternion = message("geometry_msgs", "Quaternion", x=float64, y=float64, z=float64, w=float64)

JointState = message(
    "sensor_msgs", "JointState",
    header=Header, name=_STRINGS, position=_NUMBERS, velocity=_NUMBERS, effort=_NUMBERS,
)  # fmt: skip
"""Joint states [rad], [rad/s], [Nm]; each of the three may be empty."""

Imu = message(
    "sensor_msgs", "Imu",
    header=Header, orientation=Quaternion, orientation_covariance=_COVARIANCE,
    angular_velocity=Vector3, angular_velocity_covariance=_COVARIANCE,
    linear_acceleration=Vector3, linear_acceleration_covariance=_COVARIANCE,
)  # fmt: skip
"""IMU sample [rad/s], [m/s2] in the sensor's frame; a covariance that begins with -1: there is no such datum."""

MultiArrayDimension = message("std_msgs", "MultiArrayDimension", label=str, size=uint32, stride=uint32)
MultiArrayLayout = message("std_msgs", "MultiArrayLayout", dim=sequence[MultiArrayDimension], data_offset=uint32)
Float64MultiArray = message("std_msgs", "Float64MultiArray", layout=MultiArrayLayout, data=_NUMBERS)
ENCODED_ARRAY = raw(Float64MultiArray)

JointTrajectoryPoint = message(
    "trajectory_msgs", "JointTrajectoryPoint",
    positions=_NUMBERS, velocities=_NUMBERS, accelerations=_NUMBERS, effort=_NUMBERS, time_from_start=Duration,
)  # fmt: skip
JointTrajectory = message(
    "trajectory_msgs", "JointTrajectory", header=Header, joint_names=_STRINGS, points=sequence[JointTrajectoryPoint]
)
"""Trajectory of joints; a stamp of zero means "from now on"."""


def dds_topic(name: str) -> str:
    """Return the DDS name of a ROS topic: "rt/joint_states" of "/joint_states"."""
    return "rt" + name


def encoded_array(values: Sequence[float]) -> RawSample:
    """Encode a `Float64MultiArray` without a layout: a dozen of them a command take cyclonedds half a millisecond."""
    return ENCODED_ARRAY(struct.pack(f"<4s3I4x{len(values)}d", _LITTLE_ENDIAN, 0, 0, len(values), *values))
