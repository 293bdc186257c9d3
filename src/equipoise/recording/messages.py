"""Messages of a recording: sensor_msgs/JointState, sensor_msgs/Imu and std_msgs/String, as ROS 2 defines them."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from functools import lru_cache

from equipoise.errors import RecordingError
from equipoise.recording.cdr import Layout, bodies, constant, header, layout_of, number, sequence, stamps, text
from equipoise.recording.clock import nanoseconds, seconds
from equipoise.recording.recording import ImuStream, JointStream

JOINT_STATE, IMU, STRING = "sensor_msgs/msg/JointState", "sensor_msgs/msg/Imu", "std_msgs/msg/String"

FIELDS = {
    "builtin_interfaces/Time": "int32 sec, uint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp, string frame_id",
    "geometry_msgs/Vector3": "float64 x, float64 y, float64 z",
    "geometry_msgs/Quaternion": "float64 x, float64 y, float64 z, float64 w",
    "sensor_msgs/JointState": (
        "std_msgs/Header header, string[] name, float64[] position, float64[] velocity, float64[] effort"
    ),
    "sensor_msgs/Imu": (
        "std_msgs/Header header, geometry_msgs/Quaternion orientation, float64[9] orientation_covariance, "
        "geometry_msgs/Vector3 angular_velocity, float64[9] angular_velocity_covariance, "
        "geometry_msgs/Vector3 linear_acceleration, float64[9] linear_acceleration_covariance"
    ),
}
"""Types and names of the fields of ROS's messages, by type; in [rad], [rad/s], [Nm] and [m/s2]."""


def _nested(kind: str) -> Iterator[str]:
    """Yield a type and the types of its fields, depth first."""
    yield kind
    for inner in re.findall(r"\w+/\w+", FIELDS[kind]):
        yield from _nested(inner)


def _definition(kind: str) -> str:
    """Return the definition of a type in ROS's own form, followed by those of the types of its fields."""
    lines = {each: FIELDS[each].replace(", ", "\n") + "\n" for each in _nested(kind)}
    own = lines.pop(kind)
    return own + "".join(f"{'=' * 80}\nMSG: {each}\n{text}" for each, text in lines.items())


DEFINITIONS = {
    JOINT_STATE: _definition("sensor_msgs/JointState"), IMU: _definition("sensor_msgs/Imu"), STRING: "string data\n",
}  # fmt: skip
"""Definitions of the types in ROS's own form, for readers that lack them."""

_UNKNOWN_COVARIANCE = (0.0,) * 9  # what zeros mean, by the definition of the message
_NO_ORIENTATION = (-1.0, *(0.0,) * 8)  # likewise


@lru_cache(maxsize=64)
def joint_state(joint_names: tuple[str, ...], velocity: bool, effort: bool) -> Layout:
    """Return the layout of sensor_msgs/JointState for some joints, with or without velocities and efforts."""
    count = len(joint_names)
    names = [part for name in joint_names for part in text(name)]
    counts = {"position": count, "velocity": count * velocity, "effort": count * effort}
    samples = [part for name, values in counts.items() for part in sequence(name, values)]
    return layout_of([*header(""), constant(count, "<u4"), *names, *samples])


@lru_cache(maxsize=1)
def imu() -> Layout:
    """Return the layout of sensor_msgs/Imu without an orientation."""
    orientation, unknown = constant((0, 0, 0, 1, *_NO_ORIENTATION), "<f8"), constant(_UNKNOWN_COVARIANCE, "<f8")
    angular_velocity, acceleration = number("angular_velocity", "<f8", 3), number("acceleration", "<f8", 3)
    return layout_of([*header("imu"), orientation, angular_velocity, unknown, acceleration, unknown])


def joint_messages(joint_names: tuple[str, ...], joints: JointStream) -> list[bytes]:
    """Return a joint or command stream as JointState messages."""
    layout = joint_state(joint_names, joints.velocity is not None, joints.torque is not None)
    rows = layout.stamped(nanoseconds(joints.time))
    for name, array in (("position", joints.position), ("velocity", joints.velocity), ("effort", joints.torque)):
        if array is not None:
            rows[name] = array
    return bodies(rows)


def imu_messages(stream: ImuStream) -> list[bytes]:
    """Return an IMU stream as Imu messages."""
    rows = imu().stamped(nanoseconds(stream.time))
    rows["angular_velocity"], rows["acceleration"] = stream.angular_velocity_in_imu, stream.acceleration_in_imu
    return bodies(rows)


def text_message(words: str) -> bytes:
    """Return a String message."""
    return layout_of(text(words)).template


def read_joints(messages: list[bytes], joint_names: tuple[str, ...], velocity: bool, torque: bool) -> JointStream:
    """Return the joint stream in JointState messages; raise RecordingError for other messages."""
    rows = joint_state(joint_names, velocity, torque).read(messages)
    rates, efforts = rows["velocity"] if velocity else None, rows["effort"] if torque else None
    return JointStream(seconds(stamps(rows)), rows["position"], rates, efforts)


def read_imu(messages: list[bytes]) -> ImuStream:
    """Return the IMU stream in Imu messages; raise RecordingError for other messages."""
    rows = imu().read(messages)
    return ImuStream(seconds(stamps(rows)), rows["angular_velocity"], rows["acceleration"])


def read_text(message: bytes) -> str:
    """Return the text of a String message; raise RecordingError for another message."""
    if len(message) < 9 or struct.unpack_from("<I", message, 4)[0] != len(message) - 8:
        raise RecordingError("a message on a topic of texts is not a text")
    return message[8:-1].decode()
