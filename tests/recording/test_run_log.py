"""The log of a run: what was kept comes back exactly, whatever it was written in."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from logs import NAMES, bits, piece, trial_event, write_run

from equipoise.errors import OutputError, RecordingError
from equipoise.recording.recording import CommandStream, Event, ImuStream, JointStream, Recording
from equipoise.recording.run_log import RunLog, save_recording
from equipoise.recording.run_log_reader import read_log
from equipoise.recording.run_log_resume import resume_log

NUMBERS = st.floats(allow_nan=False, allow_infinity=False, width=64)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "recording.mcap"


def load_recording(path):
    """The only recording in a file."""
    content = read_log(path)
    (found,) = [*content.recordings, *([] if content.unfinished is None else [content.unfinished])]
    return found


def killed(log):
    log.file._file.close()


# --- recordings there and back


@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(arrays(float, (4, 8), elements=NUMBERS))
def test_what_is_read_is_what_was_written_to_the_last_bit(path, values):
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
def test_what_is_missing_stays_missing(path, missing):
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
    assert [play.trial for play in log.plays] == [None, 0, 0, 1, 1, 2, 2, None]
    assert {play.commands for play in log.plays} == {99}
    assert log.unfinished is None
    assert len(log.complete_plays) == 7
    assert log.recordings[1].joints.torque is None  # one of its plays had none
    assert log.plays[3].recording.joints.torque is not None


def test_what_was_streamed_is_not_written_again_when_it_is_kept(path):
    with RunLog(path) as log:
        log.begin(10)
        log.add(piece())
        before = path.stat().st_size
        log.keep(piece())
        assert path.stat().st_size - before < 1000
        log.keep(piece(1.0))  # this was not
        assert path.stat().st_size - before > 2000
    assert [bits(recording) for recording in read_log(path).recordings] == [bits(piece()), bits(piece(1.0))]


def test_a_recording_that_is_not_quite_what_was_streamed_is_written_as_it_is(path):
    streamed, handed = piece(seed=1), piece(seed=2)
    with RunLog(path) as log:
        log.begin(10)
        log.add(streamed)
        log.keep(handed)
    content = read_log(path)
    assert [bits(recording) for recording in content.recordings] == [bits(handed)]
    assert bits(content.plays[0].recording) == bits(streamed)


def test_an_attempt_before_a_trial_belongs_to_it(path):
    with RunLog(path) as log:
        for start, events in ((0.0, ()), (1.0, [trial_event(1.0)]), (2.0, ()), (3.0, [trial_event(3.0)]), (4.0, ())):
            log.begin(10)
            log.add(piece(start, events=events))
        log.keep(Recording.concatenate([piece(3.0, events=[trial_event(3.0)]), piece(4.0)]))
    content = read_log(path)
    assert [play.trial for play in content.plays] == [None, 0, 0, 0, 0]
    assert content.recordings[0].joints.time[0] == 3.0


def test_a_trial_under_way_is_unfinished(path):
    log = RunLog(path)
    log.keep(piece(events=[trial_event(0.0)]))
    log.begin(10)
    log.add(piece(1.0, events=[trial_event(1.0)]))
    log.add(piece(1.1))
    log.begin(10)
    log.add(piece(1.2))
    killed(log)
    content = read_log(path)
    assert len(content.recordings) == 1
    expected = Recording.concatenate([piece(1.0, events=[trial_event(1.0)]), piece(1.1), piece(1.2)])
    assert bits(content.unfinished) == bits(expected.broken_off())
    assert content.unfinished.broken
    assert [play.trial for play in content.plays] == [0, None, None]


def test_what_is_kept_broken_is_not_complete(path):
    broken = piece(1.0, events=[trial_event(1.0)])
    with RunLog(path) as log:
        log.keep(piece(events=[trial_event(0.0)]))
        log.begin(10)
        log.add(broken)
        log.keep(broken.broken_off())
        log.begin(10)
        log.add(piece(2.0))  # lies down
    content = read_log(path)
    assert len(content.recordings) == 1
    assert bits(content.unfinished) == bits(broken.broken_off())
    assert [play.trial for play in content.plays] == [0, None, None]


def test_ctrl_c_between_the_chunks_of_a_piece_spoils_nothing_else(path, monkeypatch):
    with RunLog(path) as log:
        log.begin(10)
        log.add(piece(events=[trial_event(0.0)]))
        whole = log.file._write_chunk
        calls = []

        def interrupted(*arguments):
            if calls:
                raise KeyboardInterrupt
            calls.append(whole(*arguments))

        with monkeypatch.context() as patched:
            patched.setattr(log.file, "_write_chunk", interrupted)
            log.begin(300)
            with pytest.raises(KeyboardInterrupt):
                log.add(piece(1.0, count=300))
        log.keep(piece(events=[trial_event(0.0)]))
        log.begin(10)
        log.add(piece(9.0, events=[trial_event(9.0)]))
        log.keep(piece(9.0, events=[trial_event(9.0)]))
    content = read_log(path)
    assert content.closed
    assert [recording.joints.time[0] for recording in content.recordings] == [0.0, 9.0]


def test_ctrl_c_when_a_piece_was_written_and_not_noted_writes_the_recording_whole(path, monkeypatch):
    recording = Recording.concatenate([piece(events=[trial_event(0.0)]), piece(0.1), piece(0.2)])
    with RunLog(path) as log:
        log.begin(30)
        log.add(piece(events=[trial_event(0.0)]))
        write = log.file.write

        def interrupted(batches):
            write(batches)
            raise KeyboardInterrupt

        with monkeypatch.context() as patched:
            patched.setattr(log.file, "write", interrupted)
            with pytest.raises(KeyboardInterrupt):
                log.add(piece(0.1))
        log.add(piece(0.2))
        log.keep(recording)
    assert [bits(one) for one in read_log(path).recordings] == [bits(recording)]


def test_a_log_that_is_closed_says_so(path):
    with RunLog(path) as log:
        pass
    log.close()
    with pytest.raises(OutputError, match=r"cannot write the recording '.*recording.mcap': it is closed"):
        log.add(piece())


def test_a_write_that_ctrl_c_cut_short_is_overwritten(path):
    with RunLog(path) as log:
        log.keep(piece())
        log.file._file.write(b"\6 half a chunk")  # what is left where a write does not come to its end
        log.keep(piece(1.0))
    content = read_log(path)
    assert content.closed
    assert len(content.recordings) == 2


# --- gone on with


def test_a_log_is_gone_on_with_behind_its_last_recording(path):
    kept = write_run(path, close=False)
    content = path.read_bytes()
    path.write_bytes(content[: int(0.8 * len(content))])
    before = read_log(path)
    assert len(before.recordings) == 2
    log, found = resume_log(path, repeats=True)
    assert [bits(recording) for recording in found.recordings] == [bits(recording) for recording in kept[:2]]
    again = read_log(path)  # while it is written
    assert [bits(recording) for recording in again.recordings] == [bits(recording) for recording in kept[:2]]
    assert len(again.plays) == len(before.complete_plays) == 5
    log.begin(10)
    log.add(piece(9.0, events=[trial_event(9.0)]))
    log.keep(piece(9.0, events=[trial_event(9.0)]))
    log.close()
    content = read_log(path)
    assert content.closed
    assert [play.trial for play in content.plays] == [None, 0, 0, 1, 1, 2]
    assert [file.name for file in path.parent.iterdir()] == [path.name]


def test_a_log_that_was_closed_is_gone_on_with_too(path):
    kept = write_run(path)
    log, _ = resume_log(path, repeats=True)
    log.keep(piece(9.0))
    log.close()
    content = read_log(path)
    assert [bits(recording) for recording in content.recordings] == [bits(one) for one in (*kept, piece(9.0))]
    assert [play.trial for play in content.plays] == [None, 0, 0, 1, 1, 2, 2, 3]  # what was played behind them is not


def test_what_will_not_be_repeated_stays_and_belongs_to_nothing(path):
    log = RunLog(path)
    log.keep(piece(events=[trial_event(0.0)]))
    log.begin(10)
    log.add(piece(1.0, events=[trial_event(1.0)]))
    killed(log)
    for time in (2.0, 0.5):  # killed twice, before the next trial is complete; the clock began anew
        log, content = resume_log(path, repeats=False)
        log.begin(10)
        log.add(piece(time, events=[trial_event(time)]))
        killed(log)
        assert len(content.recordings) == 1
    log, _ = resume_log(path, repeats=False)
    log.begin(10)
    log.add(piece(4.0, events=[trial_event(4.0)]))
    log.keep(piece(4.0, events=[trial_event(4.0)]))
    log.close()
    content = read_log(path)
    assert [play.recording.joints.time[0] for play in content.plays] == [0.0, 1.0, 2.0, 0.5, 4.0]
    assert [play.trial for play in content.plays] == [0, None, None, None, 1]
    assert content.unfinished is None


def test_a_log_that_another_process_writes_is_left_alone(path):
    with RunLog(path) as log:
        log.add(piece())
        with pytest.raises(OutputError, match="is being written by another process; end that first"):
            resume_log(path, repeats=True)
        log.keep(piece())
    assert len(read_log(path).recordings) == 1


def test_a_log_that_cannot_be_copied_stays_as_it_is(path, monkeypatch):
    monkeypatch.setattr(
        "equipoise.recording.mcap_writer.replaceable", lambda *_: None
    )  # a device stands for a full disk
    write_run(path)
    before = path.read_bytes()
    path.with_suffix(".partial").symlink_to("/dev/full")
    with pytest.raises(OutputError, match="No space left on device"):
        resume_log(path, repeats=True)
    assert path.read_bytes() == before


@pytest.mark.parametrize("content", [None, b"other"])
def test_what_is_no_log_cannot_be_gone_on_with(path, content):
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(RecordingError, match=r"cannot be read: (No such file|it is no MCAP)"):
        resume_log(path, repeats=True)
    assert not path.with_suffix(".partial").exists()
