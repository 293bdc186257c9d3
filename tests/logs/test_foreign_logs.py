"""External logs: bags of both storages, LowState, tables, and the errors of damaged ones."""

import re
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from foreign_logs import (
    EPOCH,
    LEGGED_OF_OLD,
    Bag,
    columns_of,
    every,
    nanoseconds,
    shifted,
    store,
    write_bag,
    write_csv,
    write_parquet,
)
from hypothesis import given
from hypothesis import strategies as st
from rosbags.rosbag1 import Writer as Ros1Writer

from equipoise.errors import EquipoiseError, RecordingError
from equipoise.logs.cdr_arrays import read_messages
from equipoise.logs.message_types import known_types
from equipoise.logs.raw_log import RawImu, RawJoints, RawLog, assemble
from equipoise.logs.reader import is_log, read_log
from equipoise.logs.tables.column_names import Columns
from equipoise.logs.topics import Topics
from equipoise.recording.recording import CommandStream, ImuStream, JointStream, Recording

RATE, COUNT = 200, 500
TYPES = store()


@pytest.fixture(scope="module")
def log(a1):
    """Two and a half seconds of arbitrary numbers."""
    generator, time = np.random.default_rng(1), 3.0 + np.arange(COUNT) / RATE
    middle = (np.maximum(a1.lower_limit, -2) + np.minimum(a1.upper_limit, 2)) / 2
    joints = JointStream(time, *(middle * (k == 0) + 0.1 * generator.standard_normal((COUNT, 12)) for k in range(3)))
    imu = ImuStream(time, generator.standard_normal((COUNT, 3)), generator.standard_normal((COUNT, 3)) + [0, 0, 9.81])
    return Recording(a1.joint_names, joints, imu, CommandStream(time, joints.position + 0.01))


def same(read, log, digits=12):
    """Assert that a log that was read equals the one written; its time begins at zero."""
    start = min(log.joints.time[0], log.imu.time[0])
    for mine, theirs in ((read.joints, log.joints), (read.imu, log.imu)):
        np.testing.assert_allclose(mine.time, theirs.time - start, atol=1e-9)
        for name in vars(theirs):
            if name not in ("time", "pose_noise"):
                np.testing.assert_allclose(getattr(mine, name), getattr(theirs, name), rtol=0, atol=10.0**-digits)


def messages_of(findings):
    return " ".join(finding.message for finding in findings)


# --- bags


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_bag_is_read_bit_by_bit_whatever_its_storage(a1, log, tmp_path, storage):
    path = write_bag(tmp_path / "bag", log, storage)
    (file,) = [file for file in path.iterdir() if file.suffix in (".mcap", ".db3")]
    for where in (path, file):
        assert is_log(where)
        read = read_log(where, a1)
        same(read.recording, log)
        assert read.about["joints"] == "/joint_states (sensor_msgs/msg/JointState)"
        assert read.about["stamps"] == "the messages' own stamps"
        assert read.about["rates"] == "joints 200 Hz, IMU 200 Hz"
        assert read.findings == ()


@pytest.mark.parametrize("compression", [None, "LZ4", "BZ2"])
def test_a_bag_of_ros_1_is_read_as_one_of_ros_2(a1, log, tmp_path, compression, monkeypatch):
    if compression:
        open_writer = Ros1Writer.open

        def opened(writer):
            writer.set_compression(Ros1Writer.CompressionFormat[compression])
            open_writer(writer)

        monkeypatch.setattr(Ros1Writer, "open", opened)
    path = write_bag(tmp_path / "bag", log, "ros1")
    assert path.suffix == ".bag"
    assert is_log(path)
    read = read_log(path, a1)
    same(read.recording, log)
    assert read.about["joints"] == "/joint_states (sensor_msgs/msg/JointState)"
    assert read.about["stamps"] == "the messages' own stamps"
    with pytest.raises(RecordingError, match="--imu-topic /wind is not in the bag"):
        read_log(path, a1, Topics(imu="/wind"))


def test_a_bag_whose_recorder_was_killed_has_no_metadata(a1, log, tmp_path):
    path = write_bag(tmp_path / "bag", log, "sqlite3")
    (path / "metadata.yaml").unlink()
    same(read_log(path, a1).recording, log)


