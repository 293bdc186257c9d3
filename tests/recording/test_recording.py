"""Recordings: validated when they are made, read-only afterwards, cut by phase and joined again."""

import dataclasses

import numpy as np
import pytest

from equipoise.errors import RecordingError
from equipoise.recording.recording import PHASE, CommandStream, Event, ImuStream, JointStream, Recording

NAMES = ("a", "b")


def recording_of(count=10, start=0.0, events=(), velocity=True, torque=True, commands=True, names=NAMES):
    """Samples 0.1 s apart; every value encodes its sample."""
    time = start + 0.1 * np.arange(count)
    joints = np.outer(np.arange(count), np.ones(len(names)))
    return Recording(
        names,
        JointStream(time, joints, joints if velocity else None, joints if torque else None),
        ImuStream(time, np.zeros((count, 3)), np.ones((count, 3))),
        CommandStream(time, joints) if commands else None,
        tuple(events),
    )


def phase(time, name):
    return Event(time, PHASE, {"name": name})


@pytest.fixture
def phased():
    return recording_of(events=[phase(0.0, "rest"), Event(0.15, "note"), phase(0.3, "lift"), phase(0.7, "lower")])


@pytest.mark.parametrize("kind", ["joint", "IMU", "command"])
@pytest.mark.parametrize(
    ("time", "message"),
    [
        ([0.0, 0.2, 0.2], "times must be finite and increasing; sample 2 is at 0.2 s after 0.2 s"),
        ([0.0, 0.3, 0.2], "times must be finite and increasing; sample 2 is at 0.2 s after 0.3 s"),
        ([np.nan, 0.3, 0.4], "times must be finite and increasing; sample 0 is at nan s"),
        ([0.0, 0.1, np.inf], "times must be finite and increasing; sample 2 is at inf s after 0.1 s"),
        ([[0.0, 0.1, 0.2]], r"times have shape (1, 3); they must be one-dimensional"),
    ],
)
def test_times_must_increase(kind, time, message):
    with pytest.raises(RecordingError) as caught:
        stream_of(kind, time=time)
    assert str(caught.value) == f"{kind} {message}"


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        ("joint", "position"), ("joint", "velocity"), ("joint", "torque"), ("IMU", "angular_velocity_in_imu"),
        ("IMU", "acceleration_in_imu"), ("command", "position"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_value_that_is_not_a_number_is_named_by_sample_and_time(kind, name, bad):
    values = np.zeros((3, 3))
    values[1, 2] = values[2, 0] = bad
    with pytest.raises(RecordingError) as caught:
        stream_of(kind, **{name: values})
    assert str(caught.value) == f"{kind} {name} is not finite at sample 1 (t = 0.100 s)"


@pytest.mark.parametrize(
    ("kind", "name", "shape", "expected"),
    [
        ("joint", "position", (2, 3), (3, 3)),
        ("joint", "position", (), (3, 0)),
        ("joint", "position", (3,), (3, 3)),
        ("joint", "velocity", (3, 4), (3, 3)),
        ("joint", "torque", (4, 3), (3, 3)),
        ("IMU", "angular_velocity_in_imu", (3, 4), (3, 3)),
        ("IMU", "acceleration_in_imu", (2, 3), (3, 3)),
        ("command", "position", (4, 3), (3, 3)),
        ("command", "position", (), (3, 0)),
    ],
)
def test_a_wrong_shape_raises_with_the_right_one(kind, name, shape, expected):
    with pytest.raises(RecordingError) as caught:
        stream_of(kind, **{name: np.zeros(shape)})
    assert str(caught.value) == f"{kind} {name} has shape {shape}; expected {expected}"


def stream_of(kind, **values):
    stream = {"joint": JointStream, "IMU": ImuStream, "command": CommandStream}[kind]
    time = [0.0, 0.1, 0.2]
    usual = {field.name: np.zeros((3, 3)) for field in dataclasses.fields(stream)}
    return stream(**{**usual, "time": time, **values})


def test_joint_columns_and_names_must_agree():
    joints, imu = JointStream([0.0], np.zeros((1, 3))), ImuStream([0.0], np.zeros((1, 3)), np.zeros((1, 3)))
    with pytest.raises(RecordingError, match="3 joint columns and 2 joint names"):
        Recording(NAMES, joints, imu)


def test_command_columns_and_names_must_agree():
    commands = CommandStream([0.0], np.zeros((1, 3)))
    with pytest.raises(RecordingError, match="3 command columns and 2 joint names"):
        dataclasses.replace(recording_of(), commands=commands)


def test_streams_are_copies_that_cannot_be_written():
    time, position = np.array([0.0, 0.1]), np.zeros((2, 2))
    stream = JointStream(time, position)
    position[0, 0] = time[0] = 7
    assert stream.position[0, 0] == stream.time[0] == 0
    with pytest.raises(ValueError, match="read-only"):
        stream.position[0, 0] = 1
    with pytest.raises(dataclasses.FrozenInstanceError):
        stream.position = position


def test_parts_of_a_recording_share_only_its_samples():
    whole = recording_of()
    assert np.shares_memory(whole.between(-1, 100).joints.position, whole.joints.position)
    values = np.zeros((2, 2))
    closed = values[:]
    closed.setflags(write=False)  # but what it is a part of can be written
    stream = JointStream([0.0, 0.1], closed)
    values[0, 0] = 7
    assert stream.position[0, 0] == 0
    assert not np.shares_memory(JointStream([0.0, 0.1], values[::-1]).position, values)


def test_integers_and_lists_become_floats():
    stream = JointStream([0, 1], [[1, 2], [3, 4]])
    assert stream.time.dtype == stream.position.dtype == np.float64


def test_streams_keep_their_own_times():
    recording = Recording(
        NAMES,
        JointStream([0.0, 0.1], np.zeros((2, 2))),
        ImuStream([0.03, 0.04, 0.05], np.zeros((3, 3)), np.ones((3, 3))),
    )
    assert recording.commands is None
    assert len(recording.between(0.0, 0.05).joints.time) == 1
    assert len(recording.between(0.0, 0.05).imu.time) == 2


def test_a_recording_lasts_from_its_first_to_its_last_sample():
    assert recording_of(11, start=3.0).duration == pytest.approx(1.0)
    assert recording_of(0).duration == 0.0


def test_between_takes_the_start_and_leaves_the_end():
    part = recording_of(events=[Event(0.2, "in"), Event(0.5, "out")]).between(0.2, 0.5)
    assert part.joints.time == pytest.approx([0.2, 0.3, 0.4])
    assert [event.name for event in part.events] == ["in"]
    for array in (part.joints.position, part.joints.velocity, part.joints.torque, part.commands.position):
        assert array[:, 0].tolist() == [2, 3, 4]
    assert part.imu.time.tolist() == part.commands.time.tolist() == part.joints.time.tolist()


def test_between_keeps_what_is_missing_missing():
    part = recording_of(velocity=False, torque=False, commands=False).between(0.0, 0.5)
    assert part.joints.velocity is None
    assert part.joints.torque is None
    assert part.commands is None


def test_a_phase_lasts_until_the_next_one(phased):
    assert phased.phase("rest").joints.position[:, 0].tolist() == [0, 1, 2]
    assert phased.phase("lift").joints.position[:, 0].tolist() == [3, 4, 5, 6]
    assert [event.name for event in phased.phase("rest").events] == [PHASE, "note"]


def test_the_last_phase_lasts_until_the_end(phased):
    assert phased.phase("lower").joints.position[:, 0].tolist() == [7, 8, 9]


def test_a_phase_may_be_taken_until_a_later_one(phased):
    assert phased.phase("rest", until="lower").joints.position[:, 0].tolist() == list(range(7))


def test_a_missing_phase_raises_with_the_present_ones(phased):
    with pytest.raises(RecordingError) as caught:
        phased.phase("excitation")
    assert str(caught.value) == "the recording has no phase 'excitation'; it has ['rest', 'lift', 'lower']"
    with pytest.raises(RecordingError, match="the recording has no phase 'end'"):
        phased.phase("rest", until="end")


def test_a_phase_without_samples_is_an_error():
    recording = recording_of(events=[phase(0.0, "rest"), phase(0.91, "late")])
    with pytest.raises(RecordingError, match="phase 'late' of the recording holds no sample"):
        recording.phase("late")


def test_has_phase_looks_at_phases_only(phased):
    assert phased.has_phase("lift")
    assert not phased.has_phase("note")
    assert not phased.has_phase("excitation")


def test_cutting_and_joining_gives_the_same(phased):
    joined = Recording.concatenate([phased.phase(name) for name in ("rest", "lift", "lower")])
    assert joined.events == phased.events
    for stream in ("joints", "imu", "commands"):
        for field in dataclasses.fields(getattr(phased, stream)):
            whole, again = getattr(getattr(phased, stream), field.name), getattr(getattr(joined, stream), field.name)
            assert np.array_equal(whole, again)


@pytest.mark.parametrize("missing", ["velocity", "torque", "commands"])
def test_a_stream_missing_in_one_part_is_missing_in_the_whole(missing):
    whole = Recording.concatenate([recording_of(), recording_of(start=1.0, **{missing: False})])
    assert len(whole.joints.time) == 20
    assert (whole.commands if missing == "commands" else getattr(whole.joints, missing)) is None


def test_only_consecutive_recordings_of_the_same_joints_can_be_joined():
    with pytest.raises(RecordingError, match="no recordings to concatenate"):
        Recording.concatenate([])
    with pytest.raises(
        RecordingError, match=r"joint times must be finite and increasing; sample 10 is at 0 s after 0\.9 s"
    ):
        Recording.concatenate([recording_of(), recording_of()])
    with pytest.raises(RecordingError, match="recordings of different joints cannot be joined: a, b, and a, c"):
        Recording.concatenate([recording_of(), recording_of(start=1.0, names=("a", "c"))])
