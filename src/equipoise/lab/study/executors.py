"""Executor on the workers of a Dask cluster, and the time limit of a trial in a worker process."""

# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false, reportAttributeAccessIssue=false
# pyright: reportMissingTypeStubs=false
# Dask's client comes with few types; its methods look asynchronous to a checker.

from __future__ import annotations

import logging
import multiprocessing
import os
import threading
import warnings
from collections.abc import Callable, Generator
from concurrent.futures import Executor
from contextlib import contextmanager, suppress
from typing import TypeVar

from equipoise.errors import EquipoiseError, MissingDependencyError, SettingsError

Result = TypeVar("Result")
_PATIENCE = 10  # [s] until a scheduler must answer


def ended_after(limit: float, function: Callable[..., Result], *arguments: object) -> Result:
    """Call a function in a worker process, and end the process after a time limit.

    Only the end of the process stops an engine that hangs. A main process is never ended.

    Args:
        limit: time limit of the call [s].
    """
    if multiprocessing.parent_process() is None:
        return function(*arguments)
    end = threading.Timer(limit, os._exit, (1,))
    end.daemon = True
    end.start()
    try:
        return function(*arguments)
    finally:
        end.cancel()


@contextmanager
def dask_cluster(scheduler: str) -> Generator[tuple[Executor, Callable[[], int]]]:
    """Yield an executor on the workers of a Dask cluster, and a function that returns their present number.

    A worker runs one trial at a time. Trials of a worker that dies are repeated on another one.

    Args:
        scheduler: address of the scheduler, for example tcp://192.168.1.2:8786.

    Raises:
        MissingDependencyError: `dask.distributed` is not installed.
        EquipoiseError: the scheduler does not answer or has no workers.
        SettingsError: the address is invalid.
    """
    try:
        from distributed import Client  # noqa: PLC0415 - heavy, and an extra
    except ModuleNotFoundError as error:
        raise MissingDependencyError("a Dask cluster needs its client: pip install 'equipoise[dask]'") from error
    if "://" not in scheduler:
        raise SettingsError(f"the scheduler's address is {scheduler!r}; it must be like tcp://192.168.1.2:8786")
    with _silenced("distributed", "distributed.client", "tornado.application"):
        try:
            client = Client(scheduler, timeout=_PATIENCE)
        except (OSError, ValueError) as error:  # TimeoutError is an OSError
            raise EquipoiseError(f"no Dask scheduler answers at {scheduler!r}: {error}", exit_code=9) from error

        def workers_now() -> int:
            with suppress(OSError):  # trials fail if the scheduler is gone
                present: list[int] = list(client.nthreads().values())
                return len(present)
            return 1

        try:
            threads: list[int] = list(client.nthreads().values())
            if not threads:
                raise EquipoiseError(
                    f"the scheduler at {scheduler!r} has no workers; start one: dask worker {scheduler} --nthreads 1",
                    exit_code=9,
                )
            if sum(threads) > len(threads):
                warnings.warn(
                    f"{len(threads)} workers with {sum(threads)} threads run only {len(threads)} trials at once, one per "
                    f"process; start more: dask worker {scheduler} --nworkers {sum(threads)} --nthreads 1",
                    stacklevel=3,
                )
            yield client.get_executor(pure=False), workers_now
        finally:
            client.close()


@contextmanager
def _silenced(*loggers: str) -> Generator[None]:
    """Suppress loggers' messages about errors that are also raised."""
    levels = {log: log.level for log in map(logging.getLogger, loggers)}
    for log in levels:
        log.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for log, level in levels.items():
            log.setLevel(level)
