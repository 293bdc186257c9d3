"""Processes of this machine as an executor that hears of each one's death, whatever it was doing."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import queue
import signal
import threading
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import suppress
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from typing import Any, ParamSpec, TypeVar

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")
_Task = tuple["Future[Any]", bytes]


class Processes(Executor):
    """Fresh processes, which die with this one. They begin at once, each with a pipe, and here a thread, of its own.

    Those of `ProcessPoolExecutor` share one pipe. One that is killed while it answers, for memory say, leaves half an answer
    there, and for the other half the caller waits without end. Here it breaks the executor as at any other time: what is not
    done fails with BrokenExecutor, and the processes end.

    Args:
        count: number of processes.
    """

    def __init__(self, count: int) -> None:
        self._tasks: queue.SimpleQueue[_Task | None] = queue.SimpleQueue()
        self._broken = self._shut = False
        self._processes: list[SpawnProcess] = []
        self._threads: list[threading.Thread] = []
        context = multiprocessing.get_context(
            "spawn"
        )  # forked ones have BLAS's and MuJoCo's threads in whatever state they are
        for _ in range(count):
            here, there = context.Pipe()
            process = context.Process(target=_serve, args=(there,), daemon=True)
            process.start()
            there.close()  # now the process alone holds it, and its death ends the pipe
            thread = threading.Thread(target=self._tend, args=(process, here), daemon=True)
            self._processes.append(process)
            self._threads.append(thread)
            thread.start()

    def submit(
        self, fn: Callable[Arguments, Result], /, *args: Arguments.args, **kwargs: Arguments.kwargs
    ) -> Future[Result]:
        """As `Executor.submit`; raises BrokenExecutor once a process has died."""
        if self._shut:
            raise RuntimeError("nothing can be submitted after shutdown")
        if self._broken:
            raise BrokenExecutor("a process died")
        future: Future[Result] = Future()
        self._tasks.put((future, pickle.dumps((fn, args, kwargs))))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """As `Executor.shutdown`."""
        self._shut = True
        with suppress(queue.Empty):
            while cancel_futures:
                if (task := self._tasks.get_nowait()) is not None:
                    task[0].cancel()
        for _ in self._threads:
            self._tasks.put(None)
        for thread in self._threads if wait else ():
            thread.join()

    def _tend(self, process: SpawnProcess, connection: Connection[Any, Any]) -> None:
        """Give a process one task after another."""
        while (task := self._tasks.get()) is not None:
            future, call = task
            if not future.set_running_or_notify_cancel():
                continue
            try:
                connection.send_bytes(call)
                result, error = connection.recv()
            except (EOFError, OSError):
                self._break()
                future.set_exception(BrokenExecutor("a process died"))
            except Exception as unread:
                future.set_exception(unread)
            else:
                if error is None:
                    future.set_result(result)
                else:
                    future.set_exception(error)
        connection.close()
        process.join()

    def _break(self) -> None:
        self._broken = True
        for process in self._processes:
            process.kill()


def _serve(connection: Connection[Any, Any]) -> None:
    """Of a process: answer one task after another, with a result or an error, until the pipe ends."""
    _begin()
    with suppress(EOFError):
        while True:
            call = connection.recv_bytes()
            try:
                function, arguments, named = pickle.loads(call)
                answer = pickle.dumps((function(*arguments, **named), None))
            except Exception as error:
                answer = _told(error)
            connection.send_bytes(answer)


def _told(error: Exception) -> bytes:
    try:
        return pickle.dumps((None, error))
    except Exception:
        return pickle.dumps((None, RuntimeError(repr(error))))


def _begin() -> None:
    if (
        signal.getsignal(signal.SIGINT) is not signal.SIG_IGN
    ):  # a shell's background job ignores Ctrl-C, and so do its workers
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C ends a worker at once and without a traceback
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    parent = multiprocessing.parent_process()
    if parent is not None:

        def follow() -> None:
            parent.join()
            os._exit(1)

        threading.Thread(target=follow, daemon=True).start()
