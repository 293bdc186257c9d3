"""A robot's own clock: a counter that wraps, and may not count what its makers say."""

from __future__ import annotations

import numpy as np

from equipoise.errors import CommunicationError

_COMPARED_AFTER = 1.0  # [s] of samples, the clock is compared with this computer's
_RATIO = 10.0  # between the two clocks; a wrong unit is off by 1000
_UNITS = (1e-3, 1e-6)  # [s] that a counter is known to have: users say milliseconds, headers microseconds
_STRETCH, _LEAST_SAMPLES = 0.25, 12  # [s] and number of samples that a rate is taken from
_STRETCHES = 8  # after which a unit is told or refused
_AGREES = 1.2  # ratio of a unit to what was seen; between the units it is 1000
_SLOWEST = 10.0  # ratio by which a robot may seem slow that does not keep time: a simulated one on a busy machine
_STEADY = 1.05  # ratio between the rates of a clock that does keep time


class RobotClock:
    """Seconds from a counter of 32 bits that begins again when it is full.

    Args:
        tick: time step of the counter [s]; 0: there is none.
    """

    def __init__(self, tick: float) -> None:
        self._tick = tick
        self._count: int | None = None
        self._begin: tuple[float, float] | None = None
        self._compared = tick == 0

    def time(self, count: int, received: float) -> float:
        """Return the time of a sample [s] from its counter and its time of arrival; late ones are earlier than the last.

        Raises:
            CommunicationError: the counter runs so fast or slowly that its unit must be another.
        """
        if self._tick == 0:
            return received
        last = count if self._count is None else self._count
        ahead = _ahead(count, last)
        self._count = max(last, last + ahead)
        time = (last + ahead) * self._tick
        if not self._compared:
            self._compare(time, received)
        return time

    def _compare(self, time: float, received: float) -> None:
        if self._begin is None:
            self._begin = time, received
        passed, here = time - self._begin[0], received - self._begin[1]
        if here < _COMPARED_AFTER:
            return
        if not here / _RATIO < passed < here * _RATIO:
            raise CommunicationError(
                f"the robot's clock went {passed:.6g} s ahead in {here:.1f} s; its step must be other than {self._tick:g} s: "
                "set tick (1e-6 if it counts microseconds, 0 if it stands still)"
            )
        self._compared = True


class UnitSearch:
    """The unit of a robot's counter, learnt from when the first samples arrive.

    Some samples come late, twice or never, and the system may hold them up: so a rate is that between the medians of the first
    and the last third of a quarter of a second. The first rate that agrees with a unit determines it. If none does, a clock
    that is steady has another unit, and one that is not is a simulated robot's that gets too little of a computer.

    Attributes:
        learnt: unit of the counter [s]; None: not yet.
    """

    def __init__(self) -> None:
        self.learnt: float | None = None
        self._seen: list[tuple[int, float]] = []
        self._rates: list[float] = []

    def hear(self, count: int, received: float) -> None:
        """Look at one more sample's counter, and when it arrived [s].

        Raises:
            CommunicationError: the counter has another unit than the known ones, or stands still.
        """
        self._seen.append((count, received))
        if self.learnt is not None or received - self._seen[0][1] < _STRETCH or len(self._seen) < _LEAST_SAMPLES:
            return
        self._rates.append(_rate(self._seen))
        self._seen.clear()
        self.learnt = _unit(self._rates[-1], 1 / _AGREES)
        if self.learnt is None and len(self._rates) >= _STRETCHES:
            self._decide()

    def _decide(self) -> None:
        fastest = max(self._rates)
        steady = fastest < _STEADY * min(self._rates)
        self.learnt = None if steady else _unit(fastest, 1 / _SLOWEST)
        if self.learnt is None:
            raise CommunicationError(
                f"the robot's clock counts {np.median(self._rates):.4g} steps in a second, neither milliseconds nor "
                "microseconds: set tick, the seconds of a step (0 if it stands still: samples then get the time when they "
                "arrive)"
            )


def _rate(seen: list[tuple[int, float]]) -> float:
    """Counts a second."""
    table = np.array([(_ahead(count, seen[0][0]), received) for count, received in seen])
    third = len(table) // 3
    counts, passed = np.median(table[-third:], axis=0) - np.median(table[:third], axis=0)
    return float(counts / passed) if passed > 0 else 0.0


def _unit(rate: float, slowest: float) -> float | None:
    """The known unit of so many counts a second, which may be slower than it by a ratio."""
    return next((unit for unit in _UNITS if slowest < rate * unit < _AGREES), None)


def _ahead(count: int, other: int) -> int:
    """Return by how much one count of 32 bits is ahead of another, the shorter way round."""
    return (count - other + 2**31) % 2**32 - 2**31
