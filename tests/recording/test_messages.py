"""Messages of a recording, against another implementation of ROS 2's formats."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rosbags.typesys import Stores, get_typestore

from equipoise.errors import RecordingError
from equipoise.recording.messages import (
    DEFINITIONS,
    IMU,
    JOINT_STATE,
    STRING,
    imu_messages,
    joint_messages,
    read_imu,
    read_joints,
    read_text,
    text_message,
)
from equipoise.recording.recording import ImuStream, JointStream

ROS = get_typestore(Stores.ROS2_HUMBLE)
NUMBERS = st.floats(allow_nan=False, allow_infinity=False, width=64)
NAMES = st.lists(st.text(st.characters(codec="utf-8", exclude_characters="\0")), min_size=1, max_size=3)


def joints_of(values, velocity=True, torque=True):
    time = 12.25 + np.arange(len(values)) / 3
    return JointStream(time, values, -values if velocity else None, 0.5 * values if torque else None)


@given(NAMES, st.booleans(), st.booleans(), st.data())
def test_joint_states_are_what_ros_reads_and_writes(names, velocity, torque, data):
    values = data.draw(arrays(float, (3, len(names)), elements=NUMBERS))
    joints = joints_of(values, velocity, torque)
    messages = joint_messages(tuple(names), joints)
    for index, message in enumerate(messages):
        read = ROS.deserialize_cdr(message, JOINT_STATE)
        assert read.header.stamp.sec + read.header.stamp.nanosec / 1e9 == joints.time[index]
        assert list(read.name) == names
        assert np.array_equal(read.position, values[index])
        assert np.array_equal(read.velocity, -values[index] if velocity else [])
        assert np.array_equal(read.effort, 0.5 * values[index] if torque else [])
        assert bytes(ROS.serialize_cdr(read, JOINT_STATE)) == message
    again = read_joints(messages, tuple(names), velocity, torque)
    for one, other in zip(vars(again).values(), vars(joints).values(), strict=True):
        assert (one is None) == (other is None)
        assert one is None or one.tobytes() == other.tobytes()


@given(arrays(float, (2, 6), elements=NUMBERS))
def test_imu_messages_are_what_ros_reads_and_writes(values):
    stream = ImuStream([0.0, 1e6 / 7], values[:, :3], values[:, 3:])
    messages = imu_messages(stream)
    for index, message in enumerate(messages):
        read = ROS.deserialize_cdr(message, IMU)
        rate, acceleration = read.angular_velocity, read.linear_acceleration
        assert [rate.x, rate.y, rate.z, acceleration.x, acceleration.y, acceleration.z] == values[index].tolist()
        assert read.orientation_covariance[0] == -1  # an orientation that is not known
        assert not read.angular_velocity_covariance.any()
        assert read.header.frame_id == "imu"
        assert bytes(ROS.serialize_cdr(read, IMU)) == message
    again = read_imu(messages)
    for one, other in zip(vars(again).values(), vars(stream).values(), strict=True):
        assert one is other or one.tobytes() == other.tobytes()


@given(st.text(st.characters(codec="utf-8", exclude_characters="\0")))
def test_texts_are_what_ros_reads_and_writes(text):
    message = text_message(text)
    assert ROS.deserialize_cdr(message, STRING).data == text
    assert bytes(ROS.serialize_cdr(ROS.deserialize_cdr(message, STRING), STRING)) == message
    assert read_text(message) == text


@pytest.mark.parametrize("kind", [JOINT_STATE, IMU, STRING])
def test_definitions_are_those_of_ros(kind):
    assert DEFINITIONS[kind].strip() == ROS.generate_msgdef(kind, ros_version=2)[0].strip()


def test_times_before_zero_are_kept():
    joints = JointStream([-1.25, -1e-9], np.zeros((2, 1)))
    read = read_joints(joint_messages(("a",), joints), ("a",), velocity=False, torque=False)
    assert np.array_equal(read.time, joints.time)


def test_no_messages_are_an_empty_stream():
    assert read_joints([], ("a",), velocity=True, torque=False).velocity.shape == (0, 1)
    assert read_joints([], ("a",), velocity=True, torque=False).torque is None


def test_messages_of_other_joints_or_types_are_refused():
    messages = joint_messages(("a", "b"), joints_of(np.ones((3, 2))))
    with pytest.raises(RecordingError, match="name different joints"):
        read_joints(messages, ("a", "c"), velocity=True, torque=True)
    with pytest.raises(RecordingError, match="a message of 108 bytes is among messages of 84"):
        read_joints(messages, ("a", "b"), velocity=False, torque=True)
    with pytest.raises(RecordingError, match="a message of 108 bytes is among messages of 316"):
        read_imu(messages)


@pytest.mark.parametrize("message", [b"", b"\0\1\0\0", b"\0\1\0\0\5\0\0\0ab\0"])
def test_invalid_text_is_rejected(message):
    with pytest.raises(RecordingError, match="not a text"):
        read_text(message)