def test_a_killed_recorders_parts_need_not_all_have_every_topic(a1, log, tmp_path):
    """The first one ends before the IMU's driver is up."""
    middle = float(log.joints.time[len(log.joints.time) // 2])
    first, rest = log.between(-np.inf, middle), log.between(middle, np.inf)
    one = Bag(tmp_path / "one").joints("/joint_states", a1.joint_names, first.joints).write()
    other = (
        Bag(tmp_path / "other").joints("/joint_states", a1.joint_names, rest.joints).imu("/imu/data", rest.imu).write()
    )
    parts = tmp_path / "parts"
    parts.mkdir()
    for name, bag in (("part_0.mcap", one), ("part_1.mcap", other)):
        next(bag.glob("*.mcap")).rename(parts / name)
    read = read_log(parts, a1).recording
    assert len(read.joints.time) == len(log.joints.time)
    np.testing.assert_allclose(read.imu.angular_velocity_in_imu, rest.imu.angular_velocity_in_imu)


def test_messages_may_name_joints_in_any_order_and_others_in_between(a1, log, tmp_path):
    """Joints permuted, of legs and arm in turn; as several publishers on one topic do."""
    order = np.random.default_rng(0).permutation(12)
    names = [a1.joint_names[k] for k in order]
    joints = JointStream(
        log.joints.time, *(getattr(log.joints, q)[:, order] for q in ("position", "velocity", "torque"))
    )
    bag = Bag(tmp_path / "bag").joints("/joint_states", names, every(joints, 2)).imu("/imu/data", log.imu)
    bag.joints("/joint_states", a1.joint_names, every(log.joints, 2, 1))
    arm = JointStream(log.joints.time[::10] + 1e-4, np.ones((50, 2)))
    bag.joints("/joint_states", ["arm_0", "arm_1"], arm)
    read = read_log(bag.write(), a1)
    same(read.recording, log)
    assert read.joint_map.ignored == ("arm_0", "arm_1")
    assert "50 samples are of other joints" in messages_of(read.findings)


def test_legs_that_come_one_by_one_are_refused(a1, log, tmp_path):
    bag = Bag(tmp_path / "bag").imu("/imu/data", log.imu)
    for part in (slice(0, 6), slice(6, 12)):
        bag.joints("/joint_states", a1.joint_names[part], JointStream(log.joints.time, log.joints.position[:, part]))
    with pytest.raises(RecordingError, match="hold only some of the legs' joints"):
        read_log(bag.write(), a1)


def test_commands_are_found_next_to_the_states(a1, log, tmp_path):
    """They are read at 100 Hz: every second one."""
    bag = Bag(tmp_path / "bag").joints("/joint_states", a1.joint_names, log.joints).imu("/imu/data", log.imu)
    bag.joints("/joint_commands", a1.joint_names, JointStream(log.joints.time, log.commands.position))
    read = read_log(bag.write(), a1)
    np.testing.assert_array_equal(read.recording.commands.position, log.commands.position[1::2])
    assert read.about["commands"].startswith("/joint_commands")


def test_several_topics_are_an_error_that_names_them_and_the_flag(a1, log, tmp_path):
    bag = Bag(tmp_path / "bag").joints("/left/states", a1.joint_names, log.joints).imu("/imu/data", log.imu)
    bag.joints("/right/states", a1.joint_names, log.joints).imu("/camera/imu", log.imu)
    path = bag.write()
    with pytest.raises(
        RecordingError, match=r"joint states: /left/states, /right/states. Choose one with --joint-topic"
    ):
        read_log(path, a1)
    read = read_log(path, a1, Topics(joints="/right/states"))
    assert read.about["joints"].startswith("/right/states")
    assert "/imu/data is used for IMU samples, not /camera/imu" in messages_of(read.findings)
    assert read_log(path, a1, Topics("left/states", "/camera/imu")).about["IMU"].startswith("/camera/imu")
    with pytest.raises(RecordingError, match=r"--imu-topic /wind is not in the bag.*The bag has /camera/imu"):
        read_log(path, a1, Topics("/left/states", "/wind"))
    with pytest.raises(RecordingError, match="--joint-topic /imu/data is a sensor_msgs/msg/Imu"):
        read_log(path, a1, Topics("/imu/data"))


def test_a_bag_without_an_imu_lists_its_topics(a1, log, tmp_path):
    path = Bag(tmp_path / "bag").joints("/joint_states", a1.joint_names, log.joints).write()
    with pytest.raises(RecordingError, match=r"holds no IMU samples: it needs .* It has /joint_states"):
        read_log(path, a1)


def test_a_folder_and_a_file_that_are_not_logs(a1, tmp_path):
    with pytest.raises(RecordingError, match="is not a log that can be read"):
        read_log(tmp_path, a1)
    with pytest.raises(RecordingError, match="does not exist"):
        read_log(tmp_path / "none.mcap", a1)
    for run in ("run1.bag", "run2.bag"):  # logs of their own, and not parts of one
        (tmp_path / run).touch()
    with pytest.raises(RecordingError, match=r"is not a log that can be read: .* or a file .mcap, .db3, .bag"):
        read_log(tmp_path, a1)
    (tmp_path / "text.doc").write_text("hello")
    with pytest.raises(
        RecordingError,
        match=r"the folder of a rosbag2 bag, or a file .mcap, .db3, .bag, .csv, .*.jsonl, .*.parquet, .npz, .npy, .mat",
    ):
        read_log(tmp_path / "text.doc", a1)


def test_the_error_of_a_truncated_file_names_the_repair(a1, log, tmp_path):
    path = write_bag(tmp_path / "bag", log)
    file = path / "bag.mcap"
    file.write_bytes(file.read_bytes()[:-500])
    with pytest.raises(RecordingError, match=r"cannot be read: File end magic is invalid.*mcap recover"):
        read_log(path, a1)


@pytest.mark.parametrize("storage", ["mcap", "ros1"])
def test_an_imu_without_a_gyroscope_turns_as_its_orientation(a1, log, tmp_path, storage):
    """To its left by half a radian a second; unless the message states that it has no orientation."""
    angle, zero = 0.25 * log.imu.time, np.zeros(COUNT)
    turning = np.column_stack([np.cos(angle), zero, zero, np.sin(angle)])
    imu = replace(log.imu, angular_velocity_in_imu=np.zeros((COUNT, 3)))
    known, unknown = (
        Bag(tmp_path / f"bag_{oriented}", storage)
        .joints("/joint_states", a1.joint_names, log.joints)
        .imu("/imu/data", imu, quat_wxyz=turning, known=oriented)
        .write()
        for oriented in (True, False)
    )
    read = read_log(known, a1)
    np.testing.assert_allclose(read.recording.imu.angular_velocity_in_imu, [[0, 0, 0.5]] * COUNT, atol=1e-9)
    assert "derived from the fused orientation" in messages_of(read.findings)
    with pytest.raises(
        RecordingError, match="has no gyroscope, and its orientation is valid in 0 samples: log the raw gyroscope"
    ):
        read_log(unknown, a1)


# --- stamps


def test_stamps_of_zero_give_way_to_receive_times(a1, log, tmp_path):
    received = nanoseconds(log.joints.time)
    bag = Bag(tmp_path / "bag").joints("/joint_states", a1.joint_names, log.joints, received, stamps=[0] * COUNT)
    read = read_log(bag.imu("/imu/data", log.imu).write(), a1)
    same(read.recording, log)
    assert read.about["stamps"] == "receive times"
    assert "/joint_states: its stamps are zero: receive times are used" in messages_of(read.findings)


def test_stamps_of_different_clocks_give_way_to_receive_times(a1, log, tmp_path):
    """A robot whose computer has its clock in 1970."""
    received = nanoseconds(log.imu.time)
    early = [stamp - EPOCH + 10**9 for stamp in received]
    bag = Bag(tmp_path / "bag").joints("/joint_states", a1.joint_names, log.joints)
    read = read_log(bag.imu("/imu/data", log.imu, received, stamps=early).write(), a1)
    same(read.recording, log)
    assert "from different clocks" in messages_of(read.findings)


def test_streams_that_do_not_overlap_are_an_error_with_both_spans(a1, log, tmp_path):
    path = write_bag(tmp_path / "bag", replace(log, imu=shifted(log.imu, 60.0)))
    with pytest.raises(
        RecordingError, match=r"from 0.00 to 2.5\d s, IMU samples from 60.00 to 62.\d+ s: they share 0.00 s"
    ):
        read_log(path, a1)


def test_streams_of_other_rates_and_starts_keep_their_own_times(a1, log, tmp_path):
    other = replace(log, joints=every(log.joints, 4), imu=every(log.imu, 2, 40))
    read = read_log(write_bag(tmp_path / "bag", other), a1)
    same(read.recording, other)
    assert read.recording.imu.time[0] == pytest.approx(0.2)
    assert read.about["rates"] == "joints 50 Hz, IMU 100 Hz"


# --- LowState


def test_low_states_are_read_by_motor_order_on_the_robots_own_clock(a1, log, tmp_path):
    """Received with jitter, stamped by a tick: the tick makes the times even."""
    delay = np.random.default_rng(2).exponential(2e-3, COUNT)
    received = nanoseconds(np.maximum.accumulate(log.joints.time + delay))
    read = read_log(Bag(tmp_path / "bag").low_states(a1, log, received).write(), a1)
    assert read.about["stamps"] == "receive times, smoothed by the robot's tick"
    assert {match.how for match in read.joint_map.matches} == {"motor order"}
    np.testing.assert_allclose(np.diff(read.recording.joints.time), 1 / RATE, rtol=1e-2)
    np.testing.assert_allclose(read.recording.joints.position, log.joints.position, atol=1e-6)
    np.testing.assert_allclose(read.recording.joints.torque, log.joints.torque, atol=1e-6)
    np.testing.assert_allclose(read.recording.imu.acceleration_in_imu, log.imu.acceleration_in_imu, atol=1e-5)


def test_low_states_without_a_tick_are_at_their_receive_times(a1, log, tmp_path):
    read = read_log(Bag(tmp_path / "bag", "sqlite3").low_states(a1, log, ticks=False).write(), a1)
    same(read.recording, log, digits=5)
    assert read.about["stamps"] == "receive times"


def test_low_states_come_first_and_the_slow_copy_last(a1, log, tmp_path):
    bag = Bag(tmp_path / "bag").low_states(a1, log)
    slow = replace(log, joints=every(log.joints, 10), imu=every(log.imu, 10))
    bag.low_states(a1, slow, topic="/lf/lowstate").joints("/joint_states", a1.joint_names, log.joints)
    read = read_log(bag.write(), a1)
    assert read.about["joints"] == "/lowstate (unitree_go/msg/LowState)"
    assert "not /lf/lowstate: it has by far the most messages" in messages_of(read.findings)


@pytest.mark.parametrize(
    ("kind", "clock"),
    [("LowState", "receive times, smoothed by the robot's tick"), ("HighState", "the messages' own stamps")],
)
def test_states_of_older_robots_are_read_by_the_definitions_in_their_bags(a1, log, tmp_path, kind, clock):
    read = read_log(Bag(tmp_path / "bag", "ros1").legged_states(a1, log, kind).write(), a1)
    assert read.about["joints"] == f"/{kind.lower()} (unitree_legged_msgs/msg/{kind})"
    assert read.about["stamps"] == clock
    assert {match.how for match in read.joint_map.matches} == {"motor order"}
    np.testing.assert_allclose(np.diff(read.recording.joints.time), 1 / RATE, rtol=1e-2)
    np.testing.assert_allclose(read.recording.joints.torque, log.joints.torque, atol=1e-6)
    np.testing.assert_allclose(read.recording.imu.acceleration_in_imu, log.imu.acceleration_in_imu, atol=1e-5)


def test_states_without_motors_are_refused(a1, log, tmp_path):
    """The state of an A1 that walks by its own controller has no motors."""
    path = Bag(tmp_path / "bag", "ros1").legged_states(a1, log, "HighState", LEGGED_OF_OLD).write()
    with pytest.raises(RecordingError, match="HighState messages of /highstate hold no motors"):
        read_log(path, a1)


@pytest.mark.parametrize("written", ["low_states", "legged_states"])
def test_foot_forces_of_states_are_read_in_the_order_of_the_legs(a1, log, tmp_path, written):
    of_motors = np.column_stack([1000 * leg + np.arange(COUNT) for leg in range(4)])
    bag = Bag(tmp_path / "bag", "mcap" if written == "low_states" else "ros1")
    forces = read_log(getattr(bag, written)(a1, log, foot_force=of_motors).write(), a1).foot_forces
    np.testing.assert_array_equal(forces.load, of_motors[:, [1, 0, 3, 2]])  # FR FL RR RL
    np.testing.assert_allclose(np.diff(forces.time), 1 / RATE, rtol=1e-2)
    silent = Bag(tmp_path / "silent", "mcap" if written == "low_states" else "ros1")
    assert read_log(getattr(silent, written)(a1, log).write(), a1).foot_forces is None


def test_low_states_of_a_robot_with_other_legs_are_refused(two_jointed, a1, log, tmp_path):
    path = Bag(tmp_path / "bag").low_states(a1, log).write()
    with pytest.raises(RecordingError, match="three motors a leg"):
        read_log(path, two_jointed)


# --- many messages at once


@given(
    frames=st.lists(st.sampled_from(["", "base", "imu_link"]), min_size=1, max_size=5),
    sizes=st.lists(st.tuples(*[st.integers(0, 4)] * 4), min_size=1, max_size=6),
    seed=st.integers(0, 99),
)
def test_messages_are_what_rosbags_reads_one_by_one(frames, sizes, seed):
    types, kind, generator = TYPES, "sensor_msgs/msg/JointState", np.random.default_rng(seed)
    written = [
        types.types[kind](
            header=types.types["std_msgs/msg/Header"](
                stamp=types.types["builtin_interfaces/msg/Time"](sec=index, nanosec=7),
                frame_id=frames[index % len(frames)],
            ),
            name=["a", "leg_joint", "", "knee"][: size[0]],
            **{
                name: generator.standard_normal(count)
                for name, count in zip(("position", "velocity", "effort"), size[1:], strict=True)
            },
        )
        for index, size in enumerate(sizes)
    ]
    bodies = [bytes(types.serialize_cdr(message, kind)) for message in written]
    seen = []
    for group in read_messages(known_types(), kind, bodies):
        for k, row in enumerate(group.rows):
            seen.append(row)
            expected = written[row]
            assert group.numbers["header.stamp.sec"][k] == expected.header.stamp.sec
            assert group.texts["header.frame_id"] == expected.header.frame_id
            assert [group.texts[f"name.{j}"] for j in range(len(expected.name))] == expected.name
            for name in ("position", "velocity", "effort"):
                np.testing.assert_array_equal(group.numbers[name][k], getattr(expected, name))
    assert sorted(seen) == list(range(len(written)))


# --- tables


def test_tables_are_read_bit_by_bit(a1, log, tmp_path):
    columns = columns_of(log)
    for path in (write_csv(tmp_path / "log.csv", columns), write_parquet(tmp_path / "log.parquet", columns)):
        same(read_log(path, a1).recording, log)


def test_rows_may_leave_cells_empty(a1, log, tmp_path):
    other = replace(log, joints=every(log.joints, 3), imu=every(log.imu, 2))
    columns = columns_of(other)
    assert np.isnan(columns["gyro.x"]).any()
    assert np.isnan(columns[f"position.{a1.joint_names[0]}"]).any()
    for path in (write_csv(tmp_path / "log.csv", columns), write_parquet(tmp_path / "log.parquet", columns)):
        same(read_log(path, a1).recording, other)


def test_foot_forces_of_a_table_may_have_gaps(a1, log, tmp_path):
    columns = columns_of(log)
    forces = {f"foot_force.{leg}": leg_number + np.arange(COUNT) % 7.0 for leg_number, leg in enumerate(a1.legs)}
    forces["foot_force.RL"] = np.where(np.arange(COUNT) % 3, forces["foot_force.RL"], np.nan)
    read = read_log(write_csv(tmp_path / "log.csv", {**columns, **forces}), a1)
    known = np.arange(COUNT) % 3 > 0
    np.testing.assert_array_equal(read.foot_forces.load, np.column_stack([*forces.values()])[known])
    np.testing.assert_allclose(read.foot_forces.time, read.recording.joints.time[known], atol=1e-9)
    same(read.recording, log)
    assert read_log(write_csv(tmp_path / "none.csv", columns), a1).foot_forces is None


def test_parquets_own_time_stamps_are_whole_numbers_until_the_first_is_taken_off(a1, log, tmp_path):
    columns = columns_of(log)
    stamps = pa.array(nanoseconds(columns["time"]), pa.timestamp("ns"))
    table = pa.table({name: stamps if name == "time" else values for name, values in columns.items()})
    pq.write_table(table, tmp_path / "log.parquet")
    same(read_log(tmp_path / "log.parquet", a1).recording, log)


def test_whole_nanoseconds_of_parquet_may_leave_cells_empty(a1, log, tmp_path):
    columns = columns_of(log)
    stamps = pa.array([*nanoseconds(columns["time"])[:-1], None], pa.int64())
    table = pa.table({name: stamps if name == "time" else values for name, values in columns.items()})
    pq.write_table(table, tmp_path / "log.parquet")
    read = read_log(tmp_path / "log.parquet", a1, columns=Columns(units={"time": "ns"}))
    np.testing.assert_allclose(read.recording.joints.time, (log.joints.time - log.joints.time[0])[:-1], atol=1e-6)


def test_a_column_that_is_missing_is_named_and_proposed(a1, log, tmp_path):
    columns = columns_of(log)
    columns["gyro_x"] = columns.pop("gyro.x")
    path = write_csv(tmp_path / "log.csv", columns)
    with pytest.raises(RecordingError, match=r"has no gyro.x\. The names of") as raised:
        read_log(path, a1)
    assert raised.value.report.text == '# gyro: by name; is the unit rad/s?\ngyro.x = "gyro_x"\n'
    only = {name: values for name, values in columns.items() if not name.startswith("position")}
    with pytest.raises(RecordingError, match=r"has no gyro.x, position.JOINT.*but nothing for position.JOINT"):
        read_log(write_csv(tmp_path / "log.csv", only), a1)


def test_time_in_another_unit_is_named(a1, log, tmp_path):
    columns = columns_of(log)
    for factor, unit in ((1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds")):
        path = write_csv(tmp_path / "log.csv", {**columns, "time": columns["time"] * factor})
        with pytest.raises(RecordingError, match=f"must be in seconds \\(are they {unit}") as raised:
            read_log(path, a1)
        remedy = re.search('units.time = ".s"', str(raised.value))[0]
        same(read_log(path, a1, columns=Columns.from_text(remedy, "the remedy")).recording, log, digits=9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text.replace("\n", ",\n", 1), "line 2 of .* has 43 cells; its first line names 44"),
        (lambda text: text.replace("\n3.005", "\n3.005 s", 1), r"'3.005 s' in column 'time', line 3"),
        (lambda text: text.replace("gyro.y", "gyro.x"), "has the column 'gyro.x' twice"),
        (lambda text: text.split("\n", 1)[0], "holds no samples"),
        (lambda text: "", "holds no samples"),
        (lambda text: "\x00" + text, "has no time|cannot be read: it is damaged"),
    ],
)
def test_a_csv_file_with_a_mistake(a1, log, tmp_path, change, message):
    path = write_csv(tmp_path / "log.csv", columns_of(log))
    text = path.read_text()
    path.write_text(change(text))
    with pytest.raises(RecordingError, match=message):
        read_log(path, a1)


def test_semicolons_and_a_byte_order_mark_are_accepted(a1, log, tmp_path):
    path = write_csv(tmp_path / "log.csv", columns_of(log))
    path.write_text("\ufeff" + path.read_text().replace(",", ";"), encoding="utf-8")
    same(read_log(path, a1).recording, log)


def test_a_file_that_is_not_parquet(a1, tmp_path):
    (tmp_path / "log.parquet").write_text("time,position.FL_hip_joint\n")
    with pytest.raises(RecordingError, match=r"cannot be read: it is damaged, or not a .parquet file"):
        read_log(tmp_path / "log.parquet", a1)


# --- samples


def raw(log, **changes):
    """A raw log; changes are (index, value) of a stream's array, by its name."""
    joints, imu = log.joints, log.imu
    return RawLog(
        RawJoints(joints.time, log.joint_names, joints.position, joints.velocity, joints.torque),
        RawImu(imu.time, imu.angular_velocity_in_imu, imu.acceleration_in_imu),
        **changes,
    )


def test_a_span_is_counted_from_the_first_sample(a1, log):
    found = assemble(a1, raw(log), span=(0.5, 2.0)).recording
    assert found.joints.time[0] == pytest.approx(0.5)
    assert found.joints.time[-1] == pytest.approx(2.0)
    with pytest.raises(RecordingError, match="no joint sample within the requested time"):
        assemble(a1, raw(log), span=(100.0, None))


def test_stamps_that_repeat_or_go_back_are_dropped_and_many_refused(a1, log):
    time = np.array(log.joints.time)
    time[100], time[200] = time[99], time[150]
    found = assemble(a1, raw(replace_time(log, time)))
    assert found.recording.joints.time.size == COUNT - 2
    assert "2 of 500 joint samples have stamps that repeat or go back" in messages_of(found.findings)
    time[300:] -= 1.0
    with pytest.raises(RecordingError, match=r"joint stamps do not increase, from sample \d+ on.*several logs in one"):
        assemble(a1, raw(replace_time(log, time)))


def replace_time(log, time):
    """A log that no `Recording` may be, as files have them."""
    joints = RawJoints(time, log.joint_names, log.joints.position, log.joints.velocity, log.joints.torque)
    return type("Log", (), {"joints": joints, "imu": log.imu, "joint_names": log.joint_names})


def test_samples_that_are_not_numbers_are_dropped_and_many_refused(a1, log):
    position = np.array(log.joints.position)
    position[10, 3] = np.nan
    joints = RawJoints(log.joints.time, log.joint_names, position, log.joints.velocity, log.joints.torque)
    found = assemble(a1, replace(raw(log), joints=joints))
    assert found.recording.joints.time.size == COUNT - 1
    assert "1 of 500 joint samples are not numbers" in messages_of(found.findings)
    rates = np.array(log.imu.angular_velocity_in_imu)
    rates[:100] = np.inf
    with pytest.raises(RecordingError, match="20% of the IMU samples are not numbers, the first at sample 0"):
        assemble(a1, replace(raw(log), imu=RawImu(log.imu.time, rates, log.imu.acceleration_in_imu)))


def test_unmeasured_velocities_and_torques_are_none(a1, log):
    joints = RawJoints(
        log.joints.time, log.joint_names, log.joints.position, np.full((COUNT, 12), np.nan), np.zeros((COUNT, 12))
    )
    found = assemble(a1, replace(raw(log), joints=joints))
    assert found.recording.joints.velocity is None
    assert found.recording.joints.torque is None
    messages = messages_of(found.findings)
    assert "joint velocities are not numbers in 100% of the samples: not used" in messages
    assert "joint torques are zero throughout: treated as not measured" in messages


def test_an_imu_that_was_written_faster_than_read_loses_its_repetitions(a1, log):
    held = np.repeat(np.arange(0, COUNT, 4), 4)[:COUNT]
    imu = RawImu(log.imu.time, log.imu.angular_velocity_in_imu[held], log.imu.acceleration_in_imu[held])
    found = assemble(a1, replace(raw(log), imu=imu))
    np.testing.assert_array_equal(found.recording.imu.angular_velocity_in_imu, log.imu.angular_velocity_in_imu[::4])
    assert "75% of the IMU samples repeat the last one" in messages_of(found.findings)


def test_samples_that_are_too_slow_are_refused(a1, log):
    joints = every(log.joints, 20)
    slow = RawJoints(joints.time, log.joint_names, joints.position, joints.velocity, joints.torque)
    with pytest.raises(RecordingError, match="joint samples come at 10 Hz"):
        assemble(a1, replace(raw(log), joints=slow))


def test_commands_that_do_not_fit_are_left_out_and_noted(a1, log):
    other = RawJoints(log.joints.time, tuple(f"c{k}" for k in range(12)), log.commands.position)
    found = assemble(a1, raw(log, commands=other))
    assert found.recording.commands is None
    assert "they name other joints than the joint states" in messages_of(found.findings)


# --- damage


@pytest.mark.parametrize("kind", ["mcap", "db3", "bag", "csv", "parquet"])
def test_damaged_files_raise_equipoise_errors(a1, log, tmp_path, kind):
    """With a few bytes changed or lost, a file is read or raises an error."""
    short = replace(log, joints=every(log.joints, 2), imu=every(log.imu, 2))
    if kind == "bag":
        path = write_bag(tmp_path / "bag", short, "ros1")
    elif kind in ("mcap", "db3"):
        path = write_bag(tmp_path / "bag", short, {"mcap": "mcap", "db3": "sqlite3"}[kind]) / f"bag.{kind}"
    else:
        write = {"csv": write_csv, "parquet": write_parquet}[kind]
        path = write(tmp_path / f"log.{kind}", columns_of(short))
    whole, generator = path.read_bytes(), np.random.default_rng(5)
    refused = 0
    for _ in range(60):
        data = bytearray(whole)
        for place in generator.integers(0, len(data), generator.integers(1, 6)):
            data[place] = generator.integers(0, 256)
        if generator.random() < 0.3:
            del data[generator.integers(0, len(data)) :]
        path.write_bytes(data)
        try:
            read_log(path, a1)
        except EquipoiseError:
            refused += 1
    assert refused > 5
