"""Executor of processes: results, errors and dying processes."""

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
    """Error that cannot be pickled."""

    def __init__(self):
        super().__init__("locked")
        self.lock = threading.Lock()


class PeculiarError(Exception):
    """Error that can be pickled but not unpickled."""

    def __init__(self, first, second):
        super().__init__(f"{first} {second}")


def raising(kind, *arguments):
    raise kind(*arguments)


def half_an_answer():
    """Kill the process while it writes."""

    def half(connection, data):
        os.write(connection.fileno(), bytes(data)[: len(data) // 2])
        os._exit(1)

    Connection._send = half
    return bytes(1000)


def dying_once(folder):
    """Kill the process at the first call only."""
    (folder / str(os.getpid())).touch()
    if len(list(folder.iterdir())) == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return os.getpid()


def test_calls_return_their_results(processes):
    assert sorted(processes.map(divmod, range(30, 40), [7] * 10)) == sorted(divmod(n, 7) for n in range(30, 40))
    assert os.getpid() not in {processes.submit(os.getpid).result() for _ in range(4)}
    assert len(processes.submit(bytes, 10_000_000).result()) == 10_000_000
    assert processes.submit(int, "12", base=3).result() == 5


@pytest.mark.parametrize(
    ("kind", "arguments", "raised", "message"),
    [
        (KeyError, ("a",), KeyError, "a"),
        (EOFError, ("the call's own",), EOFError, "the call's own"),
        (LockedError, (), RuntimeError, "LockedError"),
        (PeculiarError, (1, 2), TypeError, "second"),
    ],
)
def test_an_error_reaches_its_caller_and_the_process_lives_on(kind, arguments, raised, message):
    with Processes(1) as processes:
        before = processes.submit(os.getpid).result()
        with pytest.raises(raised, match=message):
            processes.submit(raising, kind, *arguments).result()
        assert processes.submit(os.getpid).result() == before


@pytest.mark.parametrize("dying", [(os._exit, 1), (os.abort,), (half_an_answer,)])
def test_only_the_call_whose_process_dies_twice_fails(processes, dying):
    futures = [processes.submit(*dying), *(processes.submit(abs, -n) for n in range(300))]
    with pytest.raises(ChildProcessError, match="its worker process died twice"):
        futures[0].result(timeout=30)
    assert [future.result(timeout=30) for future in futures[1:]] == list(range(300))


def test_a_call_whose_process_dies_once_is_repeated_in_another(tmp_path):
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


def test_shutdown_cancels_waiting_calls_and_ends_running_ones():
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


def test_waiting_calls_finish_before_the_processes_end():
    with Processes(1) as processes:
        futures = [processes.submit(abs, -n) for n in range(20)]
    assert [future.result() for future in futures] == list(range(20))


def test_ctrl_c_reaches_only_the_caller(processes):
    workers = {processes.submit(os.getpid).result() for _ in range(8)}
    for worker in workers:
        os.kill(worker, signal.SIGINT)
    assert {processes.submit(os.getpid).result() for _ in range(8)} <= workers
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())
