"""Samples from ROS 2 messages: layout on the wire, joint names, and times."""

import math
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("cyclonedds")

from equipoise.drivers.ros2.ros_messages import (
    Duration,
    Float64MultiArray,
    Header,
    Imu,
    JointState,
    JointTrajectory,
    JointTrajectoryPoint,
    MultiArrayDimension,
    MultiArrayLayout,
    Quaternion,
    Time,
    Vector3,
    dds_topic,
)
from equipoise.drivers.ros2.sensor_topics import ImuTopic, JointTopic, StampClock, together
from equipoise.errors import MotionError, SettingsError

NAMES = ("hip", "thigh", "calf")
STATE = JointState(
    Header(Time(7, 250_000_000), "base"), ["calf", "arm", "hip", "thigh"], [3.0, 9.0, 1.0, 2.0], [30.0, 90.0, 10.0, 20.0],
    [-3.0, -9.0, -1.0, -2.0],
)  # fmt: skip
IMU = Imu(
    Header(Time(7, 251_000_000), "imu_link"), Quaternion(w=1.0), [-1.0] + 8 * [0.0], Vector3(0.1, 0.2, 0.3),
    linear_acceleration=Vector3(1.0, 2.0, 9.81),
)  # fmt: skip
MESSAGES = [
    STATE,
    IMU,
    Float64MultiArray(
        MultiArrayLayout([MultiArrayDimension("odd", 2, 3), MultiArrayDimension("", 0, 1)], 5), [0.1, 0.2]
    ),
    Float64MultiArray(data=[1.0, -2.0, 3.0]),
    JointTrajectory(
        Header(Time(1, 2), "x"),
        ["a", "bcd"],
        [
            JointTrajectoryPoint([1.0, 2.0], time_from_start=Duration(0, 2_000_000)),
            JointTrajectoryPoint([3.0, 4.0], [5.0, 6.0], [7.0], [8.0, 9.0], Duration(1, 5)),
        ],
    ),
]


def joints(by_header=True):
    return JointTopic("/joint_states", StampClock(by_header), NAMES)


def imu(by_header=True):
    return ImuTopic("/imu/data", StampClock(by_header))


def unstamped(message):
    return replace(message, header=Header()).serialize()


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: type(message).__name__)
def test_messages_are_on_the_wire_what_ros_makes_of_them(message):
    """The other encoder is rosbags', made from the .msg definitions."""
    rosbags = pytest.importorskip("rosbags.typesys")
    store = rosbags.get_typestore(rosbags.Stores.ROS2_HUMBLE)
    dds_name = type(message).__idl__.idl_transformed_typename
    package, kind, mangled, name = dds_name.split("::")
    assert (kind, mangled, name[-1]) == ("msg", "dds_", "_")
    ros_name = f"{package}/msg/{name[:-1]}"
    theirs = store.deserialize_cdr(bytes(message.serialize()), ros_name)
    ours = bytes(message.serialize())
    assert bytes(store.serialize_cdr(theirs, ros_name))[: len(ours)] == ours
    assert type(message).deserialize(ours) == message


def test_topics_have_the_names_that_ros_gives_them():
    assert dds_topic("/joint_states") == "rt/joint_states"


def test_joints_are_found_by_their_names():
    topic = joints()
    assert topic.add(100.0, STATE.serialize())
    sample = topic.newest
    assert sample.position.tolist() == [1, 2, 3]
    assert sample.velocity.tolist() == [10, 20, 30]
    assert sample.torque.tolist() == [-1, -2, -3]
    assert sample.received == 100.0


def test_what_the_joints_do_not_report_is_none():
    topic = joints()
    topic.add(0.0, replace(STATE, velocity=[], effort=[math.nan, 0.0, 1.0, 2.0]).serialize())
    assert topic.newest.velocity is None
    assert topic.newest.torque is None
    other_joints_lack_it = replace(STATE, effort=[1.0, math.nan, 2.0, 3.0])
    topic.add(0.0, other_joints_lack_it.serialize())
    assert topic.newest.torque.tolist() == [2, 3, 1]


def test_joints_that_are_missing_are_named_with_those_that_are_there():
    message = replace(STATE, name=["FL_calf", "arm", "hip", "thigh"])
    with pytest.raises(SettingsError, match="/joint_states lacks the model's 'calf'; it has 'FL_calf', 'arm', 'hip'"):
        joints().add(0.0, message.serialize())


def test_joints_of_another_device_are_neither_sample_nor_damage():
    topic = joints()
    gripper = JointState(Header(Time(1, 0)), ["finger"], [0.1])
    assert not topic.add(0.0, gripper.serialize())
    assert topic.newest is None
    assert (topic.others, topic.damaged) == (("finger",), 0)


