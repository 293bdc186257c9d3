"""Executor with processes on this machine, which replaces processes that die."""

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
    """Executor with threads that run their calls in a process each. The processes end with this one.

    If a process dies, its call is repeated once in a new process, and raises ChildProcessError if that one dies too.
    Other calls are not affected. `ProcessPoolExecutor` fails all calls instead, and waits forever if a process is killed
    while it writes into their shared pipe.

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
        """Submit a call as in `Executor.submit`."""
        return super().submit(self._answer, pickle.dumps((fn, args, kwargs)))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Shut down as in `Executor.shutdown`; `cancel_futures` also ends running calls."""
        if cancel_futures:
            self._end_processes()
        super().shutdown(wait, cancel_futures=cancel_futures)
        if wait:
            self._end_processes()

    def _end_processes(self) -> None:
        self._ended = True
        for process in self._processes:  # kill all before a second Ctrl-C can interrupt this
            process.kill()
        for process in self._processes:
            process.join()

    def _begin_thread(self) -> None:
        """Block Ctrl-C in a thread and its processes, which the main thread ends."""
        self._thread.pipe = None
        resource_tracker.ensure_running()  # its start by the first process would unblock Ctrl-C
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})

    def _answer(self, call: bytes) -> Any:
        """Run a call in the process of this thread; return its result or raise its error."""
        for _ in range(2):
            if self._ended:
                raise CancelledError
            if self._thread.pipe is None or self._thread.pipe.poll():  # only its end is readable before a call
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
        raise ChildProcessError("its worker process died twice")

    def _begin_process(self) -> Connection[Any, Any]:
        """Return the pipe to a new process; raises EquipoiseError if it does not start."""
        for _ in range(2):
            pipe, its_end = _SPAWN.Pipe()
            with suppress(EOFError, OSError, RuntimeError):
                process = _SPAWN.Process(target=_serve, args=(its_end,), daemon=True)
                process.start()  # RuntimeError in a starting process of a script without the __main__ guard
                its_end.close()  # only the process has it now, so that its death ends the pipe
                self._processes.append(process)
                if self._ended:
                    process.kill()
                pipe.recv_bytes()
                return pipe
        raise EquipoiseError(
            "worker processes die at their start; check the free memory. A script must run a study below "
            'if __name__ == "__main__":',
            exit_code=9,
        )


def _serve(pipe: Connection[Any, Any]) -> None:
    """Answer the calls from a pipe with results or errors until it ends."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError, OSError):  # EOFError of reading, OSError of writing
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
