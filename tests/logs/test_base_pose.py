"""Logs with the pose of the base in place of an accelerometer, as of motion capture: three files without names."""

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from equipoise import load_robot, simulate
from equipoise.bayesian.method import BayesianMethod
from equipoise.errors import RecordingError
from equipoise.lab.gaits.trot import trot
from equipoise.logs.base_pose import imu_of_poses
from equipoise.logs.offline import estimate_log
from equipoise.logs.reader import read_log
from equipoise.logs.tables.column_names import Columns
from equipoise.robot.inertial import components

UNITREE = ("FR", "FL", "RR", "RL")
POSITION_NOISE, ANGLE_NOISE = 3e-4, 1e-3  # [m], [rad]
RATE = 200  # [Hz]
NAMES = ("p_sense.csv", "v_sense.csv", "tau_sense.csv")


@pytest.fixture(scope="module")
def a1():
    return load_robot("unitree_a1")


@pytest.fixture(scope="module")
def walked(a1):
    """A trot, the poses of its base (time, x y z, w x y z), and the true body."""
    poses = []
    with simulate(a1, "realistic", "1.2,0.06,0.02,0.08", seed=7) as simulation:
        platform, step = simulation.platform, simulation.platform.step

        def seen(command):
            state = step(command)
            poses.append((state.time, *platform._data.qpos[:7]))
            return state

        platform.step = seen
        log = trot(platform, a1, 12.0)
    return log, np.array(poses), simulation.truth.composite


@pytest.fixture(scope="module")
def files(a1, walked, tmp_path_factory):
    """The trot as three files without names, each row after its time in nanoseconds; legs in Unitree's order."""
    (log, poses, _), random = walked, np.random.default_rng(1)
    time = np.arange(log.joints.time[0] + 0.02, log.joints.time[-1] - 0.02, 1 / RATE)

    def at(times, values):
        return np.column_stack([np.interp(time, times, column) for column in values.T])

    position = at(poses[:, 0], poses[:, 1:4]) + random.normal(0, POSITION_NOISE, (len(time), 3))
    turns = Rotation.from_rotvec(random.normal(0, ANGLE_NOISE, (len(time), 3)))
    quaternion = (Rotation.from_quat(np.roll(at(poses[:, 0], poses[:, 4:]), -1, axis=1)) * turns).as_quat()
    order = [a1.joint_names.index(joint) for leg in UNITREE for joint in a1.legs[leg].joint_names]
    joints, imu = log.joints, log.imu
    of_joints = [at(joints.time, values)[:, order] for values in (joints.position, joints.velocity, joints.torque)]
    turning, speed = at(imu.time, imu.angular_velocity_in_imu), np.gradient(position, time, axis=0)
    tables = ([position, quaternion, of_joints[0]], [speed, turning, of_joints[1]], [of_joints[2]])
    folder, stamps = (
        tmp_path_factory.mktemp("capture"),
        np.int64(1_700_000_000_000_000_000) + (time * 1e9).astype(np.int64),
    )
    for name, table in zip(NAMES, tables, strict=True):
        rows = zip(stamps, np.hstack(table), strict=True)
        (folder / name).write_text("".join(f"{at},{','.join(map(repr, row.tolist()))}\n" for at, row in rows))
    return [folder / name for name in NAMES]


def proposal(robot, paths):
    with pytest.raises(RecordingError) as raised:
        read_log(paths[0], robot, tables=paths[1:])
    return raised.value.report.text


def in_unitrees_order(text):
    return re.sub(r"(?m)^(\w+\.[FR])([LR])_", lambda found: f"{found[1]}{'LR'[found[2] == 'L']}_", text)


@pytest.mark.parametrize("with_gyroscope", [True, False])
def test_a_walk_with_the_pose_of_the_base_gives_mass_and_com(a1, walked, files, with_gyroscope):
    paths = files if with_gyroscope else files[::2]
    text = in_unitrees_order(proposal(a1, paths))
    assert ("gyro.x" in text) == with_gyroscope
    log = read_log(paths[0], a1, columns=Columns.from_text(text, "the proposal"), tables=paths[1:])
    (finding,) = (one.message for one in log.findings if one.about == "IMU")
    assert "specific force from the base's pose" in finding
    noise = [float(number) for number in re.findall(r"([\d.]+) m(?:m|rad)", finding)]
    assert noise == pytest.approx([1e3 * POSITION_NOISE, 1e3 * ANGLE_NOISE], rel=0.15)
    truth = components(walked[2])
    result = estimate_log(a1, log, BayesianMethod(mass=truth[0], mass_std=0.005 * truth[0])).result
    assert result.trustworthy
    known = [one for one in zip(result.composite, truth, strict=True) if one[0].verdict in ("identified", "weak")]
    assert {"mass", "com_x", "com_y"} <= {quantity.name for quantity, _ in known}
    for quantity, true in zip(result.composite, truth, strict=True):
        assert abs(quantity.value - true) < 2.5 * quantity.std, quantity.name
    assert np.abs(result.composite.com_in_base.values[:2] - truth[1:3]).max() < 6e-3


