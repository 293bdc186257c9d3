"""Recordings on disk: exact, without pickles, and never half written."""

import contextlib
import errno
import json
import pickle
import zipfile

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from equipoise.errors import OutputError, RecordingError
from equipoise.recordings import storage
from equipoise.recordings.recording import CommandStream, Event, ImuStream, JointStream, Recording
from equipoise.recordings.storage import load_recording, save_recording

ANY_FLOAT = st.floats(allow_nan=False, allow_infinity=False, width=64)
EVENTS = (Event(0.125, "trial", {"kind": "lift", "offset": 0.1 + 0.2, "none": None}), Event(1 / 3, "Größe", {"l": [1]}))


def recording_of(values=None, velocity=True, torque=True, commands=True, events=EVENTS):
    values = np.random.default_rng(0).standard_normal((4, 2)) if values is None else values
    time = np.cumsum(np.full(len(values), 1 / 3))
    imu = np.repeat(values[:, :1], 3, axis=1)
    return Recording(
        ("a", "β"),
        JointStream(time, values, 3 * values if velocity else None, values if torque else None),
        ImuStream(time[1:] - 0.1, imu[1:], imu[1:]),
        CommandStream(time[:2], values[:2]) if commands else None,
        events,
    )


def streams(recording):
    found = {"joint_names": recording.joint_names, "events": recording.events}
    for name in ("joints", "imu", "commands"):
        stream = getattr(recording, name)
        if stream is not None:
            found |= {f"{name}.{key}": None if a is None else a.tobytes() for key, a in vars(stream).items()}
    return found


@pytest.fixture
def path(tmp_path):
    return tmp_path / "000-lift.npz"


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(values=arrays(float, (4, 2), elements=ANY_FLOAT.filter(lambda x: abs(x) < 1e300)))
def test_what_is_read_is_what_was_written_to_the_last_bit(path, values):
    recording = recording_of(values)
    save_recording(recording, path)
    assert streams(load_recording(path)) == streams(recording)


@pytest.mark.parametrize("missing", ["velocity", "torque", "commands"])
def test_what_is_missing_stays_missing(path, missing):
    recording = recording_of(**{missing: False})
    save_recording(recording, path)
    assert streams(load_recording(path)) == streams(recording)


def test_an_empty_recording_is_kept_too(path):
    recording = recording_of(np.zeros((0, 2)), events=())
    save_recording(recording, path)
    assert streams(load_recording(path)) == streams(recording)


def test_writing_again_replaces(path):
    save_recording(recording_of(), path)
    save_recording(recording_of(np.ones((7, 2))), path)
    assert len(load_recording(path).joints.time) == 7
    assert [file.name for file in path.parent.iterdir()] == [path.name]


def test_nothing_in_the_file_is_a_pickle(path):
    save_recording(recording_of(), path)
    with np.load(path, allow_pickle=False) as archive:
        assert {array.dtype.kind for array in dict(archive).values()} == {"f", "U"}
        assert json.loads(str(archive["header"]))["format"] == "equipoise.recording/1"


def test_a_missing_file_is_named(path):
    with pytest.raises(RecordingError, match=r"the recording '.*000-lift.npz' cannot be read: .*No such file"):
        load_recording(path)


@pytest.mark.parametrize("kept", [0, 10, 0.5, 0.99, -1])
def test_a_file_cut_short_is_refused(path, kept):
    save_recording(recording_of(), path)
    content = path.read_bytes()
    path.write_bytes(content[: int(kept * len(content)) if isinstance(kept, float) else kept])
    with pytest.raises(RecordingError, match=r"cannot be read: it is no archive, or one that was cut short"):
        load_recording(path)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(position=st.floats(0, 1, exclude_max=True), bits=st.integers(1, 255))
def test_a_damaged_byte_is_found_or_harmless(path, position, bits):
    recording = recording_of()
    save_recording(recording, path)
    content = bytearray(path.read_bytes())
    content[int(position * len(content))] ^= bits
    path.write_bytes(content)
    with contextlib.suppress(RecordingError):
        assert streams(load_recording(path)) == streams(recording)


