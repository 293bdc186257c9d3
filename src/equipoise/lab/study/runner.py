"""Spreading a study's trials over processes, on this machine or on many, so that each arrives exactly once."""

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
from equipoise.threads import ONE_THREAD

LOST = "WorkerLost"
"""Status of a trial whose worker process died of it, twice, or was ended because it took too long."""

_IN_FLIGHT_PER_WORKER = 3  # so that no worker waits for its next trial
_LIMIT = 1800.0  # [s]; the slowest robots and engines take some minutes
_PATIENCE = 1.0  # [s] between looks at Ctrl-C, which `wait` would keep from us on some systems


@dataclass(frozen=True)
class StudyProgress:
    """How far a study is.

    Attributes:
        done: number of trials on hand, those of earlier runs included.
        total: number of trials wanted.
        failed: number of calibrations that failed, in this run.
        rate: trials per second, in this run [1/s].
        remaining: time left at that rate [s].
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
    """Run what a folder lacks of a study's first `trials` trials; returns the rows of all of them.

    Args:
        study: study that says what is drawn and done.
        trials: number of trials; more than in an earlier run extends it.
        folder: folder of the study; made if need be, and gone on with if it holds this study.
        executor: executor of `concurrent.futures`; None: a process for each core. It is not shut down.
        workers: number of trials that run at once, or function that says how many do now, of workers that come and go;
            default the number of cores that this process may use.
        report: function that is called after every trial.
        limit: longest time that a trial may take [s]; then its process is ended. One that is ended twice is lost.

    A script that calls this without an executor does so below `if __name__ == "__main__":`, as with any process pool.

    Raises:
        SettingsError: the folder holds another study, or a number makes no sense.
        OutputError: the rows cannot be written.
        EquipoiseError: workers cannot begin, or a given executor broke: what arrived is kept, run again to go on. Or what
            every trial would fail with: no such robot, settings that do not fit it.
    """
    if trials < 1:
        raise SettingsError(f"{trials} trials are none; ask for one at least")
    if limit <= 0:
        raise SettingsError(f"a limit of {limit:g} s leaves a trial no time; give it minutes")
    if isinstance(workers, int) and workers < 1:
        raise SettingsError(f"{workers} workers do nothing; give one at least")
    check_study(study)
    store = TrialStore(folder, study)
    missing = deque(trial for trial in range(trials) if trial not in store.done)
    if missing:
        at_once = workers if callable(workers) else lambda: workers or _cores()
        arrivals = _Arrivals(store, trials, len(missing), report)
        with _one_thread_each(), _crew(executor, at_once()) as crew:
            try:
                _run(study, missing, arrivals, crew, at_once, limit)
            finally:
                store.flush()
    rows = store.rows()
    return rows.filter(column(rows, "trial") < trials)


def _cores() -> int:
    """Those that this process may use: a batch system lends some of a machine's."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class _Arrivals:
    """Stores rows as they come, counts them and tells of them."""

    def __init__(
        self, store: TrialStore, total: int, missing: int, report: Callable[[StudyProgress], None] | None
    ) -> None:
        self.store = store
        self._total, self._missing, self._report = total, missing, report
        self._begin, self._finished, self._failed = time.monotonic(), 0, 0

    def add(self, rows: Table) -> None:
        self.store.add(rows)
        self._finished += 1
        self._failed += failed(rows)
        if self._report is not None:
            rate = self._finished / (time.monotonic() - self._begin)
            left = self._missing - self._finished
            self._report(StudyProgress(self._total - left, self._total, self._failed, rate, left / rate))


def _run(
    study: Study, missing: deque[int], arrivals: _Arrivals, crew: Executor, at_once: Callable[[], int], limit: float
) -> None:
    logs = str((arrivals.store.folder / FAILURES).resolve())  # workers may be at home in other folders
    flying: dict[Future[Table], int] = {}
    while missing or flying:
        room = _IN_FLIGHT_PER_WORKER * max(1, at_once()) - len(flying)
        for _ in range(min(room, len(missing))):
            trial = missing.popleft()
            flying[crew.submit(ended_after, limit, run_trial, study, trial, logs)] = trial
        done, _ = wait(flying, timeout=_PATIENCE, return_when=FIRST_COMPLETED)
        for future in sorted(
            done, key=lambda one: one.cancelled() or one.exception() is not None
        ):  # rows before errors
            arrivals.add(_rows(study, flying.pop(future), future, limit))
        arrivals.store.flush_if_due()


def _rows(study: Study, trial: int, future: Future[Table], limit: float) -> Table:
    """Return the rows of a trial that is done; raises what would be the same for all others."""
    try:
        return future.result()
    except ImportError as error:
        lacking = f"the workers lack a package: {error}; install there what is installed here"
        raise EquipoiseError(lacking, exit_code=9) from error
    except (BrokenExecutor, CancelledError, EquipoiseError):
        raise
    except ChildProcessError as error:
        message = f"{error}: out of memory? Or it took longer than {limit:g} s"
    except Exception as error:  # of the executor: trials raise nothing
        message = repr(error)
    row = {"trial": trial, "status": LOST, "message": message}
    return table_of([{**row, "method": method.name} for method in study.methods])


@contextmanager
def _crew(given: Executor | None, count: int) -> Generator[Executor]:
    """Yield the given executor, or processes that end with this; raises EquipoiseError if it breaks."""
    crew = given or Processes(count)
    try:
        yield crew
    except (BrokenExecutor, CancelledError) as error:
        raise EquipoiseError(
            "the workers are gone; what arrived is kept: start them again and repeat the command to go on",
            exit_code=9,
        ) from error
    finally:
        if given is None:
            crew.shutdown(cancel_futures=True)


@contextmanager
def _one_thread_each() -> Generator[None]:
    """Processes started in here run NumPy on one thread: many trials at once want the cores, not each of them all."""
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
