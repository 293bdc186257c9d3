"""How the CoM estimate closes in: what was known after each trial, by the method's own arithmetic."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from equipoise.errors import EquipoiseError
from equipoise.method.method import Method
from equipoise.method.reading import ComEstimate, LiftPlane, Reading
from equipoise.recording.recording import Recording
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance

Answer = TypeVar("Answer")


class ClosingIn:
    """Estimates after each trial, made by a thread of its own: the newest first, then those before it.

    Use it as a context manager, or `close` it.
    """

    def __init__(self, robot: RobotModel, stance: Stance, method: Method) -> None:
        self._robot, self._stance, self._method = robot, stance, method
        self._recordings: list[Recording] = []
        self._estimates: dict[int, ComEstimate | None] = {}
        self._planes: tuple[LiftPlane, ...] = ()
        self._since = 0  # how often everything began anew
        self._wake, self._over = threading.Condition(), False
        self._thread = threading.Thread(target=self._work, name="estimates", daemon=True)
        self._thread.start()

    def take(self, recordings: Sequence[Recording], anew: bool = False) -> None:
        """More trials are complete; anew: those before are void."""
        with self._wake:
            if anew:
                self._recordings, self._estimates, self._planes = [], {}, ()
                self._since += 1
            self._recordings = [*self._recordings, *recordings]
            self._wake.notify()

    @property
    def planes(self) -> tuple[LiftPlane, ...]:
        """Of all complete lifts, in order."""
        return self._planes

    @property
    def count(self) -> int:
        """After how many trials there is an estimate."""
        return len(self._estimates)

    @property
    def settled(self) -> bool:
        """Whether there is an estimate after every trial."""
        with self._wake:
            return len(self._estimates) >= len(self._recordings)

    def after(self, trials: int) -> ComEstimate | None:
        """The newest estimate that uses no more than so many trials."""
        with self._wake:
            known = [n for n, estimate in self._estimates.items() if n <= trials and estimate is not None]
            return self._estimates[max(known)] if known else None

    def history(self, trials: int) -> list[ComEstimate]:
        """All estimates up to one, in order."""
        with self._wake:
            found = [estimate for n, estimate in sorted(self._estimates.items()) if n <= trials]
        return [estimate for estimate in found if estimate is not None]

    def close(self) -> None:
        """End the thread, behind the estimate that it makes."""
        with self._wake:
            self._over = True
            self._wake.notify()

    def __enter__(self) -> ClosingIn:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _work(self) -> None:
        reading, read = None, -1
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._over or len(self._estimates) < len(self._recordings))
                if self._over:
                    return
                recordings, since = self._recordings, self._since
                count = _next(len(recordings), self._estimates)
            if count == len(recordings) != read:
                reading, read = self._read(recordings), count
            estimate = _known(lambda reading=reading, count=count: reading.estimate(count)) if reading else None
            with self._wake:
                if since == self._since:
                    self._estimates[count] = estimate

    def _read(self, recordings: Sequence[Recording]) -> Reading | None:
        reading = _known(lambda: self._method.reading(self._robot, self._stance, recordings))
        self._planes = tuple(_known(reading.planes) or ()) if reading is not None else ()
        return reading


def _known(ask: Callable[[], Answer]) -> Answer | None:
    """An answer, or None where the recordings do not give one: the run's result will say why, a picture goes on."""
    try:
        return ask()
    except (EquipoiseError, np.linalg.LinAlgError):
        return None


def _next(count: int, known: dict[int, ComEstimate | None]) -> int:
    """The newest that is not known, then the middle of the widest gap."""
    if count not in known:
        return count
    marks = sorted({0, *known})
    low, high = max(itertools.pairwise(marks), key=lambda pair: pair[1] - pair[0])
    return (low + high + 1) // 2
