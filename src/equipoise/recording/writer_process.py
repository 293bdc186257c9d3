"""A process that encodes, compresses and writes the log of a run: whoever moves a robot waits for none of it.

It has the file's open descriptor, and so the lock on the file, and takes one request after the other from a pipe; each is
answered with how far the file is. So both sides can go on with it at any time:

- The writer dies, is stopped or does not answer: this side ends it and writes, from the last answer on, what was not answered.
- This side dies: the pipe ends, and the writer closes the file behind the last whole request, with an index. That is also how
  a log is closed.

Ctrl-C, SIGTERM and a terminal that is closed are this side's alone.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import select
import signal
import subprocess
import sys
from typing import Any

from equipoise.errors import OutputError
from equipoise.recording.log_messages import Entries, write_messages
from equipoise.recording.mcap_writer import McapWriter
from equipoise.recording.recording import Recording

_PATIENCE = 1.0  # [s] with an answer, less than the guard's with a disk
_STARTS, _ENDS = 20.0, 5.0  # [s] on a busy computer


class WriterProcess:
    """This side of it. One thread at a time has something written.

    Args:
        file: file to be written by the process; it stays open here, too.
    """

    def __init__(self, file: McapWriter) -> None:
        self._file = file
        self._process: subprocess.Popen[bytes] | None = None
        with contextlib.suppress(OSError):  # no memory for it: this side writes
            self._process = subprocess.Popen(
                [sys.executable, "-m", "equipoise.recording.writer_process"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                bufsize=0,
                pass_fds=(file.descriptor,),
                start_new_session=True,  # Ctrl-C is for the program, which has more to write then
            )
        if self._process is not None and self._process.stdin is not None:  # one that hangs must not keep whoever writes
            os.set_blocking(self._process.stdin.fileno(), False)
        self._ask((file.descriptor, file.path, file.topics, file.progress()), _STARTS)

    @property
    def pid(self) -> int | None:
        """Number of the process; None once this side writes."""
        return None if self._process is None else self._process.pid

    def write(self, file: McapWriter, entries: Entries, time: int | None, piece: Recording | None = None) -> None:
        """As `write_messages`."""
        if not self._ask((entries, time, piece), _PATIENCE):
            write_messages(file, entries, time, piece)

    def close(self) -> None:
        """Have the file closed. What the process did not do is left to do: the file is open here then."""
        if self._process is not None and self._end(_ENDS) == 0:
            self._file.abandon()

    def _ask(self, request: Any, patience: float) -> bool:
        """Have a request done; returns whether it was, and raises OutputError if the file cannot be written."""
        if self._process is None:
            return False
        try:
            progress, trouble = self._answer(self._process, pickle.dumps(request, pickle.HIGHEST_PROTOCOL), patience)
            self._file.go_on_from(progress)
        except (OSError, EOFError, pickle.UnpicklingError):
            self._end(0.0)
            return False
        except BaseException:  # Ctrl-C: nobody knows how much of it is written
            self._end(0.0)
            raise
        if trouble is not None:
            raise OutputError(trouble)
        return True

    @staticmethod
    def _answer(process: subprocess.Popen[bytes], data: bytes, patience: float) -> Any:
        assert process.stdin is not None
        assert process.stdout is not None
        rest = memoryview(data)
        while rest:
            if not select.select([], [process.stdin], [], patience)[1]:
                raise TimeoutError
            rest = rest[os.write(process.stdin.fileno(), rest) :]
        if not select.select([process.stdout], [], [], patience)[0]:
            raise TimeoutError
        return pickle.load(process.stdout)

    def _end(self, patience: float) -> int:
        """End the process: it must not write beside this side. Returns how it ended, zero if it closed the file."""
        process, self._process = self._process, None
        assert process is not None
        if not patience:
            process.kill()  # before the pipe ends, at which it would close the file
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                with contextlib.suppress(OSError):
                    pipe.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            return process.wait(patience or _ENDS)
        process.kill()
        try:
            return process.wait(_ENDS)
        except subprocess.TimeoutExpired as error:
            raise OutputError(
                f"the recording {str(self._file.path)!r} is not written: its disk does not answer; is it on a network that "
                "is gone?"
            ) from error


def main() -> int:
    """The other side; ends with 0 once the file is closed."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    descriptor, path, topics, progress = pickle.load(sys.stdin.buffer)
    file = McapWriter.of_descriptor(descriptor, path, topics, progress)
    known, trouble = len(progress.chunks), None
    while True:
        with contextlib.suppress(OSError):  # nobody listens any more: what was asked for is done all the same
            os.write(sys.stdout.fileno(), pickle.dumps((file.progress(known), trouble)))
        try:
            request = pickle.load(sys.stdin.buffer)
        except (EOFError, pickle.UnpicklingError):  # the other side is done, or gone in the middle of a request
            break
        known, trouble = len(file.progress().chunks), None
        try:
            write_messages(file, *request)
        except OutputError as error:
            trouble = str(error)
    file.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
