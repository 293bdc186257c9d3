"""Log of a run, written during the run: all motions that were played, and the parts that are recordings.

`log_messages` describes its content. A run's log is a folder with a file for each time that the run was begun or resumed.
"""

from __future__ import annotations

import fcntl
import json
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

from mcap.writer import Writer

from equipoise._version import __version__
from equipoise.errors import OutputError
from equipoise.recording.log_messages import FORMAT, LOG, TYPES, messages_of, piece_entry
from equipoise.recording.mcap_reader import finish, opened
from equipoise.recording.messages import DEFINITIONS, text_message
from equipoise.recording.recording import Recording
from equipoise.recording.run_log_reader import LogContent, log_file, log_files, read_log
from equipoise.user_file import partial_path, replaceable

_ROOM = 1 << 24  # bytes that wait in memory while the disk is full; they are written first once it is not


class RunLog(AbstractContextManager["RunLog"]):
    """Writer of one file of a log. Use it as a context manager, or close it.

    A motion is announced by `begin` and written by `add`, whole or piece by piece; `keep` makes a recording of the motions of
    its trial. Once `add` or `keep` has returned, its data survive the end of the process.

    Ctrl-C never interrupts a write, after which the library could not continue: it interrupts only the main thread, and the
    log's own thread writes while the caller waits.

    Attributes:
        path: path of the file.
        empty: whether no motion of the run has been written yet, to this file or to one before it.

    Raises:
        OutputError: the file exists or cannot be written; also by every method. Files before it are still readable.
    """

    def __init__(self, path: Path, resumed: int | None = None) -> None:
        """Open a new file.

        Args:
            resumed: number of plays in the files before this one that still count; None: this file is the first.
        """
        self.path = path
        with _output_errors(path):
            self._file = open(path, "xb", buffering=_ROOM)  # noqa: SIM115 - closed by `close`
            _lock(self._file, path)
        self._worker = ThreadPoolExecutor(1, "recording")
        self._writer = Writer(self._file)
        self._writer.start("ros2", f"equipoise {__version__}")
        schemas = {
            kind: self._writer.register_schema(kind, "ros2msg", definition.encode())
            for kind, definition in DEFINITIONS.items()
        }
        about = {"offered_qos_profiles": "", "format": FORMAT}
        self._channels = {
            topic: self._writer.register_channel(topic, "cdr", schemas[kind], about) for topic, kind in TYPES.items()
        }
        self._begun: dict[str, Any] | None = _play(0, None)  # entry of the present play, until it is written
        self._trials: set[int | None] = set()  # of the plays since a recording was kept
        self._time = 0  # of the last message [ns]
        self.empty = not resumed
        self._do(self._put, [] if resumed is None else [{"entry": "resumed", "plays": resumed}])

    def begin(self, commands: int, trial: int | None = None) -> None:
        """Begin a motion; the pieces that are added until the next call are parts of it.

        Args:
            commands: number of its commands.
            trial: id of the trial that it is a part of.
        """
        self._begun = _play(commands, trial)

    def add(self, piece: Recording) -> None:
        """Write the samples that were just played: a whole motion, or its next piece."""
        self._do(self._add, piece)

    def keep(self, recording: Recording) -> None:
        """Make a recording of the plays of its trial. If there are none, the recording is added as one play."""
        self._do(self._keep, recording)

    def close(self) -> None:
        """Write the index at the end. May be called twice."""
        if not self._file.closed:
            try:
                self._do(self._close)
            finally:
                self._worker.shutdown()

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _do(self, write: Callable[..., None], *arguments: object) -> None:
        """Run a function in the log's own thread, and wait for it."""
        if self._file.closed:
            raise OutputError(f"cannot write the recording {str(self.path)!r}: it is closed")
        with _output_errors(self.path):
            self._worker.submit(write, *arguments).result()

    def _add(self, piece: Recording) -> None:
        entries, self._begun = [entry for entry in (self._begun, piece_entry(piece)) if entry is not None], None
        self._trials.update(entry["trial"] for entry in entries if entry["entry"] == "play")
        self.empty = False
        self._put(entries, messages_of(piece))

    def _keep(self, recording: Recording) -> None:
        trial = recording.trial_id
        if trial is None or trial not in self._trials:
            self._begun = _play(0 if recording.commands is None else len(recording.commands.time), trial)
            self._add(recording)
        self._begun = _play(0, None)
        self._trials.clear()
        self._put([{"entry": "kept", "trial": trial, "broken": recording.broken}])

    def _put(self, entries: list[dict[str, Any]], messages: Iterable[tuple[int, str, bytes]] = ()) -> None:
        """Write entries and the messages after them, in order of time; an entry has the time of the message after it."""
        ordered = sorted(messages, key=lambda message: message[0])
        if ordered:
            self._time = ordered[0][0]
        for entry in entries:
            self._writer.add_message(self._channels[LOG], self._time, text_message(json.dumps(entry)), self._time)
        for time, topic, body in ordered:
            self._writer.add_message(self._channels[topic], time, body, time)
            self._time = time
        self._writer.flush()

    def _close(self) -> None:
        with self._file:
            self._writer.finish()


def resume_log(folder: Path, repeats: bool) -> tuple[RunLog, LogContent]:
    """Open a new file of a log, to continue it after its last complete recording; return also the log's content.

    Args:
        folder: folder of the log.
        repeats: whether motions after that recording are left out, because it will be played again exactly.

    Raises:
        RecordingError: the log cannot be read.
        OutputError: it cannot be written, or another process writes it.
    """
    files = log_files(folder)
    with opened(files[-1]) as file:
        _lock(file, files[-1])
        content = read_log(folder)
        plays = content.complete_plays if repeats else content.plays
        log = RunLog(log_file(folder, len(files)), len(plays))
        with suppress(OSError):  # equipoise also reads a previous file without an end
            finish(files[-1])
        return log, content


def save_recording(recording: Recording, path: Path) -> None:
    """Write one recording alone; the file appears under its name only when it is complete.

    Raises:
        OutputError: it cannot be written (no permission, disk full).
    """
    partial = partial_path(path)
    try:
        with _output_errors(path):
            replaceable(path, "the recording ")
            with RunLog(partial) as log:
                log.keep(recording)
            partial.replace(path.resolve())  # a link stays one
    except OutputError:
        partial.unlink(missing_ok=True)
        raise


def _play(commands: int, trial: int | None) -> dict[str, Any]:
    return {"entry": "play", "commands": commands, "trial": trial}


def _lock(file: BinaryIO, path: Path) -> None:
    """Lock a file against writing and resuming by other processes; raise OutputError if one holds the lock."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise OutputError(f"the recording {str(path)!r} is being written by another process; end that first") from error
    except OSError:
        pass  # a file system without locks


@contextmanager
def _output_errors(path: Path) -> Generator[None]:
    try:
        yield
    except OSError as error:
        if isinstance(error, OutputError):
            raise
        raise OutputError(
            f"cannot write the recording {str(path)!r}: {error.strerror}; check that the folder "
            "exists, is writable and has free space"
        ) from error
