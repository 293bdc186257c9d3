"""The workers of a Dask cluster as an executor, and the limit of a trial in any worker process."""

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
_PATIENCE = 10  # [s] for a scheduler to answer


def ended_after(limit: float, function: Callable[..., Result], *arguments: object) -> Result:
    """What a function returns. A worker process that takes longer for it ends at once, as one that crashes does.

    Nothing milder stops what hangs in an engine. A caller's own process is never ended.

    Args:
        limit: longest time that the function may take [s].
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
    """The workers of a Dask cluster as an executor, and what says how many trials they run at once now: one each.

    Trials of a worker that dies run again on another one.

    Args:
        scheduler: address of the scheduler, as tcp://192.168.1.2:8786.

    Raises:
        MissingDependencyError: `dask.distributed` is not installed.
        EquipoiseError: nobody answers there, or the scheduler has no workers.
        SettingsError: it is no address.
    """
    try:
        from distributed import Client  # noqa: PLC0415 - heavy, and an extra
    except ModuleNotFoundError as error:
        raise MissingDependencyError("a Dask cluster needs its client: pip install 'equipoise[dask]'") from error
    if "://" not in scheduler:
        raise SettingsError(f"{scheduler!r} is no scheduler's address; it looks like tcp://192.168.1.2:8786")
    with _untold("distributed", "distributed.client"):
        try:
            client = Client(scheduler, timeout=_PATIENCE)
        except (OSError, ValueError) as error:  # TimeoutError is an OSError
            raise EquipoiseError(f"no Dask scheduler answers at {scheduler!r}: {error}", exit_code=9) from error

        def workers_now() -> int:
            with suppress(OSError):  # a scheduler that is gone is noticed by its trials
                now: list[int] = list(client.nthreads().values())
                return len(now)
            return 1

        try:
            threads: list[int] = list(client.nthreads().values())
            if not threads:
                raise EquipoiseError(
                    f"the scheduler at {scheduler!r} has no workers: dask worker {scheduler} --nthreads 1",
                    exit_code=9,
                )
            if sum(threads) > len(threads):
                warnings.warn(
                    f"{len(threads)} workers with {sum(threads)} threads run {len(threads)} trials at once, one in each "
                    f"process: dask worker {scheduler} --nworkers {sum(threads)} --nthreads 1",
                    stacklevel=3,
                )
            yield client.get_executor(pure=False), workers_now
        finally:
            client.close()


@contextmanager
def _untold(*loggers: str) -> Generator[None]:
    """Errors of loggers are ours to tell: they come as tracebacks."""
    levels = {log: log.level for log in map(logging.getLogger, loggers)}
    for log in levels:
        log.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for log, level in levels.items():
            log.setLevel(level)
