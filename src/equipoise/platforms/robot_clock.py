"""A robot's own clock: a counter that wraps, and may not count what its makers say."""

from __future__ import annotations

from collections import deque

import numpy as np

from equipoise.errors import CommunicationError

_COMPARED_AFTER = 1.0  # [s] of samples, the clock is compared with this computer's
_RATIO = 10.0  # between the two clocks; a wrong unit is off by 1000
_UNITS = (1e-3, 1e-6)  # [s] that a counter is known to have: users say milliseconds, headers microseconds
_LOOKED_AT = 0.25  # [s] of samples, to tell a unit
_LEAST_SAMPLES = 12  # among them
_AGREES = 1.2  # ratio of a unit to what was seen; between the units it is 1000
_UNKNOWN_AFTER = 3.0  # [s] in which samples never agreed with a unit


class RobotClock:
    """Seconds from a counter of 32 bits that begins anew when it is full.

    Args:
        tick: of the counter [s]; 0: there is none.
    """

    def __init__(self, tick: float) -> None:
        self._tick = tick
        self._count: int | None = None
        self._begin: tuple[float, float] | None = None
        self._compared = tick == 0

    def time(self, count: int, received: float) -> float:
        """When a sample was taken [s], given its counter and when it arrived; late ones are earlier than the last.

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

    Some samples come late, twice or never, and the system may hold them up: the rate is that between the medians of the first
    and the last third of a quarter of a second, and a stretch that agrees with no unit is followed by the next.

    Attributes:
        learnt: unit [s]; None: not yet.
    """

    def __init__(self) -> None:
        self.learnt: float | None = None
        self._seen: deque[tuple[int, float]] = deque()
        self._began: float | None = None

    def hear(self, count: int, received: float) -> None:
        """Look at one more sample's counter, and when it arrived [s].

        Raises:
            CommunicationError: the counter has another unit than the known ones, or stands still.
        """
        if self.learnt is not None:
            return
        self._began = received if self._began is None else self._began
        self._seen.append((count, received))
        if received - self._seen[0][1] < _LOOKED_AT or len(self._seen) < _LEAST_SAMPLES:
            return
        rate = self._rate()
        self.learnt = next((unit for unit in _UNITS if 1 / _AGREES < rate * unit < _AGREES), None)
        self._seen.popleft()
        if self.learnt is None and received - self._began > _UNKNOWN_AFTER:
            raise CommunicationError(
                f"the robot's clock counts {rate:.4g} steps in a second, neither milliseconds nor microseconds: set tick, the "
                "seconds of a step (0 if it stands still: samples then get the time when they arrive)"
            )

    def _rate(self) -> float:
        """Counts a second."""
        first = self._seen[0][0]
        seen = np.array([(_ahead(count, first), received) for count, received in self._seen])
        third = len(seen) // 3
        counts, passed = np.median(seen[-third:], axis=0) - np.median(seen[:third], axis=0)
        return float(counts / passed) if passed > 0 else 0.0


def _ahead(count: int, other: int) -> int:
    """How far one count of 32 bits is ahead of another, the shorter way round."""
    return (count - other + 2**31) % 2**32 - 2**31
