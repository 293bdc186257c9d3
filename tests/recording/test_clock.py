"""Times on a grid of whole nanoseconds."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from equipoise.errors import RecordingError
from equipoise.recording.clock import LONGEST, nanoseconds, rounded, seconds
from equipoise.recording.recording import Event, ImuStream, JointStream, Recording

DAYS_97 = 2.0**23
TIMES = st.floats(-LONGEST, LONGEST, exclude_min=True, exclude_max=True)


@given(TIMES)
def test_rounding_again_changes_nothing(time):
    once = rounded(np.array(time))
    assert rounded(once) == once
    assert abs(once - time) <= 0.5e-9 + np.spacing(abs(time))


@given(st.integers(-int(DAYS_97 * 1e9), int(DAYS_97 * 1e9)))
def test_whole_nanoseconds_come_back(time):
    assert nanoseconds(seconds(np.array(time))) == time


@given(st.integers(0, 10**7))
def test_a_grid_of_two_milliseconds_equals_its_decimals(sample):
    assert rounded(np.array(sample * 0.002)) == pytest.approx(float(f"{sample * 2 / 1000:.3f}"), rel=2**-52, abs=0)


def test_times_since_1970_keep_what_a_double_holds_of_them():
    time = 1.7e9 + np.arange(5) * 2**-22
    assert np.array_equal(rounded(time), time)


def test_streams_round_their_times_when_they_are_made():
    time = np.arange(1000) * 0.1 / 3
    stream = JointStream(time, np.zeros((1000, 1)))
    assert np.array_equal(stream.time, rounded(time))
    assert np.array_equal(nanoseconds(stream.time) % 10**9, np.rint(time % 1 * 1e9))


def test_samples_that_fall_onto_one_nanosecond_are_refused():
    with pytest.raises(
        RecordingError, match=r"IMU times must be finite and increasing; sample 1 is at 0\.1 s after 0\.1 s"
    ):
        ImuStream([0.1, 0.1 + 4e-10], np.zeros((2, 3)), np.zeros((2, 3)))


@pytest.mark.parametrize("time", [np.nan, np.inf, -np.inf, 1e10])
def test_an_event_without_a_time_is_rejected(time):
    with pytest.raises(RecordingError, match=r"event 'x' is at .* s; times must be finite and below 68 years"):
        Event(time, "x")


@pytest.mark.parametrize("data", [{"a": np.zeros(3)}, {"a": {1, 2}}, {"a": float("nan")}, 3])
def test_event_data_must_be_json(data):
    with pytest.raises(RecordingError, match="event 'x' has data that JSON cannot represent: "):
        Event(0.0, "x", data)


def test_event_data_are_plain_json_from_the_start():
    event = Event(1 / 3, "x", {"tuple": (1, 2), "numpy": np.float64(0.1), "none": None})
    assert event.data == {"tuple": [1, 2], "numpy": 0.1, "none": None}
    assert type(event.data["numpy"]) is float
    assert event.time == 0.333333333


def test_a_phase_holds_the_sample_of_the_moment_at_which_it_begins():
    start, period = 17.314, 0.002
    joints = JointStream(start + period * np.arange(1000), np.zeros((1000, 1)))
    for sample in range(1000):
        event = Event(start + sample * period, "phase", {"name": "x"})
        recording = Recording(
            ("a",), joints, ImuStream(joints.time, np.zeros((1000, 3)), np.zeros((1000, 3))), None, (event,)
        )
        assert len(recording.phase("x").joints.time) == 1000 - sample
        assert len(recording.between(start, start + sample * period).joints.time) == sample
