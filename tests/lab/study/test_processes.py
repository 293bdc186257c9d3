"""Processes that work, answer, err and die."""

import multiprocessing
import os
import signal
import threading
from concurrent.futures import BrokenExecutor, CancelledError
from multiprocessing.connection import Connection

import pytest

from equipoise.lab.study.processes import Processes


@pytest.fixture
def processes():
    with Processes(2) as processes:
        yield processes
    assert not multiprocessing.active_children()


class LockedError(Exception):
    """Does not go through a pipe."""

    def __init__(self):
        super().__init__("locked")
        self.lock = threading.Lock()


class PeculiarError(Exception):
    """Goes into a pipe, and does not come out of it."""

    def __init__(self, first, second):
        super().__init__(f"{first} {second}")


def erring(kind, *arguments):
    raise kind(*arguments)


def half_an_answer():
    """The process is killed while it writes."""

    def half(connection, data):
        os.write(connection.fileno(), bytes(data)[: len(data) // 2])
        os._exit(1)

    Connection._send = half
    return bytes(1000)


def test_they_answer(processes):
    assert sorted(processes.map(divmod, range(30, 40), [7] * 10)) == sorted(divmod(n, 7) for n in range(30, 40))
    assert os.getpid() not in {processes.submit(os.getpid).result() for _ in range(4)}
    assert len(processes.submit(bytes, 10_000_000).result()) == 10_000_000
    assert processes.submit(int, "12", base=3).result() == 5


@pytest.mark.parametrize(
    ("kind", "arguments", "told", "words"),
    [
        (KeyError, ("a",), KeyError, "a"),
        (LockedError, (), RuntimeError, "LockedError"),
        (PeculiarError, (1, 2), TypeError, "second"),
    ],
)
def test_an_error_comes_to_its_caller_and_the_process_goes_on(processes, kind, arguments, told, words):
    with pytest.raises(told, match=words):
        processes.submit(erring, kind, *arguments).result()
    assert [processes.submit(abs, -n).result() for n in range(4)] == [0, 1, 2, 3]


@pytest.mark.parametrize("dying", [(os._exit, 1), (os.abort,), (half_an_answer,)])
def test_one_that_dies_breaks_them_all_whatever_it_was_doing(processes, dying):
    with pytest.raises(BrokenExecutor, match="died"):
        processes.submit(*dying).result(timeout=30)
    with pytest.raises(BrokenExecutor, match="died"):
        processes.submit(abs, 1).result(timeout=30)


def test_what_waits_when_one_dies_fails_with_it(processes):
    first, *others = [processes.submit(os._exit, 1), *(processes.submit(abs, n) for n in range(300))]
    assert isinstance(first.exception(timeout=30), BrokenExecutor)
    assert {type(future.exception(timeout=30)) for future in others} <= {type(None), BrokenExecutor}


def test_what_has_not_begun_can_be_cancelled():
    processes = Processes(1)
    futures = [processes.submit(abs, n) for n in range(1000)]
    processes.shutdown(cancel_futures=True)
    assert all(future.done() for future in futures)
    with pytest.raises(CancelledError):
        futures[-1].result()
    with pytest.raises(RuntimeError, match="after shutdown"):
        processes.submit(abs, 1)
    processes.shutdown()
    assert not multiprocessing.active_children()


@pytest.mark.parametrize("handler", [signal.SIG_IGN, signal.default_int_handler], ids=["ignored", "default"])
def test_ctrl_c_ends_a_worker_unless_the_parent_ignores_it(handler):
    before = signal.signal(signal.SIGINT, handler)
    try:
        with Processes(1) as processes:
            expected = signal.SIG_IGN if handler is signal.SIG_IGN else signal.SIG_DFL
            assert processes.submit(signal.getsignal, signal.SIGINT).result() == expected
    finally:
        signal.signal(signal.SIGINT, before)
