"""Logs in shapes that others write, each made of one simulated trot. Those marked are read wrongly so far."""

import csv
import re
from pathlib import Path

import numpy as np
import pytest

from equipoise import load_robot, simulate
from equipoise.errors import ColumnsError, EquipoiseError, RecordingError
from equipoise.lab.gaits.trot import trot
from equipoise.logs.joint_names import JointMap
from equipoise.logs.offline import estimate_log
from equipoise.logs.raw_log import Log
from equipoise.logs.reader import read_log
from equipoise.logs.tables.column_names import Columns
from equipoise.precise.method import Precise
from equipoise.user_file import toml_table

EPOCH = 1_700_000_000  # [s]
QUANTITIES = ("position", "velocity", "torque")
UNITREE = ("FR", "FL", "RR", "RL")
DURATION, MASS = 8.0, 13.6  # [s], [kg]


def later(reason, raises=AssertionError):
    return pytest.mark.xfail(strict=True, raises=raises, reason=reason)


@pytest.fixture(scope="module")
def a1():
    return load_robot("unitree_a1")


@pytest.fixture(scope="module")
def trotted(a1):
    """Columns of a trot's table by our names, joints and IMU in the same rows."""
    with simulate(a1, "realistic", "1.2,0.06,0.02,0.08", seed=7, timestep=1e-3) as simulation:
        log = trot(simulation.platform, a1, DURATION)
    time = log.joints.time
    table = {"time": time - time[0]}
    for quantity in QUANTITIES:
        columns = getattr(log.joints, quantity).T
        table |= {f"{quantity}.{name}": column for name, column in zip(a1.joint_names, columns, strict=True)}
    for sensor, values in (("gyro", log.imu.angular_velocity_in_imu), ("accelerometer", log.imu.acceleration_in_imu)):
        table |= {f"{sensor}.{axis}": np.interp(time, log.imu.time, values[:, at]) for at, axis in enumerate("xyz")}
    return {name: np.round(column, 6) for name, column in table.items()}


@pytest.fixture(scope="module")
def expected(a1, trotted, tmp_path_factory):
    """The trot as it is read from a table with our names."""
    return read_log(write(tmp_path_factory.mktemp("ours") / "trot.csv", trotted), a1).recording


def write(path: Path, columns):
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))
    return path


def proposal_for(robot, path):
    with pytest.raises(ColumnsError) as raised:
        read_log(path, robot)
    return raised.value.proposal


def accepted(robot, path):
    """The log as it is read, where it has to be with the columns that are proposed."""
    try:
        return read_log(path, robot).recording
    except ColumnsError as error:
        proposal = error.proposal
    return read_log(path, robot, columns=Columns.from_text(proposal, "the proposal")).recording


def assert_same(found, expected):
    """Assert that two recordings hold the same samples, from any start."""
    for quantity in QUANTITIES:
        np.testing.assert_allclose(getattr(found.joints, quantity), getattr(expected.joints, quantity), atol=1e-5)
    np.testing.assert_allclose(found.imu.angular_velocity_in_imu, expected.imu.angular_velocity_in_imu, atol=1e-5)
    np.testing.assert_allclose(found.imu.acceleration_in_imu, expected.imu.acceleration_in_imu, atol=1e-5)
    np.testing.assert_allclose(np.diff(found.joints.time), np.diff(expected.joints.time), atol=1e-5)


def in_order(robot, legs):
    """Names of the joints, leg by leg."""
    return [robot.joint_names[joint] for leg in legs for joint in robot.legs[leg].joints]


def test_the_trot_with_our_names_is_estimated_without_a_failed_check(a1, expected):
    result = estimate_log(a1, Log(expected, JointMap(()), {}, ()), Precise(mass=MASS, mass_sd=0.1)).result
    assert all(check.passed for check in result.checks)


