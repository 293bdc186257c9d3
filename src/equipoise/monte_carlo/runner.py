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

from equipoise.errors import SettingsError, WorkerError
from equipoise.monte_carlo.executors import process_pool
from equipoise.monte_carlo.store import FAILURES, TrialStore
from equipoise.monte_carlo.study import Study
from equipoise.monte_carlo.trial import SUCCEEDED, Row, run_trial

LOST = "WorkerLost"
"""Status of a trial whose worker process died of it, twice."""

_IN_FLIGHT_PER_WORKER = 3  # so that no worker waits for its next trial
_PATIENCE = 1.0  # [s] between looks at Ctrl-C, which `wait` would keep from us on some systems


@dataclass(frozen=True)
class StudyProgress:
    """How far a study is.

    Attributes:
        done: trials on hand, those of earlier runs included.
        total: trials wanted.
        failed: calibrations that failed, in this run.
        rate: trials a second, in this run.
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
    workers: int | None = None,
    report: Callable[[StudyProgress], None] | None = None,
) -> list[Row]:
    """Run what a folder lacks of a study's first `trials` trials; returns the rows of all of them.

    Args:
        study: what is drawn and done.
        trials: how many; more than in an earlier run extends it.
        folder: of the study; made if need be, and gone on with if it holds this study.
        executor: any of `concurrent.futures`; None: a process for each core. It is not shut down.
        workers: how many trials run at once; default the number of cores.
        report: told after every trial.

    Raises:
        SettingsError: the folder holds another study, or a number makes no sense.
        OutputError: the rows cannot be written.
        WorkerError: a given executor broke. What arrived is kept; run again to go on.
    """
    if trials < 1:
        raise SettingsError(f"{trials} trials are none; ask for one at least")
    if workers is not None and workers < 1:
        raise SettingsError(f"{workers} workers do nothing; give one at least")
    store = TrialStore(folder, study)
    missing = deque(trial for trial in range(trials) if trial not in store.done)
    if missing:
        crew = _Crew(executor, workers or os.cpu_count() or 1)
        try:
            _run(study, missing, trials, store, crew, report)
        finally:
            crew.dismiss()
            store.flush()
    return [row for row in store.rows() if row["trial"] < trials]


def _run(
    study: Study, missing: deque[int], trials: int, store: TrialStore, crew: _Crew,
    report: Callable[[StudyProgress], None] | None,
) -> None:  # fmt: skip
    logs = str(store.folder / FAILURES)
    flying: dict[Future[list[Row]], int] = {}
    suspects: set[int] = set()  # in flight when a worker died; they run alone until it is known which one it was
    begin, finished, failed, before = time.monotonic(), 0, 0, trials - len(missing)
    while missing or flying:
        while missing and len(flying) < (1 if suspects else crew.width):
            trial = missing.popleft()
            flying[crew.submit(study, trial, logs)] = trial
        done, _ = wait(flying, timeout=_PATIENCE, return_when=FIRST_COMPLETED)
        died: list[int] = []
        for future in done:
            trial = flying.pop(future)
            try:
                rows = future.result()
            except (BrokenExecutor, CancelledError):
                died.append(trial)
                continue
            except Exception as error:  # of the executor: trials raise nothing
                rows = _lost(study, trial, error)
            suspects.discard(trial)
            store.add(rows)
            finished += 1
            failed += sum(row["status"] != SUCCEEDED for row in rows)
            if report is not None:
                rate = finished / (time.monotonic() - begin)
                report(StudyProgress(before + finished, trials, failed, rate, (len(missing) + len(flying)) / rate))
        if died:
            died += flying.values()
            flying.clear()
            crew.replace()
            if len(died) == 1 and died[0] in suspects:  # alone, and it was in flight the last time too
                suspects.discard(died[0])
                store.add(_lost(study, died[0], None))
                finished, failed = finished + 1, failed + len(study.methods)
            else:
                suspects.update(died)
                missing.extendleft(sorted(died, reverse=True))


def _lost(study: Study, trial: int, error: Exception | None) -> list[Row]:
    message = "the process that ran it died twice: out of memory?" if error is None else repr(error)
    return [{"trial": trial, "method": method, "status": LOST, "message": message} for method in study.methods]


class _Crew:
    """An executor, ours or the caller's; ours is replaced when a process of it dies."""

    def __init__(self, given: Executor | None, workers: int) -> None:
        self._given, self._workers = given, workers
        self._own: Executor | None = None
        self.width = _IN_FLIGHT_PER_WORKER * workers

    def submit(self, study: Study, trial: int, logs: str) -> Future[list[Row]]:
        executor = self._given or self._own
        if executor is None:
            executor = self._own = process_pool(self._workers)
        with _one_thread_each():
            return executor.submit(run_trial, study, trial, logs)

    def replace(self) -> None:
        if self._given is not None:
            raise WorkerError(
                "the workers are gone; what arrived is kept: start them again and repeat the command to go on"
            )
        self.dismiss()

    def dismiss(self) -> None:
        if self._own is not None:
            self._own.shutdown(wait=True, cancel_futures=True)
            self._own = None


@contextmanager
def _one_thread_each() -> Generator[None]:
    """Processes started in here run NumPy on one thread: many trials at once want the cores, not each of them all."""
    names = [f"{library}_NUM_THREADS" for library in ("OMP", "OPENBLAS", "MKL")]
    before = {name: os.environ.get(name) for name in names}
    os.environ.update(dict.fromkeys(names, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