def npz(**arrays):
    def write(path):
        with open(path, "wb") as file:
            np.savez(file, **arrays)

    return write


def npy(path):
    with open(path, "wb") as file:
        np.save(file, np.zeros(3))


def zipped_text(path):
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("readme.txt", "hello")


@pytest.mark.parametrize(
    ("write", "message"),
    [
        (lambda path: path.write_text("a,b\n1,2\n"), "cannot be read: it is no archive"),
        (lambda path: path.write_bytes(pickle.dumps({"a": 1})), "cannot be read: it is no archive"),
        (lambda path: path.mkdir(), "cannot be read: .*Is a directory"),
        (npy, "cannot be read: it is no archive"),
        (zipped_text, "is no recording of equipoise"),
        (npz(x=np.zeros(3)), "is no recording of equipoise"),
        (npz(header=np.array("[1]")), "is no recording of equipoise"),
        (npz(header=np.array("{broken")), "is no recording of equipoise"),
        (npz(header=np.array([{"format": 1}], dtype=object)), "cannot be read: Object arrays cannot be loaded"),
        (
            npz(header=np.array('{"format": "equipoise.recording/2"}')),
            "is 'equipoise.recording/2'; this version reads 'equipoise.recording/1'$",
        ),
    ],
)
def test_a_foreign_file_is_refused(path, write, message):
    write(path)
    with pytest.raises(RecordingError, match=message):
        load_recording(path)


@pytest.mark.parametrize(
    ("array", "value"),
    [
        ("joint_time", None), ("joint_time", np.zeros(4)), ("joint_position", np.full((4, 2), np.nan)),
        ("joint_position", np.float64(1)), ("imu_acceleration", np.zeros((3, 2))), ("command_position", None),
        ("imu_time", np.array(["a", "b", "c"])), ("header.joint_names", ["a"]), ("header.joint_names", 1),
        ("header.events", [1]), ("header.events", [{"time": 0.0, "name": "x"}]), ("header.events", None),
        ("header.events", [{"time": "soon", "name": "x", "data": {}}]),
        ("header.events", [{"time": 0.0, "name": "x", "data": 3}]),
    ],
)  # fmt: skip
def test_an_archive_that_holds_no_valid_recording_is_damaged(path, array, value):
    save_recording(recording_of(), path)
    with np.load(path) as archive:
        content = dict(archive)
    if array.startswith("header."):
        header = json.loads(str(content["header"]))
        header[array.removeprefix("header.")] = value
        content["header"] = np.array(json.dumps(header))
    else:
        del content[array]
        content |= {} if value is None else {array: value}
    npz(**content)(path)
    with pytest.raises(RecordingError, match=r"the recording '.*000-lift.npz' is damaged: "):
        load_recording(path)


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    for folder in ("missing", "file"):
        with pytest.raises(
            OutputError, match=rf"cannot write the recording '.*{folder}/x.npz': (No such file|Not a dir)"
        ):
            save_recording(recording_of(), tmp_path / folder / "x.npz")


@pytest.mark.parametrize("before", [True, False])
def test_a_full_disk_leaves_no_half_recording(path, monkeypatch, before):
    if before:
        save_recording(recording_of(), path)

    def fill(file, **arrays):
        file.write(b"PK half an archive")
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(storage.np, "savez", fill)
    with pytest.raises(OutputError, match=r"cannot write the recording '.*000-lift.npz': No space left on device"):
        save_recording(recording_of(np.ones((9, 2))), path)
    assert list(path.parent.iterdir()) == ([path] if before else [])
    if before:
        assert streams(load_recording(path)) == streams(recording_of())


def test_ctrl_c_while_writing_leaves_the_name_free(path, monkeypatch):
    def interrupt(file, **arrays):
        file.write(b"PK half an archive")
        raise KeyboardInterrupt

    monkeypatch.setattr(storage.np, "savez", interrupt)
    with pytest.raises(KeyboardInterrupt):
        save_recording(recording_of(), path)
    assert not path.exists()
    assert not list(path.parent.glob("*.npz"))
