"""Pose of the IMU, and its source: a description, a frame of the model, or an assumption."""

import dataclasses

import numpy as np
import pytest
from robots import load_text, quadruped_mjcf, quadruped_urdf

from equipoise import RobotDescription
from equipoise.errors import SettingsError
from equipoise.robot.audit import audit
from equipoise.robot.imu import _is_imu, _looks_like_imu


def frame(name, xyz="0.1 0 0.02", parent="trunk", rpy="0 0 0"):
    """Return a link of a URDF without mass."""
    return (
        f'<link name="{name}"/><joint name="{name}_joint" type="fixed"><origin xyz="{xyz}" rpy="{rpy}"/>'
        f'<parent link="{parent}"/><child link="{name}"/></joint>'
    )


def sensor(link):
    return f'<gazebo reference="{link}"><sensor name="s" type="imu"><always_on>1</always_on></sensor></gazebo>'


@pytest.fixture
def imu_of(tmp_path):
    """Return the IMU of a URDF with additional elements."""
    return lambda extra, description=None: load_text(tmp_path, quadruped_urdf(extra=extra), description).imu


def test_a_frame_named_imu_is_taken_and_stated(imu_of):
    imu = imu_of(frame("imu_link", rpy="3.14159265 0 0"))
    np.testing.assert_allclose(imu.placement.translation, [0.1, 0, 0.02])
    assert (imu.frame, imu.is_assumed, imu.others, imu.proposed) == ("imu_link", False, (), ())
    assert imu.message == (
        "frame 'imu_link', at 100.0 0.0 20.0 mm in the base frame, turned by roll 180.0, pitch 0.0, yaw 0.0 deg"
    )


def test_a_frame_of_no_other_device_is_preferred_and_the_others_are_named(imu_of):
    imu = imu_of(frame("camera_imu_optical_frame") + frame("imu_link", "0 0 0.05") + frame("rear_imu"))
    assert (imu.frame, imu.others) == ("imu_link", ("rear_imu", "camera_imu_optical_frame"))
    assert imu.message == (
        "frame 'imu_link', at 0.0 0.0 50.0 mm in the base frame; also named like an IMU: "
        "rear_imu, camera_imu_optical_frame (--imu-frame NAME takes one)"
    )
    described = imu_of(frame("imu_link") + frame("rear_imu", "-0.1 0 0"), RobotDescription(imu_frame="rear_imu"))
    assert described.message == ("frame 'rear_imu' (described by imu_frame), at -100.0 0.0 0.0 mm in the base frame")


def test_without_a_frame_the_origin_of_the_base_is_assumed(imu_of):
    imu = imu_of("")
    assert imu.is_assumed
    np.testing.assert_array_equal(imu.placement.homogeneous, np.eye(4))
    assert imu.message == ("at the origin of base link 'trunk' (assumed: no frame of the model looks like an IMU)")


@pytest.mark.parametrize(
    ("extra", "proposed"),
    [
        (frame("bno085"), ("bno085",)),
        (frame("xsens_mount") + frame("gyro"), ("gyro", "xsens_mount")),
        (frame("gyro") + frame("board_7") + sensor("board_7"), ("board_7", "gyro")),
        (frame("camera_gyro_frame"), ()),
        (sensor("trunk"), ("trunk",)),
        (frame("lidar"), ()),
        (frame("bno085", parent="FL_link_2"), ()),  # what moves with a leg is not the base's IMU
    ],
)
def test_a_frame_that_is_named_otherwise_is_proposed_and_not_taken(imu_of, extra, proposed):
    imu = imu_of(extra)
    assert imu.is_assumed
    assert imu.proposed == proposed
    np.testing.assert_array_equal(imu.placement.homogeneous, np.eye(4))
    if proposed:
        names = " or ".join(map(repr, proposed))
        assert imu.message == (
            "at the origin of base link 'trunk' (assumed: no frame of the model is named imu, and "
            f"{names} may be the IMU's: --imu-frame {proposed[0]})"
        )


