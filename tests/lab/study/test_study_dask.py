"""Study on a Dask cluster with a scheduler and two workers over TCP, one of them killed."""

import os
import signal
import socket
import subprocess
import sys
import time
import warnings
from importlib import import_module

import pytest
from studies import HERE, STATIC, Inline, alive, eventually, facts, rows_in, start_study, study_rows, wait_for

from equipoise.cli import main
from equipoise.errors import EquipoiseError, MissingDependencyError, SettingsError
from equipoise.lab.study import executors
from equipoise.lab.study.executors import dask_cluster

pytest.importorskip("distributed")
pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals")
TRIALS = 14


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Cluster:
    """Scheduler without workers; `add` starts one."""

    def __init__(self, folder):
        self.folder, self.processes = folder, []
        port = free_port()
        self.address = f"tcp://127.0.0.1:{port}"
        self.log = self._start("scheduler", "--host", "127.0.0.1", "--port", str(port))
        assert eventually(lambda: "Scheduler at" in self.log.read_text(encoding="utf-8")), self.log.read_text()

    def add(self, threads=1):
        place = self.folder / f"worker-{len(self.processes)}"
        before = self._registered()
        self._start("worker", self.address, "--nthreads", str(threads), "--no-nanny", "--local-directory", str(place))
        assert eventually(lambda: self._registered() > before, 40), "the worker does not come"
        return self.processes[-1]

    def _registered(self):
        return self.log.read_text(encoding="utf-8").count("Register worker")

    def _start(self, what, *flags):
        log = self.folder / f"{what}-{len(self.processes)}.log"
        paths = os.pathsep.join([os.environ.get("PYTHONPATH", ""), str(HERE)])
        with log.open("w") as output:
            process = subprocess.Popen(
                [sys.executable, "-m", f"distributed.cli.dask_{what}", "--no-dashboard", *flags],
                stdout=output, stderr=subprocess.STDOUT, start_new_session=True, cwd=self.folder,
                env={**os.environ, "PYTHONPATH": paths},
            )  # fmt: skip
        self.processes.append(process)
        return log

    def stop(self):
        for process in self.processes:
            process.kill()
            process.wait()


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    """Cluster shared by all tests, because it takes seconds to start."""
    running = Cluster(tmp_path_factory.mktemp("cluster"))
    yield running
    running.stop()


def at_once_when_ready(scheduler):
    """Return the number of simultaneous trials after a worker has imported the trial module."""
    with dask_cluster(scheduler) as (executor, at_once):
        executor.submit(import_module, "equipoise.lab.study.trial").result()
        return at_once()


def messages(stderr):
    """Return the lines of stderr without progress."""
    return [line for line in stderr.splitlines() if not line.startswith("[")]


def test_a_scheduler_without_workers_a_worker_with_threads_and_a_worker_that_is_killed(cluster, tmp_path, capsys):
    begin = time.monotonic()
    assert (
        main(
            [
                "lab",
                "monte-carlo",
                "--executor",
                "dask",
                "--scheduler",
                cluster.address,
                "--out",
                str(tmp_path / "none"),
            ]
        )
        == 9
    )
    assert time.monotonic() - begin < 20
    assert f"no workers; start one: dask worker {cluster.address} --nthreads 1" in capsys.readouterr().err
    assert not (tmp_path / "none").exists()

    victim = cluster.add(threads=2)
    with pytest.warns(UserWarning, match="1 workers with 2 threads run only 1 trials at once"):
        assert at_once_when_ready(cluster.address) == 1  # of the two workers the victim begins first

    cluster.add()
    process = start_study(tmp_path / "study", "--trials", TRIALS, "--executor", "dask", "--scheduler", cluster.address)
    lines = wait_for(process, "[4/")
    victim.send_signal(signal.SIGKILL)
    output, rest = process.communicate(timeout=120)
    assert process.returncode == 0, rest
    assert f"static: {TRIALS} trials" in output
    assert [
        line for line in messages("".join(lines) + rest) if not line.startswith("warning: 2 workers with 3 threads")
    ] == []
    rows = rows_in(tmp_path / "study")
    assert [row["trial"] for row in rows] == list(range(TRIALS))
    assert len({row["worker"] for row in rows}) == 2
    assert facts(rows) == facts(study_rows(STATIC, TRIALS, tmp_path / "here", Inline()))
    assert all(path.suffix != ".json" for path in cluster.folder.rglob("*")), "workers write into their own folders"


def test_ctrl_c_and_a_killed_scheduler_end_a_study_with_one_message(cluster, tmp_path):
    if not any(process.poll() is None for process in cluster.processes[1:]):
        cluster.add()
    ends = [
        (lambda process: process.send_signal(signal.SIGINT), 130, "interrupted"),
        (
            lambda _: cluster.processes[0].kill(),
            9,
            "error: the workers are gone; finished trials are kept. Start the workers and repeat the command to resume",
        ),
    ]
    for end, code, message in ends:
        folder = tmp_path / str(code)
        process = start_study(folder, "--trials", 500, "--executor", "dask", "--scheduler", cluster.address)
        wait_for(process, "[3/")
        end(process)
        _, rest = process.communicate(timeout=60)
        assert process.returncode == code
        assert messages(rest) == [message]
        assert len(rows_in(folder)) >= 3
        until = time.monotonic() + 2.0  # no process is left behind for longer
        while alive(process.pid) and time.monotonic() < until:
            time.sleep(0.05)
        assert not alive(process.pid)


def test_a_scheduler_that_does_not_answer(monkeypatch):
    monkeypatch.setattr(executors, "_PATIENCE", 1)
    address = f"tcp://127.0.0.1:{free_port()}"
    begin = time.monotonic()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with (
            pytest.raises(EquipoiseError, match=f"no Dask scheduler answers at '{address}'") as caught,
            dask_cluster(address),
        ):
            pass
    assert caught.value.exit_code == 9
    assert time.monotonic() - begin < 10


@pytest.mark.parametrize("address", ["192.168.1.2:8786", "scheduler", ""])
def test_an_invalid_address_raises_an_error(address):
    with pytest.raises(SettingsError, match=r"must be like tcp://192\.168\.1\.2:8786"), dask_cluster(address):
        pass


def test_without_dask_the_error_names_the_package(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MissingDependencyError, match=r"pip install 'equipoise\[dask\]'"), dask_cluster("tcp://a:1"):
        pass
