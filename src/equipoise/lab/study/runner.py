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
from equipoise.lab.study.executors import ctrl_c_held, ended_after
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
_COUNTED = 1.0  # [s] for which a number of workers is believed
_PATIENCE = 1.0  # [s] between looks at Ctrl-C, which `wait` would keep from us on some systems


@dataclass(frozen=True)
class StudyProgress:
    """How far a study is.

    Attributes:
        done: number of trials on hand, those of earlier runs included.
        total: number of trials wanted.
        failed: number of calibrations that failed, in this run.
        rate: trials per second, in this run [1/s].
        remaining: time left at that rate [s]; None before the first trial.
    """

    done: int
    total: int
    failed: int
    rate: float
    remaining: float | None


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
        crew = _Crew(executor, workers or _cores(), limit)
        try:
            _run(study, missing, _Arrivals(store, trials, len(missing), report), crew)
        finally:
            try:
                store.flush()  # first: a second Ctrl-C may cut the other short
            finally:
                crew.dismiss()
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


def _run(study: Study, missing: deque[int], arrivals: _Arrivals, crew: _Crew) -> None:
    logs = str((arrivals.store.folder / FAILURES).resolve())  # workers may be at home in other folders
    flying: dict[Future[Table], int] = {}
    suspects: set[int] = set()  # in flight when a worker died; they run alone until it is known which one it was
    while missing or flying:
        broken = False
        while missing and not broken and len(flying) < (1 if suspects else crew.width):
            try:
                flying[crew.submit(study, missing[0], logs)] = missing[0]
                missing.popleft()
            except BrokenExecutor:  # a worker died since we last looked
                broken = True
        done, _ = wait(flying, timeout=0 if broken else _PATIENCE, return_when=FIRST_COMPLETED)
        died: list[int] = []
        for future in done:
            trial = flying.pop(future)
            try:
                rows = future.result()
            except (BrokenExecutor, CancelledError):
                died.append(trial)
                continue
            except ImportError as error:
                raise EquipoiseError(
                    f"the workers lack a package: {error}; install there what is installed here",
                    exit_code=9,
                ) from error
            except Exception as error:  # of the executor: trials raise nothing
                rows = _lost(study, trial, repr(error))
            suspects.discard(trial)
            arrivals.add(rows)
        arrivals.store.flush_if_due()
        if died or broken:
            died += flying.values()
            flying.clear()
            crew.replace()
            if len(died) == 1 and died[0] in suspects:  # alone, and it was in flight the last time too
                suspects.discard(died[0])
                why = f"the process that ran it died twice: out of memory? Or it took longer than {crew.limit:g} s"
                arrivals.add(_lost(study, died[0], why))
            else:
                suspects.update(died)
                missing.extendleft(sorted(died, reverse=True))


def _lost(study: Study, trial: int, message: str) -> Table:
    about = {"trial": trial, "status": LOST, "message": message}
    return table_of([{**about, "method": method.name} for method in study.methods])


class _Crew:
    """An executor, ours or the caller's; ours is replaced when a process of it dies."""

    def __init__(self, given: Executor | None, workers: int | Callable[[], int], limit: float) -> None:
        self._given, self._workers, self.limit = given, workers, limit
        self._own: Executor | None = None
        self._counted, self._count = -float("inf"), 1

    @property
    def width(self) -> int:
        """How many trials to have in flight now."""
        return _IN_FLIGHT_PER_WORKER * self._at_once()

    def _at_once(self) -> int:
        if isinstance(self._workers, int):
            return self._workers
        if time.monotonic() - self._counted > _COUNTED:
            self._counted, self._count = time.monotonic(), max(1, self._workers())
        return self._count

    def submit(self, study: Study, trial: int, logs: str) -> Future[Table]:
        with ctrl_c_held(), _one_thread_each():
            executor = self._given or self._own or self._begin()
            return executor.submit(ended_after, self.limit, run_trial, study, trial, logs)

    def replace(self) -> None:
        if self._given is not None:
            raise EquipoiseError(
                "the workers are gone; what arrived is kept: start them again and repeat the command to go on",
                exit_code=9,
            )
        self.dismiss()
        with ctrl_c_held(), _one_thread_each():
            begun = self._begin().submit(os.getpid)
        try:
            begun.result()
        except BrokenExecutor as error:  # no trial's fault
            raise EquipoiseError(
                "worker processes die as they begin; is there memory for them? A script that runs a study does so below "
                'if __name__ == "__main__":',
                exit_code=9,
            ) from error

    def _begin(self) -> Executor:
        self._own = Processes(self._at_once())
        return self._own

    def dismiss(self) -> None:
        if self._own is not None:
            self._own.shutdown(wait=True, cancel_futures=True)
            self._own = None


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
