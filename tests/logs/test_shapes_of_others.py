"""Logs in shapes that others write, each made of one simulated trot."""

import csv
import gzip
import io
import json
from pathlib import Path

import numpy as np
import pytest
from foreign_logs import write_parquet

from equipoise import load_robot, simulate
from equipoise.bayesian.method import BayesianMethod
from equipoise.cli import main
from equipoise.errors import EquipoiseError, RecordingError, SettingsError
from equipoise.lab.gaits.trot import trot
from equipoise.logs.joint_names import JointMap
from equipoise.logs.offline import estimate_log
from equipoise.logs.raw_log import Log
from equipoise.logs.reader import read_log
from equipoise.logs.tables.column_names import STANDARD_GRAVITY, Columns
from equipoise.terminal.column_dialogue import ask_columns
from equipoise.user_file import toml_table

EPOCH = 1_700_000_000  # [s]
QUANTITIES = ("position", "velocity", "torque")
SENSORS = ("gyro", "accelerometer")
UNITREE = ("FR", "FL", "RR", "RL")
DURATION, MASS, RATE = 8.0, 13.6, 500  # [s], [kg], [Hz]


@pytest.fixture(scope="module")
def a1():
    return load_robot("unitree_a1")


@pytest.fixture(scope="module")
def whole(a1):
    """Columns of a trot's table by documented names, joints and IMU in the same rows."""
    with simulate(a1, "realistic", "1.2,0.06,0.02,0.08", seed=7) as simulation:
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
def trotted(whole):
    """A part of it that is long enough to be read."""
    return {name: column[1000:1600] for name, column in whole.items()}


@pytest.fixture(scope="module")
def expected(a1, trotted, tmp_path_factory):
    """The trot as it is read from a table with documented names."""
    return read_log(write(tmp_path_factory.mktemp("ours") / "trot.csv", trotted), a1).recording


def write(path: Path, columns, delimiter=","):
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, delimiter=delimiter)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))
    return path


def proposal_for(robot, path, **options):
    with pytest.raises(RecordingError) as raised:
        read_log(path, robot, **options)
    return raised.value.report.text


def accepted(robot, path, **options):
    """The log as it is read, where it has to be with the columns that are proposed."""
    try:
        return read_log(path, robot, **options).recording
    except RecordingError as error:
        proposal = error.report.text
    options |= {"columns": Columns.from_text(proposal, "the proposal")}
    return read_log(path, robot, **options).recording


def assert_same(found, expected, atol=1e-5):
    """Assert that two recordings hold the same samples, from any start."""
    for quantity in QUANTITIES:
        np.testing.assert_allclose(getattr(found.joints, quantity), getattr(expected.joints, quantity), atol=atol)
    np.testing.assert_allclose(found.imu.angular_velocity_in_imu, expected.imu.angular_velocity_in_imu, atol=atol)
    np.testing.assert_allclose(found.imu.acceleration_in_imu, expected.imu.acceleration_in_imu, atol=atol)
    np.testing.assert_allclose(np.diff(found.joints.time), np.diff(expected.joints.time), atol=1e-5)


def in_order(robot, legs):
    """Names of the joints, leg by leg."""
    return [robot.joint_names[joint] for leg in legs for joint in robot.legs[leg].joints]


def without(columns, *kinds):
    return {name: column for name, column in columns.items() if name.split(".")[0] not in kinds}


def test_the_trot_with_our_names_is_estimated_without_a_failed_check(a1, whole, tmp_path):
    log = read_log(write(tmp_path / "trot.csv", whole), a1)
    result = estimate_log(a1, Log(log.recording, JointMap(()), {}, ()), BayesianMethod(mass=MASS, mass_std=0.1)).result
    assert all(check.passed for check in result.checks)


# --- time


