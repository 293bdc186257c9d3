"""A log that another process writes: real processes, real signals; nothing that was handed over is lost."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from logs import bits, piece, trial_event, write_run

import equipoise
from equipoise.errors import OutputError
from equipoise.recording import writer_process
from equipoise.recording.recording import Recording
from equipoise.recording.run_log import RunLog
from equipoise.recording.run_log_reader import read_log
from equipoise.recording.run_log_resume import resume_log

PLACES = [str(Path(equipoise.__file__).parents[1]), str(Path(__file__).parents[1])]
ENVIRONMENT = {**os.environ, "PYTHONPATH": os.pathsep.join(PLACES)}
BEGIN = (
    "import os, resource, signal, sys; from pathlib import Path; from logs import piece\n"
    "from equipoise.recording.run_log import RunLog\n"
    "log = RunLog(Path(sys.argv[1])); log.write_beside(); log.begin(99)\n"
)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "recording.mcap"


def written(path, meddle=lambda log, count: None, beside=True):
    """The bytes of a log of two trials; `meddle` is called before each of its pieces."""
    log = RunLog(path)
    if beside:
        log.write_beside()
    for trial in range(2):
        pieces = [piece(trial + 0.1 * k, events=[trial_event(trial)] if k == 0 else ()) for k in range(4)]
        log.begin(99)
        for count, one in enumerate(pieces):
            meddle(log, 4 * trial + count)
            log.add(one)
        log.keep(Recording.concatenate(pieces))
    log.close()
    return path.read_bytes()


def run(script, path, **options):
    return subprocess.run(
        [sys.executable, "-c", BEGIN + script, str(path)], env=ENVIRONMENT, check=False, capture_output=True, text=True,
        **options,
    )  # fmt: skip


def closed_log(path):
    """What is in a log once somebody else has closed it."""
    until = time.monotonic() + 30.0
    while not (log := read_log(path)).closed:
        assert time.monotonic() < until
        time.sleep(0.02)
    return log


def test_the_file_is_the_same_whoever_writes_it(tmp_path):
    here, beside = tmp_path / "here.mcap", tmp_path / "beside.mcap"
    assert written(here, beside=False) == written(beside)
    assert len(read_log(beside).recordings) == 2


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP], ids=lambda number: number.name)
@pytest.mark.parametrize("when", [0, 5])
def test_a_writer_that_dies_or_hangs_costs_nothing(tmp_path, number, when):
    found = []

    def meddle(log, count):
        if count == when:
            found.append(log._beside.pid)
            os.kill(found[0], number)

    here, beside = tmp_path / "here.mcap", tmp_path / "beside.mcap"
    assert written(beside, meddle) == written(here, beside=False)
    with pytest.raises(ProcessLookupError):
        os.kill(found[0], 0)  # it must not wake up and write


def test_a_writer_that_cannot_begin_leaves_the_work_here(tmp_path, monkeypatch):
    monkeypatch.setattr(writer_process.sys, "executable", "/bin/false")
    log = RunLog(tmp_path / "recording.mcap")
    log.write_beside()
    log.keep(piece())
    log.close()
    assert log.file.message_counts["/joint_states"] == 10
    assert read_log(tmp_path / "recording.mcap").closed


def test_of_a_program_that_is_killed_every_piece_is_there_and_the_file_is_closed(path):
    script = "for count in range(50): log.add(piece(0.1 * count))\nos.kill(os.getpid(), signal.SIGKILL)\n"
    assert run(script, path).returncode == -9
    assert [len(play.recording.joints.time) for play in closed_log(path).plays] == [500]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP], ids=lambda number: number.name)
def test_a_signal_to_the_program_and_all_that_it_started_does_not_end_the_writer(path, number):
    script = (
        "pid = log._beside.pid\n"
        f"for n in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP): signal.signal(n, signal.SIG_IGN)\n"
        f"log.add(piece(0.0)); os.killpg(os.getpgid(0), {int(number)}); os.kill(pid, {int(number)})\n"
        "log.add(piece(0.1)); assert log._beside.pid == pid; log.close()\n"
    )
    done = run(script, path, start_new_session=True)
    assert done.returncode == 0, done.stderr
    assert [len(play.recording.joints.time) for play in read_log(path).plays] == [20]


def test_a_full_disk_is_told_here(path):
    script = (
        "kept = 0\n"
        "limit = os.fstat(log.file.descriptor).st_size + 20000\n"
        "resource.prlimit(log._beside.pid, resource.RLIMIT_FSIZE, (limit, limit))\n"
        "from equipoise.errors import OutputError\n"
        "try:\n"
        "    while True: log.add(piece(0.1 * kept)); kept += 1\n"
        "except OutputError as error: print(kept, error)\n"
        "log.close()\n"
    )
    done = run(script, path)
    kept, told = done.stdout.strip().split(" ", 1)
    assert told.startswith(f"cannot write the recording {str(path)!r}: File too large; ")
    assert [len(play.recording.joints.time) for play in read_log(path).plays] == [10 * int(kept)]
    assert read_log(path).closed


def test_a_log_that_is_gone_on_with_can_be_written_beside(path):
    write_run(path, close=False)
    log, content = resume_log(path, repeats=True)
    log.write_beside()
    last = piece(9.0, events=[trial_event(9.0)])
    log.keep(last)
    log.close()
    recordings = read_log(path).recordings
    assert [bits(recording) for recording in recordings] == [bits(one) for one in (*content.recordings, last)]


def test_what_is_closed_is_not_written(path):
    log = RunLog(path)
    log.write_beside()
    log.close()
    log.close()
    with pytest.raises(OutputError, match="it is closed"):
        log.add(piece())