def test_a_described_frame_or_place_is_not_an_assumption(imu_of):
    taken = imu_of(frame("bno085"), RobotDescription(imu_frame="bno085"))
    assert not taken.is_assumed
    np.testing.assert_allclose(taken.placement.translation, [0.1, 0, 0.02])
    origin = imu_of("", RobotDescription(imu_position=(0.0, 0.0, 0.0)))
    assert origin.message == "described by imu_position, at 0.0 0.0 0.0 mm in the base frame"
    assert not imu_of("", RobotDescription(imu_frame="trunk")).is_assumed
    both = imu_of(frame("imu"), RobotDescription(imu_rpy=(0.0, 0.0, 1.5707963)))
    assert both.message == (
        "frame 'imu', imu_rpy as described, at 100.0 0.0 20.0 mm in the base frame, "
        "turned by roll 0.0, pitch 0.0, yaw 90.0 deg"
    )
    turned = imu_of("", RobotDescription(imu_rpy=(0.0, 0.0, 1.5707963)))
    assert turned.is_assumed  # of its position nothing is described
    assert "at the origin of base link 'trunk', turned as described (assumed:" in turned.message


@pytest.mark.parametrize(
    ("name", "message"),
    [
        (
            "imu_lnk",
            "imu_frame is 'imu_lnk', which is not a frame of the base; did you mean 'imu_link'? those are trunk, imu_link",
        ),
        ("FL_link_1", "imu_frame is 'FL_link_1', which is not fixed to the base: give a frame of the base link"),
    ],
)
def test_a_described_frame_that_is_not_on_the_base_is_refused(imu_of, name, message):
    with pytest.raises(SettingsError) as caught:
        imu_of(frame("imu_link"), RobotDescription(imu_frame=name))
    assert str(caught.value) == message


def test_a_site_of_an_mjcf_and_its_gyroscope(tmp_path):
    site = '<site name="imu" pos="0.05 0 0.01"/>'
    taken = load_text(tmp_path, quadruped_mjcf(trunk_extra=site), None, "robot.xml").imu
    assert taken.frame == "imu"
    np.testing.assert_allclose(taken.placement.translation, [0.05, 0, 0.01])
    read = '<sensor><gyro site="mid"/><accelerometer site="mid"/></sensor>'
    other = quadruped_mjcf(trunk_extra='<site name="mid" pos="0.05 0 0.01"/>', tail=read)
    assert load_text(tmp_path, other, None, "robot.xml").imu.proposed == ("mid",)


@pytest.mark.parametrize(
    "name",
    [
        "imu",
        "IMU_link",
        "base_imu",
        "trunkimu",
        "imu0",
        "imu_link_2",
        "bodyIMU",
        "IMULink",
        "trunkImu",
        "imulink",
        "base/imu",
    ],
)
def test_names_of_imus(name):
    assert _is_imu(name)


@pytest.mark.parametrize("name", ["simulation_frame", "base_simu", "maximum", "trunk", "stimulus", "bno085"])
def test_names_that_only_contain_the_letters(name):
    assert not _is_imu(name)


@pytest.mark.parametrize(
    "name",
    [
        "bno085", "BNO055_link", "mpu6050", "MPU_9250", "icm20948", "bmi088", "lsm6dsox", "xsens_mti", "mti630", "vn100",
        "vn_100", "vectornav", "microstrain", "3dm_gx5", "gx5_link", "cv7", "ahrs", "gyro", "gyro_link", "accelerometer",
        "base_accel", "inertial_sensor", "inertial_measurement_unit", "adis16470", "lpms_link", "wt901", "ins_link",
    ],
)  # fmt: skip
def test_names_of_chips_and_makers(name):
    assert _looks_like_imu(name)


@pytest.mark.parametrize(
    "name",
    [
        "trunk",
        "base_inertia",
        "base_inertial",
        "inspection_camera",
        "camera",
        "lidar",
        "mount",
        "FL_hip",
        "gps",
        "arm_1",
    ],
)
def test_names_of_other_frames(name):
    assert not _looks_like_imu(name)


def test_the_frames_of_the_base_are_links_not_joints(tmp_path):
    robot = load_text(tmp_path, quadruped_urdf(extra=frame("bno085")))
    assert robot.imu.frames == ("trunk", "bno085")


def test_an_audit_states_it(tmp_path):
    found = audit(load_text(tmp_path, quadruped_urdf(extra=frame("bno085"))))
    assert found.to_dict()["imu"]["proposed"] == ["bno085"]
    assert found.to_dict()["imu"]["assumed"] is True
    assert "--imu-frame bno085" in found.imu.message


def test_another_description_moves_the_imu(tmp_path):
    robot = load_text(tmp_path, quadruped_urdf(extra=frame("bno085")))
    described = dataclasses.replace(robot, description=RobotDescription(imu_frame="bno085"))
    np.testing.assert_allclose(described.imu_in_base.translation, [0.1, 0, 0.02])
