"""Processes that work, answer, err and die."""

import multiprocessing
import os
import signal
import threading
import time
from concurrent.futures import CancelledError
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


def dying_once(folder):
    """The process dies, but not the second one."""
    (folder / str(os.getpid())).touch()
    if len(list(folder.iterdir())) == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return os.getpid()


def test_they_answer(processes):
    assert sorted(processes.map(divmod, range(30, 40), [7] * 10)) == sorted(divmod(n, 7) for n in range(30, 40))
    assert os.getpid() not in {processes.submit(os.getpid).result() for _ in range(4)}
    assert len(processes.submit(bytes, 10_000_000).result()) == 10_000_000
    assert processes.submit(int, "12", base=3).result() == 5


@pytest.mark.parametrize(
    ("kind", "arguments", "told", "words"),
    [
        (KeyError, ("a",), KeyError, "a"),
        (EOFError, ("the call's own",), EOFError, "the call's own"),
        (LockedError, (), RuntimeError, "LockedError"),
        (PeculiarError, (1, 2), TypeError, "second"),
    ],
)
def test_an_error_comes_to_its_caller_and_the_process_goes_on(kind, arguments, told, words):
    with Processes(1) as processes:
        before = processes.submit(os.getpid).result()
        with pytest.raises(told, match=words):
            processes.submit(erring, kind, *arguments).result()
        assert processes.submit(os.getpid).result() == before


@pytest.mark.parametrize("dying", [(os._exit, 1), (os.abort,), (half_an_answer,)])
def test_a_call_whose_process_dies_twice_fails_alone_whatever_it_was_doing(processes, dying):
    futures = [processes.submit(*dying), *(processes.submit(abs, -n) for n in range(300))]
    with pytest.raises(ChildProcessError, match="the process that ran it died twice"):
        futures[0].result(timeout=30)
    assert [future.result(timeout=30) for future in futures[1:]] == list(range(300))


def test_a_call_whose_process_dies_once_is_answered_by_another(tmp_path):
    with Processes(1) as processes:
        answer = processes.submit(dying_once, tmp_path).result(timeout=30)
        assert len(os.listdir(tmp_path)) == 2
        assert str(answer) in os.listdir(tmp_path)
        assert processes.submit(os.getpid).result() == answer


def test_a_process_that_dies_between_two_calls_is_replaced_before_the_next(processes, tmp_path):
    for worker in {processes.submit(os.getpid).result() for _ in range(8)}:
        os.kill(worker, signal.SIGKILL)
        os.waitid(os.P_PID, worker, os.WEXITED | os.WNOWAIT)
    assert processes.submit(dying_once, tmp_path).result(timeout=30), "its first try was lost"


def test_what_has_not_begun_can_be_cancelled_and_what_runs_is_ended():
    processes = Processes(1)
    assert processes.submit(abs, -1).result() == 1
    begin = time.monotonic()
    futures = [processes.submit(time.sleep, 60) for _ in range(1000)]
    processes.shutdown(cancel_futures=True)
    assert time.monotonic() - begin < 30
    for future in futures:
        with pytest.raises(CancelledError):
            future.result(timeout=30)
    with pytest.raises(RuntimeError, match="after shutdown"):
        processes.submit(abs, 1)
    assert not multiprocessing.active_children()


def test_what_waits_is_done_before_they_end():
    with Processes(1) as processes:
        futures = [processes.submit(abs, -n) for n in range(20)]
    assert [future.result() for future in futures] == list(range(20))


def test_ctrl_c_reaches_the_caller_alone(processes):
    workers = {processes.submit(os.getpid).result() for _ in range(8)}
    for worker in workers:
        os.kill(worker, signal.SIGINT)
    assert {processes.submit(os.getpid).result() for _ in range(8)} <= workers
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())
