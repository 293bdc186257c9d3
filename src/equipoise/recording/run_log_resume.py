"""A log gone on with."""

from __future__ import annotations

import fcntl
from collections.abc import Generator
from contextlib import contextmanager, suppress
from itertools import groupby
from pathlib import Path

from equipoise.errors import OutputError, RecordingError
from equipoise.recording.run_log import RunLog
from equipoise.recording.run_log_reader import LogContent, Play, read_log
from equipoise.user_file import refuse_unreadable


def resume_log(path: Path, repeats: bool) -> tuple[RunLog, LogContent]:
    """Open a log to go on behind its last complete recording; returns also what it held.

    A copy takes its place in one step: whenever the process is killed, there is a log that can be gone on with.

    Args:
        path: path of the log.
        repeats: whether what was played behind that recording is left out, because it will be played again exactly.

    Raises:
        RecordingError: it cannot be read.
        OutputError: it cannot be written, or another process writes it.
    """
    with _written_by_nobody(path):
        content = read_log(path)
        log = RunLog(path.with_suffix(".partial"))
        try:
            _copy(content, content.complete_plays if repeats else content.plays, log)
            log.file.move_to(path)
        except BaseException:
            with suppress(OutputError):
                log.close()
            path.with_suffix(".partial").unlink(missing_ok=True)
            raise
    return log, content


def _copy(content: LogContent, plays: tuple[Play, ...], log: RunLog) -> None:
    for trial, its_plays in groupby(plays, lambda play: play.trial):
        for play in its_plays:
            log.begin(play.commands)
            log.add(play.recording)
        if trial is None:
            log.set_aside()
        else:
            log.keep(content.recordings[trial])


@contextmanager
def _written_by_nobody(path: Path) -> Generator[None]:
    try:
        refuse_unreadable(path)
        file = open(path, "rb")  # noqa: SIM115 - closed below
    except OSError as error:
        raise RecordingError(f"the recording {str(path)!r} cannot be read: {error.strerror}") from error
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise OutputError(
                f"the recording {str(path)!r} is being written by another process; end that first"
            ) from error
        except OSError:
            pass  # a file system without locks
        yield