@pytest.mark.parametrize(
    ("seconds", "rest", "unit"),
    [
        ("stamp.sec", "stamp.nanosec", 1e-9),
        ("header.stamp.secs", "header.stamp.nsecs", 1e-9),
        ("sec", "nanosec", 1e-9),
        ("secs", "nsecs", 1e-9),
        ("/joint_states/header/stamp/sec [s]", "/joint_states/header/stamp/nanosec [ns]", 1e-9),
        ("tv_sec", "tv_usec", 1e-6),
    ],
)
def test_23_seconds_and_a_remainder_in_two_columns_are_one_time(a1, trotted, expected, tmp_path, seconds, rest, unit):
    nanoseconds = np.round((trotted["time"] + 0.25) * 1e9).astype(np.int64)
    stamps = {rest: nanoseconds % 10**9 // round(unit * 1e9), seconds: EPOCH + nanoseconds // 10**9}
    assert_same(accepted(a1, write(tmp_path / "log.csv", {**stamps, **without(trotted, "time")})), expected)


@pytest.mark.parametrize("rest", ["stamp.nanosec", "nsecs", "header_stamp_nsec"])
def test_a_remainder_without_its_seconds_is_not_a_time(a1, trotted, tmp_path, rest):
    remainder = np.round(trotted["time"] * 1e9).astype(np.int64) % 10**9
    path = write(tmp_path / "log.csv", {rest: remainder, **without(trotted, "time")})
    assert '# missing: time = "..."\n# or, without a time: rate = 500' in proposal_for(a1, path)
    with pytest.raises(RecordingError, match=r"nothing for time: .*; --rate HERTZ stands in for a time"):
        read_log(path, a1)


def test_whole_seconds_without_their_remainder_are_named(a1, trotted, tmp_path):
    path = write(tmp_path / "log.csv", {**trotted, "time": np.floor(trotted["time"])})
    with pytest.raises(RecordingError, match=r"stamps do not increase, .* are they whole seconds, without"):
        read_log(path, a1)


def test_a_second_column_that_is_the_whole_time_is_named(a1, trotted, tmp_path):
    stamp = EPOCH * 10**9 + np.round(trotted["time"] * 1e9).astype(np.int64)
    columns = {"sec": stamp // 10**9, "nanosec": stamp, **without(trotted, "time")}
    path = write(tmp_path / "log.csv", columns)
    with pytest.raises(
        RecordingError, match=r"'nanosec' of the table .* reaches 1.7e\+09 s, .* write time = 'nanosec'"
    ):
        accepted(a1, path)


@pytest.mark.parametrize(
    ("name", "factor"), [("time_ms", 1e3), ("t [us]", 1e6), ("Time (seconds)", 1), ("timestamp_ns", 1e9)]
)
def test_the_unit_of_time_may_be_in_its_name(a1, trotted, expected, tmp_path, name, factor):
    path = write(tmp_path / "log.csv", {name: np.round(trotted["time"] * factor, 6), **without(trotted, "time")})
    assert_same(accepted(a1, path), expected)


# --- names of joints in cells


def messages(robot, trotted):
    """A JointState with an Imu's fields for each sample, its joints in another order than the model's."""
    names = in_order(robot, UNITREE)
    arrays = {
        theirs: np.column_stack([trotted[f"{ours}.{name}"] for name in names]).tolist()
        for ours, theirs in (("position", "position"), ("velocity", "velocity"), ("torque", "effort"))
    }
    vectors = {
        theirs: [
            dict(zip("xyz", map(float, row), strict=True))
            for row in zip(*(trotted[f"{ours}.{axis}"] for axis in "xyz"), strict=True)
        ]
        for ours, theirs in (("gyro", "angular_velocity"), ("accelerometer", "linear_acceleration"))
    }  # fmt: skip
    for at, time in enumerate(trotted["time"]):
        second, remainder = divmod(round(time * 1e9), 10**9)
        stamp = {"sec": EPOCH + second, "nanosec": remainder}
        of_sample = {name: values[at] for name, values in {**arrays, **vectors}.items()}
        yield {"header": {"stamp": stamp, "frame_id": ""}, "name": names, **of_sample}


def rostopic(path, robot, trotted, names=None, field="field.{}{}"):
    """Return a message as `rostopic echo -p` writes it."""
    names = names or in_order(robot, UNITREE)
    stamp = EPOCH * 10**9 + np.round(trotted["time"] * 1e9).astype(np.int64)
    columns = {"%time": stamp, "field.header.seq": np.arange(len(stamp)), "field.header.frame_id": [""] * len(stamp)}
    columns |= {field.format("name", at): [name] * len(stamp) for at, name in enumerate(names)}
    for ours, theirs in (("position", "position"), ("velocity", "velocity"), ("torque", "effort")):
        columns |= {
            field.format(theirs, at): trotted[f"{ours}.{name}"] for at, name in enumerate(in_order(robot, UNITREE))
        }
    columns |= {f"field.orientation_covariance{at}": np.zeros(len(stamp)) for at in range(9)}
    for ours, theirs in (("gyro", "angular_velocity"), ("accelerometer", "linear_acceleration")):
        columns |= {f"field.{theirs}_covariance{at}": np.zeros(len(stamp)) for at in range(9)}
        columns |= {f"field.{theirs}.{axis}": trotted[f"{ours}.{axis}"] for axis in "xyz"}
    return write(path, columns)


@pytest.mark.parametrize("field", ["field.{}{}", "{}_{}", "/joint_states/{}[{}]", "msg.{}.{}"])
def test_24_names_of_joints_in_cells_determine_the_order_of_joints(a1, trotted, expected, tmp_path, field):
    path = rostopic(tmp_path / "log.csv", a1, trotted, field=field)
    assert "by the names in the log's cells" in proposal_for(a1, path)
    assert_same(accepted(a1, path), expected)


def test_names_in_cells_may_be_those_of_another_driver(a1, trotted, expected, tmp_path):
    legs, places = {"FL": "lf", "FR": "rf", "RL": "lh", "RR": "rh"}, {"hip": "haa", "thigh": "hfe", "calf": "kfe"}
    words = [name.split("_") for name in in_order(a1, UNITREE)]
    path = rostopic(tmp_path / "log.csv", a1, trotted, [f"{legs[leg]}_{places[place]}" for leg, place, _ in words])
    assert_same(accepted(a1, path), expected)


def test_names_in_cells_that_are_not_legs_need_a_joint_map(a1, trotted, tmp_path):
    path = rostopic(tmp_path / "log.csv", a1, trotted, [f"m{at}" for at in "abcdefghijkl"])
    with pytest.raises(RecordingError, match=r"cannot be identified.*--joint-map"):
        accepted(a1, path)


def test_names_in_cells_that_change_are_refused(a1, trotted, tmp_path):
    path = rostopic(tmp_path / "log.csv", a1, trotted)
    lines = path.read_text().splitlines()
    lines[99] = lines[99].replace("FR_hip_joint", "arm")
    path.write_text("\n".join(lines))
    with pytest.raises(
        RecordingError, match=r"'field.name0' of the table .* names 'FR_hip_joint' in some rows and 'arm'"
    ):
        read_log(path, a1)


def test_columns_that_contradict_the_names_in_cells_are_refused_with_both(a1, trotted, tmp_path):
    path = rostopic(tmp_path / "log.csv", a1, trotted)
    columns = Columns.from_text(proposal_for(a1, path), "it")
    order = [f"position.{joint}" for joint in a1.joint_names]
    wrong = {ours: f"field.position{at}" for at, ours in enumerate(order)}
    with pytest.raises(
        RecordingError, match=r"'field.position3' of .* to FR_hip_joint, and the names .* to FL_hip_joint"
    ):
        read_log(path, a1, columns=columns.with_changes(Columns(wrong)))


def test_an_array_of_names_among_others_determines_the_order(a1, trotted, expected, tmp_path):
    names = in_order(a1, UNITREE)
    arrays = {
        theirs: np.column_stack([trotted[f"{ours}.{name}"] for name in names])
        for ours, theirs in (("position", "q"), ("velocity", "dq"), ("torque", "tau"))
    }
    imu = {s: np.column_stack([trotted[f"{s}.{axis}"] for axis in "xyz"]) for s in SENSORS}
    rows = len(trotted["time"])
    arrays["q"] = np.hstack([np.zeros((rows, 7)), arrays["q"]])
    np.savez(tmp_path / "log.npz", t=trotted["time"], joint_names=np.array(names), **arrays, **imu)
    assert_same(accepted(a1, tmp_path / "log.npz"), expected)


# --- signs and units


@pytest.mark.parametrize("torques", [True, False])
def test_26_an_accelerometer_that_points_down_is_named(a1, whole, tmp_path, torques):
    columns = {name: -column if name.startswith("acc") else column for name, column in whole.items()}
    kept = columns if torques else without(columns, "torque")
    with pytest.raises(EquipoiseError, match="the accelerometer has the wrong sign, or the IMU hangs upside down"):
        estimate_log(a1, read_log(write(tmp_path / "log.csv", kept), a1), BayesianMethod(mass=MASS))


DEGREES = 180 / np.pi


@pytest.mark.parametrize(
    ("gyro", "turning", "accelerometer", "acceleration"),
    [
        ("gyro_{} [rad/s]", 1, "acc_{} [m/s^2]", 1),
        ("Gyro {} (deg/s)", DEGREES, "Accel {} (g)", 1 / STANDARD_GRAVITY),
        ("gyro_{}_dps", DEGREES, "acc_{}_g", 1 / STANDARD_GRAVITY),
        ("gyro_{}, deg/s", DEGREES, "acc_{} {{m/s^2}}", 1),
        ("gyro_{}: rad/s", 1, "acc_{} in g", 1 / STANDARD_GRAVITY),
        ("w{} [°/s]", DEGREES, "a{} [m/s²]", 1),
        ("imu.angular_velocity.{} [rad s^-1]", 1, "imu.linear_acceleration.{} [mg]", 1000 / STANDARD_GRAVITY),
        ("Angular velocity {} (degrees/second)", DEGREES, "acceleration {} (m/s/s)", 1),
    ],
)
def test_27_columns_of_an_imu_may_have_units_in_their_names(
    a1, trotted, expected, tmp_path, gyro, turning, accelerometer, acceleration
):
    columns = without(trotted, *SENSORS)
    columns |= {gyro.format(axis): turning * trotted[f"gyro.{axis}"] for axis in "xyz"}
    columns |= {accelerometer.format(axis): acceleration * trotted[f"accelerometer.{axis}"] for axis in "xyz"}
    assert_same(accepted(a1, write(tmp_path / "log.csv", columns)), expected)


@pytest.mark.parametrize("form", ["{} {} [{}]", "{}_{} ({})", "{}_{}_{}"])
def test_columns_of_joints_may_have_units_in_their_names(a1, trotted, expected, tmp_path, form):
    columns = without(trotted, *QUANTITIES)
    for quantity, word, unit, factor in (
        ("position", "q", "deg", DEGREES), ("velocity", "dq", "rpm", 30 / np.pi), ("torque", "tau", "mNm", 1000)
    ):  # fmt: skip
        columns |= {form.format(word, name, unit): factor * trotted[f"{quantity}.{name}"] for name in a1.joint_names}
    assert_same(accepted(a1, write(tmp_path / "log.csv", columns)), expected)


def test_names_that_state_two_units_of_one_sensor_are_refused(a1, trotted, tmp_path):
    columns = without(trotted, "gyro")
    columns |= {
        f"gyro_{a} [{u}]": trotted[f"gyro.{a}"] for a, u in zip("xyz", ("rad/s", "deg/s", "rad/s"), strict=True)
    }
    with pytest.raises(RecordingError, match=r"names of the gyro columns state deg/s and rad/s"):
        read_log(write(tmp_path / "log.csv", columns), a1)


@pytest.mark.parametrize(
    "name",
    [
        "motor_{}_torque [A]", "state_estimate.effort[{}]", "estimator.tau[{}]", "ekf_effort_{}", "tau_ext_{}", "tau_ff[{}]",
        "torque_limit_{}", "odom_effort[{}]",
    ],
)  # fmt: skip
def test_currents_and_state_estimates_are_not_torques(a1, trotted, tmp_path, name):
    columns = without(trotted, "torque", "gyro") | {f"w{axis}": trotted[f"gyro.{axis}"] for axis in "xyz"}
    columns |= {name.format(at): trotted[f"torque.{joint}"] for at, joint in enumerate(a1.joint_names)}
    assert "torque" not in toml_table(proposal_for(a1, write(tmp_path / "log.csv", columns)))


def test_generalised_forces_of_a_floating_base_are_passed_over(a1, trotted, expected, tmp_path):
    columns = without(trotted, "torque") | {f"tau_est[{at}]": np.ones(len(trotted["time"])) for at in range(6)}
    columns |= {f"tau_est[{6 + at}]": trotted[f"torque.{joint}"] for at, joint in enumerate(a1.joint_names)}
    columns["gyro_x"] = columns.pop("gyro.x")
    assert_same(accepted(a1, write(tmp_path / "log.csv", columns)), expected)


# --- orders of joints, and arrays


@pytest.mark.parametrize(
    ("form", "torque", "motors"),
    [
        ("motorState[{}].{}", "tauEst", 12), ("motor_state_{}_{}", "tau_est", 12), ("motor_state[{}].{}", "tau_est", 20),
        ("lowstate.motor_state.{}.{}", "tau_est", 20), ("/lowstate/motorState{}/{}", "tauEst", 20),
    ],
)  # fmt: skip
def test_29_unitrees_motors_are_in_unitrees_order(a1, trotted, expected, tmp_path, form, torque, motors):
    columns = {"tick": np.round(1000 * trotted["time"])}
    for ours, theirs in (("position", "q"), ("velocity", "dq"), ("torque", torque)):
        for at in range(motors):
            column = trotted[f"{ours}.{in_order(a1, UNITREE)[at]}"] if at < 12 else np.zeros_like(trotted["time"])
            columns[form.format(at, theirs)] = column
    for ours, theirs in (("gyro", "gyroscope"), ("accelerometer", "accelerometer")):
        columns |= {f"imu.{theirs}[{at}]": trotted[f"{ours}.{axis}"] for at, axis in enumerate("xyz")}
    path = write(tmp_path / "log.csv", columns)
    assert "legs in the order FR FL RR RL" in proposal_for(a1, path)
    assert_same(accepted(a1, path), expected)


def test_an_order_of_legs_that_the_gyroscope_contradicts_is_refused_with_both(a1, whole, tmp_path):
    columns = without(whole, *QUANTITIES)
    for quantity, word in zip(QUANTITIES, ("q", "dq", "tau"), strict=True):
        columns |= {f"{word}[{at}]": whole[f"{quantity}.{name}"] for at, name in enumerate(in_order(a1, UNITREE))}
    path = write(tmp_path / "log.csv", columns)
    columns = Columns.from_text(proposal_for(a1, path), "it")
    with pytest.raises(
        RecordingError, match=r"in the order of legs FL FR RL RR; .* agrees .* in the order FR FL RR RL"
    ):
        estimate_log(a1, read_log(path, a1, columns=columns), BayesianMethod(mass=MASS))


def arrays_without_time(robot, trotted):
    """Arrays with a floating base before the joints, and one of the IMU."""
    time, zero = trotted["time"], np.zeros_like(trotted["time"])
    half_roll = 0.01 * np.sin(7 * time)
    base = [0.4 * time, 0.01 * np.sin(time), 0.3 + zero, half_roll, zero, zero, np.sqrt(1 - half_roll**2)]
    position, velocity, torque = ([trotted[f"{one}.{name}"] for name in robot.joint_names] for one in QUANTITIES)
    gyro, accelerometer = ([trotted[f"{one}.{axis}"] for axis in "xyz"] for one in SENSORS)
    moved = [0.4 + zero, 0.01 * np.cos(time), zero, *gyro]
    arrays = {"q": [*base, *position], "dq": [*moved, *velocity], "tau": torque, "imu": [*gyro, *accelerometer]}
    return {name: np.array(values) for name, values in arrays.items()}


def test_30_a_log_without_time_is_asked_for_it_and_the_base_is_not_taken_for_joints(a1, trotted, expected, tmp_path):
    np.savez(tmp_path / "log.npz", **arrays_without_time(a1, trotted))
    proposed = toml_table(proposal_for(a1, tmp_path / "log.npz"))
    assert "time" not in proposed
    assert [proposed["position"][name] for name in a1.joint_names] == [f"q[{at}]" for at in range(7, 19)]
    assert [proposed["velocity"][name] for name in a1.joint_names] == [f"dq[{at}]" for at in range(6, 18)]
    assert_same(accepted(a1, tmp_path / "log.npz", columns=Columns(rate=RATE)), expected)


@pytest.mark.parametrize("factor", [1, 1 / STANDARD_GRAVITY])
def test_six_columns_of_an_imu_may_begin_with_either_sensor(a1, trotted, expected, tmp_path, factor):
    """Gravity is in the accelerometer's columns: assigning them to the gyroscope is an error."""
    arrays, unit = arrays_without_time(a1, trotted), {} if factor == 1 else {"accelerometer": "g"}
    arrays["imu"][3:] *= factor
    np.savez(tmp_path / "log.npz", **arrays | {"imu": np.roll(arrays["imu"], 3, axis=0)})
    path, known = tmp_path / "log.npz", Columns(units=unit, rate=RATE)
    assert "an IMU's six columns, the accelerometer's first" in proposal_for(a1, path, columns=known)
    assert_same(accepted(a1, path, columns=known), expected)
    given = {
        f"{sensor}.{axis}": f"imu[{3 * k + at}]" for k, sensor in enumerate(SENSORS) for at, axis in enumerate("xyz")
    }
    columns = Columns.from_text(proposal_for(a1, path, columns=Columns(rate=RATE)), "it")
    with pytest.raises(RecordingError, match=r"imu\[0\], imu.* are read as the gyroscope, imu.*exchanged"):
        read_log(path, a1, columns=columns.with_changes(Columns(given)))


# --- kinds of files


def as_text(delimiter, head=""):
    def written(path, columns):
        write(path, columns, delimiter)
        path.write_text(head + path.read_text(encoding="utf-8"), encoding="utf-8")

    return written


def as_fixed_width(path, columns):
    """Return the text that `numpy.savetxt` writes, after other remarks."""
    table = np.column_stack([*columns.values()])
    np.savetxt(path, table, fmt="%12.6f", header=f"robot: a1, day: 3\n{' '.join(columns)}")


def as_json_lines(path, columns):
    rows = (dict(zip(columns, row, strict=True)) for row in zip(*map(np.ndarray.tolist, columns.values()), strict=True))
    path.write_text("\n".join(map(json.dumps, rows)), encoding="utf-8")


def as_arrays(path, columns):
    with path.open("wb") as file:
        np.savez(file, **columns)


FILES = {
    "log.csv": as_text(","), "log.tsv": as_text("\t"), "log.txt": as_text(" "), "commas.dat": as_text(",", "# from a robot\n"),
    "log.dat": as_fixed_width, "log.jsonl": as_json_lines, "log.ndjson": as_json_lines, "log.parquet": write_parquet,
    "log.npz": as_arrays,
}  # fmt: skip


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("compressed", [False, True])
def test_every_kind_of_file_is_read_compressed_or_not(a1, trotted, expected, tmp_path, name, compressed):
    path = tmp_path / name
    FILES[name](path, trotted)
    if compressed:
        path = Path(f"{path}.gz")
        path.write_bytes(gzip.compress((tmp_path / name).read_bytes()))
    assert_same(read_log(path, a1).recording, expected)


def test_columns_of_numbers_without_names_are_named_by_the_user(a1, trotted, expected, tmp_path):
    np.savetxt(tmp_path / "log.dat", np.column_stack([*trotted.values()]), fmt="%.6f")
    columns = Columns({ours: f"[{at}]" for at, ours in enumerate(trotted)})
    assert_same(read_log(tmp_path / "log.dat", a1, columns=columns).recording, expected)
    assert "[0] to [42]" in proposal_for(a1, tmp_path / "log.dat")


def test_messages_in_json_lines_are_read_by_the_names_in_them(a1, trotted, expected, tmp_path):
    lines = [json.dumps(message) for message in messages(a1, trotted)]
    (tmp_path / "log.jsonl").write_text("\n".join(lines), encoding="utf-8")
    assert_same(accepted(a1, tmp_path / "log.jsonl"), expected)
    (tmp_path / "cut.jsonl").write_text("\n".join(lines)[:-50], encoding="utf-8")
    with pytest.raises(RecordingError, match=rf"line {len(lines)} of .*cut.jsonl' is not JSON"):
        read_log(tmp_path / "cut.jsonl", a1)


@pytest.mark.parametrize("name", ["log.csv", "log.dat", "log.txt", "log.jsonl"])
@pytest.mark.parametrize("content", ["", "\n", "time,position.FL_hip_joint\n", "# time position.FL_hip_joint\n"])
def test_files_without_samples_are_named(a1, tmp_path, name, content):
    (tmp_path / name).write_text("" if name.endswith("jsonl") else content, encoding="utf-8")
    with pytest.raises(RecordingError, match=rf"{name}' holds no samples"):
        read_log(tmp_path / name, a1)


@pytest.mark.parametrize("name", ["log.csv.gz", "log.npz.gz", "log.jsonl.gz", "log.parquet", "log.mat"])
def test_damaged_files_are_named(a1, tmp_path, name):
    (tmp_path / name).write_bytes(b"\x1f\x8b no such file")
    with pytest.raises(
        RecordingError, match=rf"{name}' cannot be read: it is damaged, or not a .{name.split('.')[1]} file"
    ):
        read_log(tmp_path / name, a1)


def test_compressed_files_that_are_not_tables_are_refused(a1, tmp_path):
    (tmp_path / "bag.mcap.gz").write_bytes(gzip.compress(b""))
    with pytest.raises(RecordingError, match=r"is not a log that can be read: .*tables may be compressed, as .csv.gz"):
        read_log(tmp_path / "bag.mcap.gz", a1)


# --- several files, and a rate


def joints_and_imu(trotted, factor=1, imu_time="time"):
    """Two tables; the IMU has another rate."""
    imu = {imu_time: factor * trotted["time"], **{k: v for k, v in trotted.items() if k.split(".")[0] in SENSORS}}
    return without(trotted, *SENSORS), {name: column[1::2] for name, column in imu.items()}


@pytest.mark.parametrize(("imu_time", "factor"), [("time", 1), ("t", 1), ("stamp [ms]", 1e3), ("timestamp", 1e9)])
def test_joints_and_imu_in_two_files_are_joined_by_time(a1, trotted, expected, tmp_path, imu_time, factor):
    joints, imu = joints_and_imu({**trotted, "time": trotted["time"] + EPOCH}, factor, imu_time)
    path, other = write(tmp_path / "joints.csv", joints), write_parquet(tmp_path / "imu.parquet", imu)
    found = read_log(path, a1, tables=[other]).recording
    np.testing.assert_allclose(found.joints.position, expected.joints.position, atol=1e-6)
    np.testing.assert_allclose(found.imu.acceleration_in_imu, expected.imu.acceleration_in_imu[1::2], atol=1e-6)
    np.testing.assert_allclose(found.imu.time - found.joints.time[0], expected.joints.time[1::2], atol=2e-6)


def test_a_file_for_each_quantity_names_its_columns(a1, trotted, expected, tmp_path):
    """Torques have times of their own, between those of the positions."""
    paths = []
    for quantity in QUANTITIES:
        columns = {joint: trotted[f"{quantity}.{joint}"] for joint in a1.joint_names}
        late = 1e-3 if quantity == "torque" else 0
        paths.append(write(tmp_path / f"{quantity}.csv", {"time": trotted["time"] + late, **columns}))
    paths.append(write(tmp_path / "imu.csv", without(trotted, *QUANTITIES)))
    log = read_log(paths[0], a1, tables=paths[1:])
    np.testing.assert_array_equal(log.recording.joints.velocity, expected.joints.velocity[1:])
    torque = trotted[f"torque.{a1.joint_names[1]}"]
    np.testing.assert_allclose(log.recording.joints.torque[:, 1], (torque[1:] + torque[:-1]) / 2, atol=1e-6)
    assert any("torque has times of its own: it is interpolated" in one.message for one in log.findings)


def test_files_that_are_not_of_one_run_are_named(a1, trotted, tmp_path):
    joints, imu = joints_and_imu(trotted)
    path = write(tmp_path / "joints.csv", joints)
    later = write(tmp_path / "later.csv", {**imu, "time": imu["time"] + 100})
    with pytest.raises(RecordingError, match=r"IMU samples from .* they share 0.00 s. Are the stamps from one clock"):
        read_log(path, a1, tables=[later])
    timeless = write(tmp_path / "timeless.csv", without(imu, "time"))
    with pytest.raises(RecordingError, match=r"timeless.csv' has no time by which to join it.*time = .*or give --rate"):
        read_log(path, a1, tables=[timeless])
    with pytest.raises(RecordingError, match=r"there are 600 rows in .* and 300 rows in .*must have a row each"):
        read_log(write(tmp_path / "j.csv", without(joints, "time")), a1, tables=[timeless], columns=Columns(rate=RATE))
    (tmp_path / "log.mcap").touch()
    with pytest.raises(SettingsError, match=r"several files are for tables .*, and .*log.mcap' is not one"):
        read_log(path, a1, tables=[tmp_path / "log.mcap"])
    with pytest.raises(RecordingError, match=r"'gone.csv' does not exist"):
        read_log(path, a1, tables=[Path("gone.csv")])


def test_a_rate_stands_in_for_a_time_and_only_there(a1, trotted, expected, tmp_path):
    path = write(tmp_path / "log.csv", without(trotted, "time"))
    assert_same(read_log(path, a1, columns=Columns(rate=RATE)).recording, expected)
    stamped = write(tmp_path / "stamped.csv", {"stamp": trotted["time"], **without(trotted, "time")})
    with pytest.raises(SettingsError, match="the rate is given, and 'stamp' is called like a time: leave out"):
        read_log(stamped, a1, columns=Columns(rate=RATE))
    timed = write(tmp_path / "timed.csv", trotted)
    with pytest.raises(SettingsError, match=r"the rate is given, and 'time' is called .* --rate, or write time = ''"):
        read_log(timed, a1, columns=Columns(rate=RATE))
    assert_same(read_log(timed, a1, columns=Columns({"time": ""}, rate=RATE)).recording, expected)
    joints, imu = (without(one, "time") for one in (without(trotted, *SENSORS), without(trotted, *QUANTITIES)))
    paths = [write(tmp_path / "joints.csv", joints), write(tmp_path / "imu.csv", imu)]
    assert_same(read_log(paths[0], a1, tables=paths[1:], columns=Columns(rate=RATE)).recording, expected)


def test_a_rate_may_be_typed_where_there_is_no_time(a1, trotted, expected, tmp_path, monkeypatch, capsys):
    np.savez(tmp_path / "log.npz", **arrays_without_time(a1, trotted))
    with pytest.raises(RecordingError) as raised:
        read_log(tmp_path / "log.npz", a1)
    monkeypatch.setattr("sys.stdin", io.StringIO("\nrate = 0\nrate = 500\n\n\n"))
    assert_same(read_log(tmp_path / "log.npz", a1, columns=ask_columns(raised.value.report)).recording, expected)
    shown = capsys.readouterr().err
    assert "still missing: time" in shown
    assert "the rate must be above zero" in shown


def test_two_files_and_a_rate_from_the_command_line(a1, whole, tmp_path, capsys):
    timeless = without(whole, "time")
    paths = [
        str(write(tmp_path / "joints.csv", without(timeless, *SENSORS))),
        str(write(tmp_path / "imu.csv", without(timeless, *QUANTITIES))),
    ]
    arguments = ["estimate", *paths, "--robot", "unitree_a1", "--mass", "13.6", "--json", "--no-report"]
    assert main([*arguments, "--rate", "0"]) == 2
    assert "the rate must be above zero, in samples per second, not 0" in capsys.readouterr().out
    assert main([*arguments, "--rate", "500"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["composite"]["mass"] == pytest.approx(13.6, abs=0.1)
    assert "4000 rows" in found["provenance"]["format"]