@later("23: a column of nanoseconds that wraps every second is taken for the time", raises=RecordingError)
def test_23_seconds_and_nanoseconds_in_two_columns_are_one_time(a1, trotted, expected, tmp_path):
    nanoseconds = np.round((trotted["time"] + 0.25) * 1e9).astype(np.int64)
    rest = {name: column for name, column in trotted.items() if name != "time"}
    stamps = {"stamp.sec": EPOCH + nanoseconds // 10**9, "stamp.nanosec": nanoseconds % 10**9}
    assert_same(accepted(a1, write(tmp_path / "log.csv", {**stamps, **rest})), expected)


@later("24: names of joints in the cells are not read; the model's order is assumed")
def test_24_names_of_joints_in_cells_determine_the_order_of_joints(a1, trotted, expected, tmp_path):
    stamp = EPOCH * 10**9 + np.round(trotted["time"] * 1e9).astype(np.int64)
    names = in_order(a1, UNITREE)
    columns = {"%time": stamp, "field.header.seq": np.arange(len(stamp)), "field.header.stamp": stamp}
    columns |= {f"field.name{at}": [name] * len(stamp) for at, name in enumerate(names)}
    for ours, theirs in (("position", "position"), ("velocity", "velocity"), ("torque", "effort")):
        columns |= {f"field.{theirs}{at}": trotted[f"{ours}.{name}"] for at, name in enumerate(names)}
    for ours, theirs in (("gyro", "angular_velocity"), ("accelerometer", "linear_acceleration")):
        columns |= {f"field.{theirs}.{axis}": trotted[f"{ours}.{axis}"] for axis in "xyz"}
    assert_same(accepted(a1, write(tmp_path / "log.csv", columns)), expected)


@later("26: the torques, or the floor, are blamed")
@pytest.mark.parametrize("torques", [True, False])
def test_26_an_accelerometer_that_points_down_is_named(a1, trotted, tmp_path, torques):
    columns = {name: -column if name.startswith("acc") else column for name, column in trotted.items()}
    kept = {name: column for name, column in columns.items() if torques or not name.startswith("torque")}
    with pytest.raises(EquipoiseError) as raised:
        estimate_log(a1, read_log(write(tmp_path / "log.csv", kept), a1), Precise(mass=MASS))
    assert re.search("accelerometer has the wrong sign|IMU (hangs|is) upside down", str(raised.value))


@later("27: an IMU's columns with units in their names are not found", raises=RecordingError)
def test_27_columns_of_an_imu_may_have_units_in_their_names(a1, trotted, expected, tmp_path):
    columns = {
        re.sub(r"^accelerometer\.(.)", r"acc_\1 [m/s^2]", re.sub(r"^gyro\.(.)", r"gyro_\1 [rad/s]", name)): column
        for name, column in trotted.items()
    }
    assert_same(accepted(a1, write(tmp_path / "log.csv", columns)), expected)


@later("29: the model's order of legs is assumed for the names that Unitree gives its motors")
def test_29_unitrees_motors_are_in_unitrees_order(a1, trotted, expected, tmp_path):
    columns = {"tick": trotted["time"]}
    for ours, theirs in (("position", "q"), ("velocity", "dq"), ("torque", "tauEst")):
        for at, name in enumerate(in_order(a1, UNITREE)):
            columns[f"motorState[{at}].{theirs}"] = trotted[f"{ours}.{name}"]
    for ours, theirs in (("gyro", "gyroscope"), ("accelerometer", "accelerometer")):
        columns |= {f"imu.{theirs}[{at}]": trotted[f"{ours}.{axis}"] for at, axis in enumerate("xyz")}
    assert_same(accepted(a1, write(tmp_path / "log.csv", columns)), expected)


def test_30_a_log_without_time_is_asked_for_it_and_the_base_is_not_taken_for_joints(a1, trotted, tmp_path):
    time, zero = trotted["time"], np.zeros_like(trotted["time"])
    half_roll = 0.01 * np.sin(7 * time)
    base = [0.4 * time, 0.01 * np.sin(time), 0.3 + zero, half_roll, zero, zero, np.sqrt(1 - half_roll**2)]
    position, velocity, torque = ([trotted[f"{one}.{name}"] for name in a1.joint_names] for one in QUANTITIES)
    gyro, accelerometer = ([trotted[f"{one}.{axis}"] for axis in "xyz"] for one in ("gyro", "accelerometer"))
    moved = [0.4 + zero, 0.01 * np.cos(time), zero, *gyro]
    np.savez(
        tmp_path / "log.npz", q=np.array([*base, *position]), dq=np.array([*moved, *velocity]), tau=np.array(torque),
        imu=np.array([*gyro, *accelerometer]),
    )  # fmt: skip
    proposed = toml_table(proposal_for(a1, tmp_path / "log.npz"))
    assert "time" not in proposed
    assert [proposed["position"][name] for name in a1.joint_names] == [f"q[{at}]" for at in range(7, 19)]
    assert [proposed["velocity"][name] for name in a1.joint_names] == [f"dq[{at}]" for at in range(6, 18)]
