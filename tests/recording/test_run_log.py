"""The log of a run: recordings are read exactly as written."""

import signal
import threading

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from logs import NAMES, bits, kill, piece, trial_event, whole, write_run

from equipoise.errors import OutputError, RecordingError
from equipoise.recording.recording import CommandStream, Event, ImuStream, JointStream, Recording
from equipoise.recording.run_log import RunLog, resume_log, save_recording
from equipoise.recording.run_log_reader import log_file, read_log

NUMBERS = st.floats(allow_nan=False, allow_infinity=False, width=64)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "recording.mcap"


def load_recording(path):
    """The only recording in a file."""
    content = read_log(path)
    (found,) = [*content.recordings, *([] if content.unfinished is None else [content.unfinished])]
    return found


# --- recordings there and back


@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(arrays(float, (4, 8), elements=NUMBERS))
def test_a_log_is_read_bit_by_bit_as_written(path, values):
    time = np.cumsum(np.full(4, 1 / 3))
    recording = Recording(
        NAMES,
        JointStream(time, values[:, :2], values[:, 2:4], values[:, 4:6]),
        ImuStream(time[1:] - 0.4, values[1:, :3], values[1:, 3:6]),
        CommandStream(time[:2], values[:2, 6:]),
        (Event(0.125, "trial", {"offset": 0.1 + 0.2, "none": None}), Event(1 / 3, "Größe", {"l": [1, (2.5, "ä")]})),
    )
    save_recording(recording, path)
    assert bits(load_recording(path)) == bits(recording)


@pytest.mark.parametrize("missing", ["velocity", "torque", "commands"])
def test_missing_values_stay_missing(path, missing):
    recording = piece(**{missing: False})
    save_recording(recording, path)
    assert bits(load_recording(path)) == bits(recording)


def test_an_empty_recording_is_kept_too(path):
    recording = piece(count=0)
    save_recording(recording, path)
    assert bits(load_recording(path)) == bits(recording)


def test_events_keep_their_order_whatever_their_times(path):
    recording = piece(events=[Event(0.05, "b"), Event(0.01, "a"), Event(-7.0, "c"), Event(0.5, "d")])
    save_recording(recording, path)
    assert load_recording(path).events == recording.events


def test_a_broken_recording_comes_back_broken(path):
    recording = piece(events=[trial_event(0.0)]).broken_off()
    save_recording(recording, path)
    assert read_log(path).recordings == ()
    assert bits(load_recording(path)) == bits(recording)


def test_saving_again_replaces_and_nothing_else_is_left(path):
    save_recording(piece(), path)
    save_recording(piece(count=7), path)
    assert len(load_recording(path).joints.time) == 7
    assert [file.name for file in path.parent.iterdir()] == [path.name]


# --- pieces, plays and trials


@pytest.mark.parametrize("close", [True, False])
def test_trials_are_the_plays_that_made_them(path, close):
    kept = write_run(path, close=close)
    log = read_log(path)
    assert log.closed is close
    assert [bits(recording) for recording in log.recordings] == [bits(recording) for recording in kept]
    assert [recording.trial_id for recording in log.recordings] == [0, 1, 2]
    assert [play.trial for play in log.plays] == [None, 0, 0, 1, 1, 2, 2, None]
    assert {play.commands for play in log.plays} == {99}
    assert log.unfinished is None
    assert len(log.complete_plays) == 7
    assert log.recordings[1].joints.torque is None  # one of its plays had none
    assert log.plays[3].recording.joints.torque is not None


def test_streamed_samples_are_not_written_twice(path):
    with RunLog(path) as log:
        log.begin(10, 1)
        log.add(piece())
        before = path.stat().st_size
        log.keep(whole(1, piece()))
        assert path.stat().st_size - before < 1000
        log.keep(whole(2, piece(1.0)))  # this was not
        assert path.stat().st_size - before > 2000
    assert [bits(recording) for recording in read_log(path).recordings] == [bits(piece()), bits(piece(1.0))]


def test_motions_of_equal_samples_are_distinguished_by_their_trials(path):
    """A robot that stands still without sensor noise gives equal samples."""
    with RunLog(path) as log:
        for trial, start in ((None, 0.0), (1, 0.0), (2, 0.0), (2, 0.1)):
            log.begin(10, trial)
            log.add(piece(start))
        log.keep(whole(2, piece(), piece(0.1)))
    content = read_log(path)
    assert [play.trial for play in content.plays] == [None, 1, 2, 2]
    assert len(content.recordings[0].joints.time) == 20


def test_a_recording_from_elsewhere_is_written_as_it_is(path):
    with RunLog(path) as log:
        log.begin(10)
        log.add(piece(seed=1))
        log.keep(piece(seed=2))
    content = read_log(path)
    assert [bits(recording) for recording in content.recordings] == [bits(piece(seed=2))]
    assert bits(content.plays[0].recording) == bits(piece(seed=1))


