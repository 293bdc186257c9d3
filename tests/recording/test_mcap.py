"""The file on disk: read by other programs; truncated, damaged and foreign files."""

import contextlib
import json
import os
import pickle
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from logs import bits, kill, piece, write_run
from mcap.reader import make_reader
from mcap.writer import Writer
from rosbags.highlevel import AnyReader

import equipoise
from equipoise.errors import OutputError, RecordingError
from equipoise.recording.messages import DEFINITIONS, IMU, JOINT_STATE, STRING
from equipoise.recording.recording import Event
from equipoise.recording.rosbag2 import write_metadata
from equipoise.recording.run_log import RunLog, resume_log
from equipoise.recording.run_log_reader import log_files, read_log

TYPES = {
    "/joint_states": JOINT_STATE, "/imu/data": IMU, "/joint_commands": JOINT_STATE, "/events": STRING, "/run_log": STRING,
}  # fmt: skip


@pytest.fixture
def path(tmp_path):
    return tmp_path / "recording.mcap"


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A run of three trials: its bytes, and the trials."""
    path = tmp_path_factory.mktemp("written") / "recording.mcap"
    kept = write_run(path)
    return path.read_bytes(), kept


# --- other programs


def test_the_mcap_library_reads_it(path):
    write_run(path)
    with open(path, "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        header, summary = reader.get_header(), reader.get_summary()
        assert header.profile == "ros2"
        assert header.library == f"equipoise {equipoise.__version__}"
        assert {
            channel.topic: summary.schemas[channel.schema_id].name for channel in summary.channels.values()
        } == TYPES
        for schema in summary.schemas.values():
            assert (schema.encoding, schema.data.decode()) == ("ros2msg", DEFINITIONS[schema.name])
        messages = list(reader.iter_messages())
        imu = list(reader.iter_messages(topics=["/imu/data"]))
    assert summary.statistics.message_count == len(messages) == sum(summary.statistics.channel_message_counts.values())
    assert summary.statistics.chunk_count == len(summary.chunk_indexes)
    times = [message.log_time for _, _, message in messages]
    assert times == sorted(times)
    assert summary.statistics.message_end_time == times[-1]
    assert [message.log_time for _, _, message in imu] == sorted(message.log_time for _, _, message in imu)
    assert len(imu) == 140


def test_rosbags_reads_a_folder_with_metadata_as_a_bag(path):
    with RunLog(path) as log:
        log.keep(piece(5.0))
    write_metadata(path.parent, [path])
    with AnyReader([path.parent]) as bag:
        assert {connection.topic: connection.msgtype for connection in bag.connections} == TYPES
        assert bag.start_time == 5 * 10**9
        assert bag.duration == pytest.approx(0.093e9, abs=2)
        states = [c for c in bag.connections if c.topic == "/joint_states"]
        read = [bag.deserialize(raw, c.msgtype) for c, _, raw in bag.messages(states)]
    assert np.array_equal([message.position for message in read], piece(5.0).joints.position)
    assert np.array_equal([message.velocity for message in read], piece(5.0).joints.velocity)
    assert np.array_equal([message.effort for message in read], piece(5.0).joints.torque)


def test_rosbags_reads_the_files_of_a_run_that_was_killed_and_resumed_as_one_bag(tmp_path):
    log = RunLog(tmp_path / "recording_0.mcap")
    log.keep(piece(5.0))
    log.add(piece(6.0))
    kill(log)
    with open(log.path, "ab") as file:
        file.write(b"\6 half a chunk")
    for time in (7.0, 8.0):
        log, _ = resume_log(tmp_path, repeats=False)
        log.keep(piece(time))
        log.close()
    RunLog(tmp_path / "recording_3.mcap").close()  # which holds nothing
    write_metadata(tmp_path, log_files(tmp_path))
    table = json.loads((tmp_path / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert table["relative_file_paths"] == [f"recording_{number}.mcap" for number in range(3)]
    assert [part["message_count"] for part in table["files"]] == [55, 29, 29]  # 2 and 1 pieces; entries 5, 4, 4
    assert table["message_count"] == 113
    with AnyReader([tmp_path]) as bag:
        assert bag.message_count == 113
        states = [c for c in bag.connections if c.topic == "/joint_states"]
        read = [bag.deserialize(raw, c.msgtype).position for c, _, raw in bag.messages(states)]
    assert np.array_equal(read, np.concatenate([piece(time).joints.position for time in (5.0, 6.0, 7.0, 8.0)]))


def test_rosbags_reads_a_single_file(path):
    write_run(path)
    with AnyReader([path]) as bag:
        assert bag.message_count == 381
        for connection, _, raw in bag.messages():
            bag.deserialize(raw, connection.msgtype)


def test_a_gap_of_years_is_read(path):
    with RunLog(path) as log:
        log.add(piece(0.0))
        log.add(piece(1.7e9, events=[Event(0.0, "long ago")]))
    assert [len(read_log(path).plays[0].recording.joints.time)] == [20]


# --- cut anywhere


def test_a_file_cut_anywhere_is_read_as_far_as_its_last_whole_chunk(written, path):
    content, kept = written
    ends = [8]
    while ends[-1] < len(content) - 8:
        ends.append(ends[-1] + 9 + struct.unpack_from("<Q", content, ends[-1] + 1)[0])
    near_ends = {min(end + shift, len(content)) for end in ends for shift in (-1, 0, 1, 8, 9, 10)}
    before = -1
    for size in sorted({*range(0, 8), *range(8, len(content), 1009), *near_ends}):
        path.write_bytes(content[:size])
        log = read_log(path)
        assert len(log.recordings) >= before
        before = len(log.recordings)
        for recording, expected in zip(log.recordings, kept, strict=False):
            assert recording.equals(expected)
        assert log.closed == (size >= len(content) - 8)
    assert before == len(kept)


def test_every_piece_that_was_added_is_there_after_a_kill(path):
    script = (
        "import os, signal, sys; from pathlib import Path; from logs import piece\n"
        "from equipoise.recording.run_log import RunLog\n"
        "log = RunLog(Path(sys.argv[1])); log.begin(99)\n"
        "for count in range(50):\n"
        "    log.add(piece(0.1 * count))\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    places = [str(Path(equipoise.__file__).parents[1]), str(Path(__file__).parents[1])]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(places)}
    assert subprocess.run([sys.executable, "-c", script, str(path)], env=environment, check=False).returncode == -9
    log = read_log(path)
    assert not log.closed
    assert [len(play.recording.joints.time) for play in log.plays] == [500]


def test_zeros_where_a_file_system_had_no_time_for_data_are_an_end(written, path):
    content, kept = written
    path.write_bytes(content[:20000] + bytes(10000))
    log = read_log(path)
    assert len(log.recordings) == 1
    assert log.recordings[0].equals(kept[0])


# --- damaged and foreign


@settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(position=st.floats(0, 1, exclude_max=True), bits_flipped=st.integers(1, 255))
def test_a_damaged_byte_is_found_or_harmless(written, path, position, bits_flipped):
    content, kept = written
    damaged = bytearray(content)
    damaged[int(position * len(content))] ^= bits_flipped
    path.write_bytes(damaged)
    with contextlib.suppress(RecordingError):
        assert [bits(recording) for recording in read_log(path).recordings] == [bits(recording) for recording in kept]


def other_mcap(path, topic="/chatter", **metadata):
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start("ros2", "other")
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
        channel = writer.register_channel(topic, "cdr", schema, metadata)
        writer.add_message(channel, 0, b"\0\1\0\0\2\0\0\0x\0", 0)
        writer.finish()


@pytest.mark.parametrize(
    ("write", "message"),
    [
        (lambda path: path.write_text("a,b\n1,2\n"), "cannot be read: it is not an MCAP file"),
        (lambda path: path.write_bytes(pickle.dumps({"a": 1})), "cannot be read: it is not an MCAP file"),
        (lambda path: path.mkdir(), "recording_0.mcap' cannot be read: No such file or directory"),
        (lambda path: None, "cannot be read: No such file or directory"),
        (other_mcap, "is not an equipoise log: it has no topic /run_log"),
        (
            lambda path: other_mcap(path, "/run_log", format="equipoise.log/7"),
            "is 'equipoise.log/7'; this version reads 'equipoise.log/1': it was made by an earlier version; record or "
            "estimate again$",
        ),
        (lambda path: other_mcap(path, "/run_log", format="equipoise.log/1"), "is damaged: JSONDecodeError"),
    ],
)
def test_a_foreign_file_is_refused(path, write, message):
    write(path)
    with pytest.raises(RecordingError, match=message):
        read_log(path)


@pytest.mark.parametrize("cut", [b"", b"\x89MC"])
def test_a_process_killed_at_once_has_measured_nothing(path, cut):
    path.write_bytes(cut)
    log = read_log(path)
    assert (log.plays, log.recordings, log.unfinished, log.closed) == ([], (), None, False)


# --- disks


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    for folder in ("missing", "file"):
        with pytest.raises(
            OutputError, match=rf"cannot write the recording '.*{folder}/x.mcap': (No such file|Not a dir)"
        ):
            RunLog(tmp_path / folder / "x.mcap")


def test_a_full_disk_keeps_the_written_part_and_writing_resumes(path):
    script = (
        "import resource, sys; from pathlib import Path; from logs import piece\n"
        "from equipoise.errors import OutputError\n"
        "from equipoise.recording.run_log import RunLog\n"
        "def room(size): resource.setrlimit(resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))\n"
        "room(100_000)\n"
        "log, count = RunLog(Path(sys.argv[1])), 0\n"
        "try:\n"
        "    while True: log.keep(piece(1.0 * count, count=50)); count += 1\n"
        "except OutputError as error: print(count, error)\n"
        "if sys.argv[2] == 'more':\n"
        "    room(resource.RLIM_INFINITY); log.keep(piece(1.0 * count + 1, count=50)); log.close()\n"
    )
    places = [str(Path(equipoise.__file__).parents[1]), str(Path(__file__).parents[1])]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(places)}
    for more in ("no", "more"):
        path.unlink(missing_ok=True)
        done = subprocess.run(
            [sys.executable, "-c", script, str(path), more], env=environment, check=True, capture_output=True, text=True
        )
        count, message = done.stdout.split(maxsplit=1)
        assert "File too large" in message
        log = read_log(path)
        assert log.closed == (more == "more")
        assert len(log.plays) == int(count) + 2 * log.closed  # what was refused is written later
        assert len(log.recordings) == int(count) + log.closed > 2
        for index, play in enumerate(log.plays):
            assert play.recording.equals(piece(1.0 * index, count=50))
