"""Execution of a study's trials in processes on one or more machines, each trial exactly once."""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Callable, Generator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from equipoise.errors import EquipoiseError, SettingsError
from equipoise.lab.study.executors import ended_after
from equipoise.lab.study.processes import Processes
from equipoise.lab.study.rows import Table, column, failed, table_of
from equipoise.lab.study.store import FAILURES, TrialStore
from equipoise.lab.study.study import Study
from equipoise.lab.study.trial import check_study, run_trial
from equipoise.platform.interruptions import Interruptions
from equipoise.threads import ONE_THREAD

LOST = "WorkerLost"
"""Status of a trial whose worker process died twice or exceeded the time limit twice."""

_IN_FLIGHT_PER_WORKER = 3  # so that workers do not wait for trials
_LIMIT = 1800.0  # [s]; the slowest robots and engines take some minutes
_PATIENCE = 0.2  # [s] between checks for Ctrl-C


@dataclass(frozen=True)
class StudyProgress:
    """Progress of a study.

    Attributes:
        done: number of finished trials, including earlier runs.
        total: number of requested trials.
        failed: number of failed calibrations in this run.
        rate: rate of trials in this run [1/s].
        remaining: remaining time at that rate [s].
    """

    done: int
    total: int
    failed: int
    rate: float
    remaining: float


def run_study(
    study: Study,
    trials: int,
    folder: str | Path,
    executor: Executor | None = None,
    workers: int | Callable[[], int] | None = None,
    report: Callable[[StudyProgress], None] | None = None,
    limit: float = _LIMIT,
) -> Table:
    """Run the missing trials of a study's first `trials` trials; return the rows of all of them.

    Args:
        study: study to run.
        trials: number of trials; more than in an earlier run extends the study.
        folder: new folder, or folder of this study to resume.
        executor: executor of `concurrent.futures`, which is not shut down; None: a process per core.
        workers: number of simultaneous trials, or function that returns the present number; default the number of cores
            available to this process.
        report: function that is called after every trial.
        limit: time limit of a trial [s], after which its process is ended. A trial that is ended twice is lost.

    A script must call this without an executor below `if __name__ == "__main__":`, as with any process pool.

    Raises:
        SettingsError: the folder contains another study, or a number is out of range.
        OutputError: the rows cannot be written.
        EquipoiseError: workers do not start, or a given executor broke; finished trials are kept. Or an error of every
            trial: unknown robot, or settings that do not fit it.
    """
    if trials < 1:
        raise SettingsError(f"the number of trials is {trials}; it must be at least 1")
    if limit <= 0:
        raise SettingsError(f"the time limit of a trial is {limit:g} s; it must be positive, for example 30min")
    if isinstance(workers, int) and workers < 1:
        raise SettingsError(f"the number of workers is {workers}; it must be at least 1")
    check_study(study)
    store = TrialStore(folder, study)
    missing = deque(trial for trial in range(trials) if trial not in store.done)
    to_run = len(missing)
    if missing:
        at_once = workers if callable(workers) else lambda: workers or _cores()
        begin, before, failures = time.monotonic(), len(store.done), 0

        def add(rows: Table) -> None:
            nonlocal failures
            store.add(rows)
            finished = len(store.done) - before
            failures += failed(rows)
            if report is not None:
                rate = finished / (time.monotonic() - begin)
                left = to_run - finished
                report(StudyProgress(trials - left, trials, failures, rate, left / rate))

        with _one_thread_each(), _pool(executor, at_once()) as pool:
            try:
                _run(study, missing, store, add, pool, at_once, limit)
            finally:
                store.flush()
    rows = store.rows()
    return rows.filter(column(rows, "trial") < trials)


def _cores() -> int:
    """Return the number of cores available to this process, which a batch system may limit."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _run(
    study: Study, missing: deque[int], store: TrialStore, add: Callable[[Table], None], pool: Executor,
    at_once: Callable[[], int], limit: float,
) -> None:  # fmt: skip
    """Run trials. Ctrl-C waits for `wait`, which holds locks that workers need: an exception could keep them locked."""
    logs = str((store.folder / FAILURES).resolve())  # workers may run in other folders
    running: dict[Future[Table], int] = {}
    interruptions = Interruptions()
    with interruptions.noted():
        while missing or running:
            room = _IN_FLIGHT_PER_WORKER * max(1, at_once()) - len(running)
            for _ in range(min(room, len(missing))):
                trial = missing.popleft()
                running[pool.submit(ended_after, limit, run_trial, study, trial, logs)] = trial
            done, _ = wait(running, timeout=_PATIENCE, return_when=FIRST_COMPLETED)
            # Rows before errors.
            for future in sorted(done, key=lambda one: one.cancelled() or one.exception() is not None):
                add(_rows(study, running.pop(future), future, limit))
            store.flush_if_due()
            if interruptions.asked:
                raise KeyboardInterrupt


def _rows(study: Study, trial: int, future: Future[Table], limit: float) -> Table:
    """Return the rows of a finished trial; raises errors that concern all trials."""
    try:
        return future.result()
    except ImportError as error:
        missing = f"the workers lack a package: {error}; install the packages of this machine there"
        raise EquipoiseError(missing, exit_code=9) from error
    except (BrokenExecutor, CancelledError, EquipoiseError):
        raise
    except ChildProcessError as error:
        message = f"{error}: out of memory, or time limit of {limit:g} s exceeded"
    except Exception as error:  # an error of the executor: trials do not raise
        message = repr(error)
    row = {"trial": trial, "status": LOST, "message": message}
    return table_of([{**row, "method": method.name} for method in study.methods])


@contextmanager
def _pool(given: Executor | None, count: int) -> Generator[Executor]:
    """Yield the given executor, or processes that end with the context; raises EquipoiseError if it breaks."""
    pool = given or Processes(count)
    try:
        yield pool
    except (BrokenExecutor, CancelledError) as error:
        raise EquipoiseError(
            "the workers are gone; finished trials are kept. Start the workers and repeat the command to resume",
            exit_code=9,
        ) from error
    finally:
        if given is None:
            pool.shutdown(cancel_futures=True)


@contextmanager
def _one_thread_each() -> Generator[None]:
    """Limit NumPy to one thread in processes started here, because many trials share the cores."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(ONE_THREAD)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