def test_an_attempt_before_a_trial_is_a_part_of_no_recording(path):
    with RunLog(path) as log:
        for trial, start in ((None, 0.0), (1, 1.0), (1, 2.0), (2, 3.0), (2, 4.0)):
            log.begin(10, trial)
            log.add(piece(start))
        log.keep(whole(2, piece(3.0), piece(4.0)))
    content = read_log(path)
    assert [play.trial for play in content.plays] == [None, 1, 1, 2, 2]
    assert [recording.joints.time[0] for recording in content.recordings] == [3.0]
    assert len(content.complete_plays) == 5


def test_a_trial_under_way_is_unfinished(path):
    log = RunLog(path)
    log.keep(piece(events=[trial_event(0.0)]))
    log.begin(10, 2)
    log.add(piece(1.0, events=[trial_event(1.0)]))
    log.add(piece(1.1))
    log.begin(10, 2)
    log.add(piece(1.2))
    kill(log)
    content = read_log(path)
    assert len(content.recordings) == 1
    expected = Recording.concatenate([piece(1.0, events=[trial_event(1.0)]), piece(1.1), piece(1.2)])
    assert bits(content.unfinished) == bits(expected.broken_off())
    assert content.unfinished.broken
    assert [play.trial for play in content.plays] == [None, 2, 2]


def test_a_broken_recording_is_not_complete(path):
    broken = piece(1.0, events=[trial_event(1.0)])
    with RunLog(path) as log:
        log.keep(piece(events=[trial_event(0.0)]))
        log.begin(10, 2)
        log.add(broken)
        log.begin(10)
        log.add(piece(2.0))  # its guard puts it down
        log.keep(whole(2, broken.broken_off()))
        log.begin(10)
        log.add(piece(3.0))  # lies down
    content = read_log(path)
    assert len(content.recordings) == 1
    assert bits(content.unfinished) == bits(broken.broken_off())
    assert [play.trial for play in content.plays] == [None, 2, None, None]


def test_ctrl_c_in_the_middle_of_a_write_ends_it_whole(path, monkeypatch):
    with RunLog(path) as log:
        log.begin(60, 1)
        log.add(piece(events=[trial_event(0.0)]))
        add_message, calls, looked = log._writer.add_message, [], threading.Event()

        def interrupted(*arguments):
            add_message(*arguments)
            calls.append(arguments)
            # The caller is interrupted, and tries to write more meanwhile. Python does not see a signal that arrives just
            # before it waits for a lock until it has the lock, so that a second one may be needed.
            for _ in range(5 if len(calls) == 20 else 0):
                signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)
                if looked.wait(2.0):
                    break

        with monkeypatch.context() as patched:
            patched.setattr(log._writer, "add_message", interrupted)
            with pytest.raises(KeyboardInterrupt):
                log.add(piece(0.1))
            assert len(calls) < 26
            looked.set()
            log.add(piece(0.2))
        log.keep(whole(1, piece(events=[trial_event(0.0)]), piece(0.1), piece(0.2)))
    content = read_log(path)
    assert content.closed
    expected = Recording.concatenate([piece(events=[trial_event(0.0)]), piece(0.1), piece(0.2)])
    assert [bits(recording) for recording in content.recordings] == [bits(expected)]
    assert len(content.plays) == 1


def test_a_closed_log_raises(path):
    with RunLog(path) as log:
        pass
    log.close()
    with pytest.raises(OutputError, match=r"cannot write the recording '.*recording.mcap': it is closed"):
        log.add(piece())


def test_a_file_that_exists_is_not_replaced(path):
    path.write_text("of another program")
    with pytest.raises(OutputError, match=r"cannot write the recording '.*recording.mcap': File exists"):
        RunLog(path)
    assert path.read_text() == "of another program"


# --- resumed


def names(folder):
    return sorted(file.name for file in folder.iterdir())


@pytest.mark.parametrize("part", [0.05, 0.3, 0.55, 0.8, 1.0])
def test_a_run_that_was_killed_and_resumed_twice_is_three_files_and_one_log(tmp_path, part):
    """Plays after the last complete recording are repeated."""
    first, second = log_file(tmp_path, 0), log_file(tmp_path, 1)
    kept = [*write_run(first, close=False)]
    for number, file in enumerate((first, second), 1):
        content = file.read_bytes()
        file.write_bytes(content[: int(part * len(content))])
        before = read_log(tmp_path)
        log, found = resume_log(tmp_path, repeats=True)
        assert [bits(recording) for recording in found.recordings] == [bits(one) for one in before.recordings]
        now = read_log(tmp_path)  # while it is written
        assert [bits(play.recording) for play in now.plays] == [bits(play.recording) for play in found.complete_plays]
        kept = [*kept[: len(found.recordings)], whole(7, piece(9.0 + number, events=[trial_event(9.0 + number)]))]
        log.begin(10, 7)
        log.add(piece(9.0 + number, events=[trial_event(9.0 + number)]))
        log.keep(kept[-1])
        log.begin(10)
        log.add(piece(9.5 + number))
        kill(log) if number == 1 else log.close()
        assert [bits(one) for one in read_log(tmp_path).recordings] == [bits(one) for one in kept][: number + 9]
    content = read_log(tmp_path)
    assert content.closed
    assert content.recordings[-1].joints.time[0] == 11.0
    assert names(tmp_path) == [f"recording_{number}.mcap" for number in range(3)]


