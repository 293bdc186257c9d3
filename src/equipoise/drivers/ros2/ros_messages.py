"""ROS 2 messages of a robot's joints and IMU, as DDS types.

A ROS message `pkg/msg/Name` is the DDS type `pkg::msg::dds_::Name_`, a topic `/x` is the DDS topic `rt/x`; fields and their
order are those of the public .msg definitions. cyclonedds decodes a JointState of 12 joints in 24 us, an Imu in 21 us.
None of them contains a uint8, which crashes cyclonedds 0.10 when 11 announces it.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

from equipoise.drivers.dds.domain import RawSample, message_types, raw
from equipoise.recording.messages import FIELDS

_LITTLE_ENDIAN = b"\0\1\0\0"  # of plain CDR, before a sample
_DEFINITIONS = {
    **FIELDS,
    "builtin_interfaces/Duration": "int32 sec, uint32 nanosec",
    "std_msgs/MultiArrayDimension": "string label, uint32 size, uint32 stride",
    "std_msgs/MultiArrayLayout": "std_msgs/MultiArrayDimension[] dim, uint32 data_offset",
    "std_msgs/Float64MultiArray": "std_msgs/MultiArrayLayout layout, float64[] data",
    "trajectory_msgs/JointTrajectoryPoint": (
        "float64[] positions, float64[] velocities, float64[] accelerations, float64[] effort, "
        "builtin_interfaces/Duration time_from_start"
    ),
    "trajectory_msgs/JointTrajectory": (
        "std_msgs/Header header, string[] joint_names, trajectory_msgs/JointTrajectoryPoint[] points"
    ),
}
"""Fields in [rad], [rad/s], [Nm] and [m/s2]. Velocities and efforts may be empty; a covariance that begins with -1 marks
missing data; a trajectory with stamp zero begins at once."""

(
    Time, Header, Vector3, Quaternion, JointState, Imu, Duration, MultiArrayDimension, MultiArrayLayout, Float64MultiArray,
    JointTrajectoryPoint, JointTrajectory,
) = message_types(_DEFINITIONS)  # fmt: skip
ENCODED_ARRAY = raw(Float64MultiArray)


def dds_topic(name: str) -> str:
    """Return the DDS name of a ROS topic: "rt/joint_states" for "/joint_states"."""
    return "rt" + name


def encoded_array(values: Sequence[float]) -> RawSample:
    """Encode a `Float64MultiArray` without a layout; cyclonedds takes half a millisecond for a dozen of them."""
    return ENCODED_ARRAY(struct.pack(f"<4s3I4x{len(values)}d", _LITTLE_ENDIAN, 0, 0, len(values), *values))
