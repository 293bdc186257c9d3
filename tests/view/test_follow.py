"""Reader of logs that another process writes."""

import shutil
import subprocess
import sys
import time

import numpy as np
import pytest
from logs import kill

from equipoise.errors import RecordingError
from equipoise.recording.recording import Recording
from equipoise.recording.run_log import RunLog, resume_log
from equipoise.recording.run_log_reader import read_log
from equipoise.view.follow import follow

WRITER = """
import sys, time
from pathlib import Path
from equipoise.recording.run_log import RunLog
from equipoise.recording.run_log_reader import read_log
source, target, seen = map(Path, sys.argv[1:])
content = read_log(source)
with RunLog(target) as log:
    for play in content.plays:
        log.begin(play.commands, play.trial)
        middle = play.recording.joints.time[len(play.recording.joints.time) // 2]
        for number, part in enumerate((play.recording.between(-1, middle), play.recording.between(middle, 1e6))):
            log.add(part)
            end = time.monotonic() + 20
            while number and not seen.exists() and time.monotonic() < end:  # however slowly it is read
                time.sleep(0.002)
        for recording in content.recordings:
            if play.trial == recording.trial_id:
                log.keep(recording)
"""


@pytest.fixture(scope="module")
def log(ideal_motions, tmp_path_factory):
    """Return a log of a stance motion and a lift, in pieces."""
    path = tmp_path_factory.mktemp("log") / "recording_0.mcap"
    with RunLog(path) as log:
        for recording in (ideal_motions.move, ideal_motions.lift):
            log.keep(recording)
    return path


def test_a_log_is_followed_while_another_process_writes_it(log, tmp_path):
    target, seen = tmp_path / "growing.mcap", tmp_path / "seen"
    end = time.monotonic() + 40
    source = follow(target, lambda: time.monotonic() < end)
    assert tuple(next(source)) == ([], []), "it does not exist yet"
    writer = subprocess.Popen([sys.executable, "-c", WRITER, str(log), str(target), str(seen)])
    pieces, recordings, looks = [], [], 0
    for new_pieces, new_recordings in source:
        pieces, recordings = [*pieces, *new_pieces], [*recordings, *new_recordings]
        looks += bool(new_pieces)
        if looks:
            seen.touch()
        time.sleep(0.005)
    assert writer.wait(timeout=10) == 0
    assert looks > 1, "it was read while it was written"
    expected = read_log(log).recordings
    assert len(recordings) == len(expected) == 2
    assert all(one.equals(other) for one, other in zip(recordings, expected, strict=True))
    assert Recording.concatenate(pieces).equals(Recording.concatenate(expected))


def test_a_truncated_log_yields_complete_messages_then_the_rest(log, tmp_path):
    data, target = log.read_bytes(), tmp_path / "cut.mcap"
    source, samples = follow(target, lambda: True), 0
    for end in np.linspace(3, len(data), 40).astype(int):
        target.write_bytes(data[:end])  # the same file, longer: its number stays
        pieces, _ = next(source)
        samples += sum(len(piece.joints.time) for piece in pieces)
    assert samples == sum(len(recording.joints.time) for recording in read_log(log).recordings)
    assert next(source, None) is None, "it was closed"


def test_a_resumed_run_is_read_without_repeated_motions(log, tmp_path):
    shutil.copy(log, tmp_path / "recording_0.mcap")
    lift = read_log(log).recordings[1]
    assert [tuple(map(len, news)) for news in follow(tmp_path, lambda: True)] == [(2, 2)], "it was closed"
    old = follow(tmp_path, lambda: True)
    assert tuple(map(len, next(old))) == (2, 2)
    first, _ = resume_log(tmp_path, repeats=True)
    first.begin(10, 1)
    first.add(lift.between(-1, 1e6))
    with pytest.raises(RecordingError, match="was resumed"):
        next(old)
    source = follow(tmp_path, lambda: True)
    pieces, recordings = next(source)
    assert (len(pieces), len(recordings)) == (2, 2), "the last piece may still grow"
    kill(first)
    second, _ = resume_log(tmp_path, repeats=True)
    with pytest.raises(RecordingError) as error:
        next(source)
    assert str(error.value) == f"the run {str(tmp_path)!r} was resumed; start the view again"
    second.keep(lift)
    second.close()
    ((pieces, recordings),) = follow(tmp_path, lambda: True)
    assert [one.equals(lift) for one in recordings] == [False, True, True]
    assert len(pieces) == 3


def test_a_log_that_is_not_followed_is_read_once(log, tmp_path):
    data = log.read_bytes()
    (cut := tmp_path / "recording_0.mcap").write_bytes(data[: len(data) // 2])
    ((pieces, _),) = follow(cut, lambda: False)
    assert pieces
    open_log = follow(cut, lambda: True)
    next(open_log)
    assert next(open_log, None) is not None


def test_a_file_that_is_not_a_log_raises(tmp_path):
    (path := tmp_path / "x.mcap").write_bytes(b"not at all")
    with pytest.raises(RecordingError) as error:
        next(follow(path, lambda: False))
    assert str(error.value) == f"the recording {str(path)!r} cannot be read: it is not an MCAP file"