def test_valid_plays_precede_the_end_of_the_last_recording(tmp_path):
    kept = write_run(log_file(tmp_path, 0))
    log, _ = resume_log(tmp_path, repeats=True)
    log.keep(piece(9.0))
    log.close()
    content = read_log(tmp_path)
    assert [bits(recording) for recording in content.recordings] == [bits(one) for one in (*kept, piece(9.0))]
    assert [play.trial for play in content.plays] == [None, 0, 0, 1, 1, 2, 2, None]
    assert content.plays[-1].recording.joints.time[0] == 9.0


def test_unrepeated_plays_stay_without_a_recording(tmp_path):
    log = RunLog(log_file(tmp_path, 0))
    log.keep(whole(1, piece(events=[trial_event(0.0)])))
    log.begin(10, 2)
    log.add(piece(1.0, events=[trial_event(1.0)]))
    kill(log)
    for start in (2.0, 0.5):  # killed twice, before the next trial is complete; the clock restarted
        log, content = resume_log(tmp_path, repeats=False)
        log.begin(10, 2)
        log.add(piece(start, events=[trial_event(start)]))
        kill(log)
        assert len(content.recordings) == 1
    log, _ = resume_log(tmp_path, repeats=False)
    log.begin(10, 2)
    log.add(piece(4.0, events=[trial_event(4.0)]))
    log.keep(whole(2, piece(4.0, events=[trial_event(4.0)])))
    log.close()
    content = read_log(tmp_path)
    assert [play.recording.joints.time[0] for play in content.plays] == [0.0, 1.0, 2.0, 0.5, 4.0]
    assert [play.trial for play in content.plays] == [1, None, None, None, 2]
    assert [recording.joints.time[0] for recording in content.recordings] == [0.0, 4.0]
    assert content.unfinished is None


@pytest.mark.parametrize("kept", [0, 4])
def test_a_resume_that_was_killed_at_once_changes_nothing(tmp_path, kept):
    write_run(log_file(tmp_path, 0), close=False)
    before = read_log(tmp_path)
    log_file(tmp_path, 1).write_bytes(log_file(tmp_path, 0).read_bytes()[:kept])
    assert [play.trial for play in read_log(tmp_path).plays] == [play.trial for play in before.plays]
    log, _ = resume_log(tmp_path, repeats=True)
    log.keep(piece(9.0))
    log.close()
    assert len(read_log(tmp_path).recordings) == len(before.recordings) + 1
    assert names(tmp_path)[-1] == "recording_2.mcap"


def test_a_file_that_is_missing_or_was_cut_later_is_noticed(tmp_path):
    for number in range(3):
        log = RunLog(log_file(tmp_path, 0)) if number == 0 else resume_log(tmp_path, repeats=True)[0]
        log.keep(piece(1.0 * number))
        log.close()
    middle = log_file(tmp_path, 1).read_bytes()
    log_file(tmp_path, 1).write_bytes(middle[: len(middle) // 10])
    with pytest.raises(
        RecordingError, match=r"recording_2.mcap' is damaged: the files before it hold 1 of 2 motions; copy"
    ):
        read_log(tmp_path)
    log_file(tmp_path, 1).unlink()
    with pytest.raises(RecordingError, match=r"recording_1.mcap' cannot be read: No such file"):
        read_log(tmp_path)


def test_a_log_that_another_process_writes_is_left_alone(tmp_path):
    with RunLog(log_file(tmp_path, 0)) as log:
        log.add(piece())
        with pytest.raises(OutputError, match="is being written by another process; end that first"):
            resume_log(tmp_path, repeats=True)
        log.keep(piece())
    assert len(read_log(tmp_path).recordings) == 1
    assert names(tmp_path) == ["recording_0.mcap"]


@pytest.mark.parametrize("content", [None, b"other"])
def test_a_file_that_is_not_a_log_cannot_be_resumed(tmp_path, content):
    if content is not None:
        log_file(tmp_path, 0).write_bytes(content)
    with pytest.raises(RecordingError, match=r"cannot be read: (No such file|it is not an MCAP)"):
        resume_log(tmp_path, repeats=True)
    assert not log_file(tmp_path, 1).exists()