def test_the_order_of_legs_that_the_gyroscope_contradicts_is_named(a1, files):
    log = read_log(files[0], a1, columns=Columns.from_text(proposal(a1, files), "the proposal"), tables=files[1:])
    with pytest.raises(RecordingError, match="agrees with the legs only in the order FR FL RR RL"):
        estimate_log(a1, log)


def test_samples_from_exact_poses_are_those_of_the_imu_that_moved_so(a1):
    time = np.arange(0, 4, 0.005)
    angle, rate, growth = 0.3 * np.sin(3 * time), 0.9 * np.cos(3 * time), -2.7 * np.sin(3 * time)
    rotation = Rotation.from_rotvec(np.outer(angle, [0, 1, 0]))
    position = np.column_stack([0.2 * np.sin(4 * time), 0 * time, 0.3 + 0 * time])
    imu, _ = imu_of_poses(
        a1, time, position, np.roll(rotation.as_quat(), 1, axis=1) * np.sign(np.cos(9 * time))[:, None]
    )
    arm = np.array(a1.imu_in_base.translation)
    turning, turning_rate = np.outer(rate, [0, 1, 0]), np.outer(growth, [0, 1, 0])
    force = np.column_stack([-3.2 * np.sin(4 * time), 0 * time, 9.81 + 0 * time])
    expected = rotation.inv().apply(force) + np.cross(turning_rate, arm) + np.cross(turning, np.cross(turning, arm))
    to_imu = np.array(a1.imu_in_base.rotation)
    for found, true in ((imu.acceleration_in_imu, expected), (imu.angular_velocity_in_imu, turning)):
        at = np.column_stack([np.interp(imu.time, time, column) for column in (true @ to_imu).T])
        assert np.abs(found - at).max() < 2e-3


def test_poses_that_repeat_are_left_out_and_gaps_are_not_bridged(a1):
    time = np.arange(0, 6, 0.005)
    held = np.repeat(time[::2], 2)
    position = np.column_stack([np.sin(held), 0 * held, 0 * held])
    position[400:500] = np.nan
    level = np.tile([1.0, 0, 0, 0], (len(time), 1))
    imu, message = imu_of_poses(a1, time, position, level)
    assert float(re.search(r"noise of (\S+) mm", message)[1]) < 0.01  # that of held poses would be a millimetre
    assert not ((imu.time > time[400]) & (imu.time < time[499])).any()
    assert imu.time[[0, -1]] == pytest.approx([0, 6], abs=0.1)


def test_a_gyroscope_whose_stamps_go_back_is_read_at_those_that_increase(a1):
    time = np.arange(0, 4, 0.005)
    turning = np.outer(np.cos(3 * time), [0, 0.9, 0])
    quaternion = np.column_stack([np.cos(0.15 * np.sin(3 * time)), 0 * time, np.sin(0.15 * np.sin(3 * time)), 0 * time])
    repeated = np.concatenate([np.arange(400), np.arange(300, len(time))])  # half a second is written twice
    imu, _ = imu_of_poses(a1, time[repeated], np.zeros((len(repeated), 3)), quaternion[repeated], turning[repeated])
    assert (np.diff(imu.time) > 0).all()
    np.testing.assert_allclose(imu.angular_velocity_in_imu, np.outer(np.cos(3 * imu.time), [0, 0.9, 0]), atol=1e-12)


def test_poses_that_cannot_be_right_are_refused(a1):
    time = np.arange(0, 3, 0.005)
    position, level = np.zeros((len(time), 3)), np.tile([1.0, 0, 0, 0], (len(time), 1))
    with pytest.raises(RecordingError, match=r"have a norm of 0\.5"):
        imu_of_poses(a1, time, position, 0.5 * level)
    with pytest.raises(RecordingError, match="10 poses of the base a second"):
        imu_of_poses(a1, 20 * time, position, level)
    with pytest.raises(RecordingError, match="without a gap"):
        imu_of_poses(a1, time[:80], position[:80], level[:80])