def test_damaged_messages_are_counted_and_left_out():
    topic = joints()
    data = bytearray(STATE.serialize())
    at = data.index(b"thigh")
    data[at] = 0xFF  # no text
    for damaged in (bytes(data), STATE.serialize()[:60], replace(STATE, position=[1.0]).serialize()):
        assert not topic.add(0.0, damaged)
    assert topic.damaged == 3
    assert topic.newest is None


def test_an_imu_is_read_in_its_own_frame():
    topic = imu()
    assert topic.add(5.0, IMU.serialize())
    assert topic.newest.angular_velocity_in_imu.tolist() == [0.1, 0.2, 0.3]
    assert topic.newest.acceleration_in_imu.tolist() == [1, 2, 9.81]
    assert topic.newest.received == 5.0


@pytest.mark.parametrize("lacking", ["angular_velocity_covariance", "linear_acceleration_covariance"])
def test_an_imu_that_reports_missing_data_is_refused(lacking):
    message = replace(IMU, **{lacking: [-1.0] + 8 * [0.0]})
    with pytest.raises(MotionError, match="/imu/data reports no angular velocity or no acceleration"):
        imu().add(0.0, message.serialize())


def test_times_count_from_the_first_second_and_are_exact_to_the_nanosecond():
    clock = StampClock(by_header=True)
    day = 1_800_000_000
    first = clock.time(Header(Time(day, 999_999_999)), 0.0)
    second = clock.time(Header(Time(day + 1, 1)), 0.0)
    assert second - first == pytest.approx(2e-9, abs=1e-15)


def test_both_topics_share_one_clock():
    clock = StampClock(by_header=True)
    joint_topic, imu_topic = JointTopic("/j", clock, NAMES), ImuTopic("/i", clock)
    joint_topic.add(0.0, STATE.serialize())
    imu_topic.add(0.0, IMU.serialize())
    assert imu_topic.newest.time - joint_topic.newest.time == pytest.approx(1e-3)


def test_a_state_is_as_old_as_the_older_of_its_two_samples():
    clock = StampClock(by_header=True)
    joint_topic, imu_topic = JointTopic("/j", clock, NAMES), ImuTopic("/i", clock)
    joint_topic.add(10.0, STATE.serialize())
    imu_topic.add(9.9, IMU.serialize())
    state = together(joint_topic.newest, imu_topic.newest, None)
    assert state.received == 9.9
    assert (state.time, state.imu_time) == (joint_topic.newest.time, imu_topic.newest.time)
    assert state.joint_position.tolist() == [1, 2, 3]
    assert state.acceleration_in_imu.tolist() == [1, 2, 9.81]


def test_samples_of_two_clocks_are_refused():
    clock = StampClock(by_header=True)
    joint_topic, imu_topic = JointTopic("/j", clock, NAMES), ImuTopic("/i", clock)
    joint_topic.add(0.0, STATE.serialize())
    imu_topic.add(0.0, replace(IMU, header=Header(Time(1_800_000_000, 0))).serialize())
    with pytest.raises(
        MotionError, match=r"joints and IMU are stamped -1799999992\.8 s apart: do all nodes use one clock"
    ):
        together(joint_topic.newest, imu_topic.newest, None)


def test_arrival_is_a_time_too():
    topic = joints(by_header=False)
    assert topic.add(123.4, unstamped(STATE))
    assert topic.newest.time == 123.4


@pytest.mark.parametrize(("make", "message"), [(joints, STATE), (imu, IMU)])
def test_a_simulation_begins_at_time_zero_but_a_clock_that_stands_there_is_refused(make, message):
    topic = make()
    assert not topic.add(0.0, unstamped(message))
    assert topic.add(0.1, message.serialize())
    with pytest.raises(MotionError, match="the stamps are zero"):
        topic.add(0.2, unstamped(message))


@pytest.mark.parametrize(("pace", "fault"), [(0.3, "0.30"), (1.0, None), (0.8, None), (2.0, "2.00")])
def test_slow_motion_is_reported_as_a_fault_of_the_robot(pace, fault):
    clock = StampClock(by_header=True)
    for received in np.arange(0, 5, 0.01):
        clock.compare(pace * received, received)
    if fault is None:
        assert clock.health is None
    else:
        assert clock.health.fault == f"its clock runs {fault} times as fast as this computer's"
    for received in np.arange(5, 10, 0.01):
        clock.compare(5 * pace + received - 5, received)
    assert clock.health is None
