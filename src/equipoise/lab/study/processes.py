"""An executor of processes on this machine that replaces each one that dies."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import threading
from collections.abc import Callable
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from contextlib import suppress
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from typing import Any, ParamSpec, TypeVar

from equipoise.errors import EquipoiseError

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")
_SPAWN = multiprocessing.get_context("spawn")  # forked processes have BLAS's and MuJoCo's threads in an unknown state


class Processes(ThreadPoolExecutor):
    """Threads, each with a process of its own that runs its calls. The processes end when this one does.

    If a process dies, its call runs once more in a new process, and raises ChildProcessError if that one dies too.
    Other calls are not affected. `ProcessPoolExecutor` fails all calls instead, and it waits forever if a process is
    killed while it writes an answer into the pipe that all of them share.

    Args:
        count: number of processes.
    """

    def __init__(self, count: int) -> None:
        super().__init__(count, initializer=self._begin_thread)
        self._thread = threading.local()
        self._processes: list[SpawnProcess] = []
        self._ended = False

    def submit(
        self, fn: Callable[Arguments, Result], /, *args: Arguments.args, **kwargs: Arguments.kwargs
    ) -> Future[Result]:
        """As `Executor.submit`."""
        return super().submit(self._answer, pickle.dumps((fn, args, kwargs)))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """As `Executor.shutdown`; `cancel_futures` also ends the calls that are running."""
        if cancel_futures:
            self._end_processes()
        super().shutdown(wait, cancel_futures=cancel_futures)
        if wait:
            self._end_processes()

    def _end_processes(self) -> None:
        self._ended = True
        for process in self._processes:  # all of them before a second Ctrl-C can interrupt this
            process.kill()
        for process in self._processes:
            process.join()

    def _begin_thread(self) -> None:
        """Block Ctrl-C in a thread and in the processes that it starts: the main thread ends them."""
        self._thread.pipe = None
        resource_tracker.ensure_running()  # the first process would start it, and starting it unblocks Ctrl-C
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})

    def _answer(self, call: bytes) -> Any:
        """Return or raise what a call does in the process of this thread."""
        for _ in range(2):
            if self._ended:
                raise CancelledError
            if self._thread.pipe is None or self._thread.pipe.poll():  # nothing but its end can be read before a call
                self._thread.pipe = self._begin_process()
            try:
                self._thread.pipe.send_bytes(call)
                answer = self._thread.pipe.recv_bytes()
            except (EOFError, OSError):
                self._thread.pipe = None
                continue
            result, error = pickle.loads(answer)
            if error is not None:
                raise error
            return result
        raise ChildProcessError("the process that ran it died twice")

    def _begin_process(self) -> Connection[Any, Any]:
        """Return the pipe to a new process that has begun; raises EquipoiseError if none begins."""
        for _ in range(2):
            pipe, its_end = _SPAWN.Pipe()
            with suppress(EOFError, OSError, RuntimeError):
                process = _SPAWN.Process(target=_serve, args=(its_end,), daemon=True)
                process.start()  # RuntimeError if this process is itself one that begins, by a script without the guard
                its_end.close()  # now the process alone holds it, and its death ends the pipe
                self._processes.append(process)
                if self._ended:
                    process.kill()
                pipe.recv_bytes()
                return pipe
        raise EquipoiseError(
            "worker processes die as they begin; is there memory for them? A script that runs a study does so below "
            'if __name__ == "__main__":',
            exit_code=9,
        )


def _serve(pipe: Connection[Any, Any]) -> None:
    """Answer the calls that a pipe brings, with a result or an error, until it ends."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError, OSError):  # EOFError where it is read, OSError where it is written
        pipe.send_bytes(b"")
        while True:
            call = pipe.recv_bytes()
            try:
                function, arguments, named = pickle.loads(call)
                answer = pickle.dumps((function(*arguments, **named), None))
            except Exception as error:
                answer = _pickled(error)
            pipe.send_bytes(answer)


def _pickled(error: Exception) -> bytes:
    try:
        return pickle.dumps((None, error))
    except Exception:
        return pickle.dumps((None, RuntimeError(repr(error))))


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
