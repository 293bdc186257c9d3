"""The ROS 2 messages that a robot's joints and IMU speak, as DDS types.

A ROS message `pkg/msg/Name` is the DDS type `pkg::msg::dds_::Name_`, a topic `/x` is the DDS topic `rt/x`; fields and their
order are those of the public .msg definitions. cyclonedds takes a JointState of 12 joints apart in 24 us, an Imu in 21 us.
None of them holds a uint8, which is what crashes cyclonedds 0.10 when 11 announces it.
"""

# No `from __future__ import annotations` here: the types are read from the annotations when a class is made.

import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from equipoise.drivers.dds.cyclone import IdlStruct, array, float64, int32, sequence, uint32
from equipoise.drivers.dds.domain import RawSample, raw

if TYPE_CHECKING:  # what they are in Python
    Strings = list[str]
    Numbers = list[float]
    Nine = list[float]
else:  # and on the wire
    Strings = sequence[str]
    Numbers = sequence[float64]
    Nine = array[float64, 9]

_LITTLE_ENDIAN = b"\0\1\0\0"  # of plain CDR, before a sample
UNKNOWN_COVARIANCE = [0.0] * 9


def dds_topic(name: str) -> str:
    """The DDS name of a ROS topic: "rt/joint_states" of "/joint_states"."""
    return "rt" + name


@dataclass
class Time(IdlStruct, typename="builtin_interfaces.msg.dds_.Time_"):
    """`builtin_interfaces/Time`."""

    sec: int32 = 0
    nanosec: uint32 = 0


@dataclass
class Duration(IdlStruct, typename="builtin_interfaces.msg.dds_.Duration_"):
    """`builtin_interfaces/Duration`."""

    sec: int32 = 0
    nanosec: uint32 = 0


@dataclass
class Header(IdlStruct, typename="std_msgs.msg.dds_.Header_"):
    """`std_msgs/Header`."""

    stamp: Time = field(default_factory=Time)
    frame_id: str = ""


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs.msg.dds_.Vector3_"):
    """`geometry_msgs/Vector3`."""

    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs.msg.dds_.Quaternion_"):
    """`geometry_msgs/Quaternion`."""

    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0
    w: float64 = 1.0


@dataclass
class JointState(IdlStruct, typename="sensor_msgs.msg.dds_.JointState_"):
    """`sensor_msgs/JointState`: [rad], [rad/s], [Nm]; each of the three may be empty."""

    header: Header = field(default_factory=Header)
    name: Strings = field(default_factory=list[str])
    position: Numbers = field(default_factory=list[float])
    velocity: Numbers = field(default_factory=list[float])
    effort: Numbers = field(default_factory=list[float])


@dataclass
class Imu(IdlStruct, typename="sensor_msgs.msg.dds_.Imu_"):
    """`sensor_msgs/Imu`: [rad/s], [m/s2] in the sensor's frame; a covariance that begins with -1: there is no such datum."""

    header: Header = field(default_factory=Header)
    orientation: Quaternion = field(default_factory=Quaternion)
    orientation_covariance: Nine = field(default_factory=UNKNOWN_COVARIANCE.copy)
    angular_velocity: Vector3 = field(default_factory=Vector3)
    angular_velocity_covariance: Nine = field(default_factory=UNKNOWN_COVARIANCE.copy)
    linear_acceleration: Vector3 = field(default_factory=Vector3)
    linear_acceleration_covariance: Nine = field(default_factory=UNKNOWN_COVARIANCE.copy)


@dataclass
class MultiArrayDimension(IdlStruct, typename="std_msgs.msg.dds_.MultiArrayDimension_"):
    """`std_msgs/MultiArrayDimension`."""

    label: str = ""
    size: uint32 = 0
    stride: uint32 = 0


if TYPE_CHECKING:
    Dimensions = list[MultiArrayDimension]
else:
    Dimensions = sequence[MultiArrayDimension]


@dataclass
class MultiArrayLayout(IdlStruct, typename="std_msgs.msg.dds_.MultiArrayLayout_"):
    """`std_msgs/MultiArrayLayout`."""

    dim: Dimensions = field(default_factory=list[MultiArrayDimension])
    data_offset: uint32 = 0


@dataclass
class Float64MultiArray(IdlStruct, typename="std_msgs.msg.dds_.Float64MultiArray_"):
    """`std_msgs/Float64MultiArray`."""

    layout: MultiArrayLayout = field(default_factory=MultiArrayLayout)
    data: Numbers = field(default_factory=list[float])


ENCODED_ARRAY = raw(Float64MultiArray)


def encoded_array(values: Sequence[float]) -> RawSample:
    """A `Float64MultiArray` of values without a layout: a dozen of them a command take cyclonedds half a millisecond."""
    return ENCODED_ARRAY(struct.pack(f"<4s3I4x{len(values)}d", _LITTLE_ENDIAN, 0, 0, len(values), *values))


@dataclass
class JointTrajectoryPoint(IdlStruct, typename="trajectory_msgs.msg.dds_.JointTrajectoryPoint_"):
    """`trajectory_msgs/JointTrajectoryPoint`."""

    positions: Numbers = field(default_factory=list[float])
    velocities: Numbers = field(default_factory=list[float])
    accelerations: Numbers = field(default_factory=list[float])
    effort: Numbers = field(default_factory=list[float])
    time_from_start: Duration = field(default_factory=Duration)


if TYPE_CHECKING:
    Points = list[JointTrajectoryPoint]
else:
    Points = sequence[JointTrajectoryPoint]


@dataclass
class JointTrajectory(IdlStruct, typename="trajectory_msgs.msg.dds_.JointTrajectory_"):
    """`trajectory_msgs/JointTrajectory`; a stamp of zero means "from now on"."""

    header: Header = field(default_factory=Header)
    joint_names: Strings = field(default_factory=list[str])
    points: Points = field(default_factory=list[JointTrajectoryPoint])
