"""Robot clock: a counter that wraps around, and whose unit may differ from its documentation."""

from __future__ import annotations

import numpy as np

from equipoise.errors import CommunicationError

_COMPARED_AFTER = 1.0  # [s] of samples after which the clock is compared with this computer's
_RATIO = 10.0  # between the two clocks; a wrong unit is off by 1000
_UNITS = (1e-3, 1e-6)  # [s] of a count: milliseconds according to users, microseconds according to headers
_STRETCH, _LEAST_SAMPLES = 0.25, 12  # [s] and number of samples of one rate
_STRETCHES = 8  # after which a unit is accepted or rejected
_AGREES = 1.2  # ratio of a unit to the measured one; between the units it is 1000
_SLOWEST = 10.0  # ratio by which an unsteady clock may seem slow: a simulated robot's on a busy machine
_STEADY = 1.05  # ratio between the rates of a steady clock


class RobotClock:
    """Conversion of a 32-bit counter that wraps around to seconds.

    Args:
        tick: time step of the counter [s]; 0: no counter.
    """

    def __init__(self, tick: float) -> None:
        self._tick = tick
        self._count: int | None = None
        self._begin: tuple[float, float] | None = None
        self._compared = tick == 0

    def time(self, count: int, received: float) -> float:
        """Return the time of a sample [s] from its counter and its time of arrival; it may be before the last one.

        Raises:
            CommunicationError: the counter is so fast or slow that its unit must differ.
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
                f"the robot's clock advanced by {passed:.6g} s in {here:.1f} s; its step is not {self._tick:g} s: "
                "set tick (1e-6 if it counts microseconds, 0 if it does not advance)"
            )
        self._compared = True


class UnitSearch:
    """Detection of the unit of a robot's counter from the arrival of the first samples.

    Some samples come late, twice or never, and the system may delay them. A rate is therefore computed between the medians of
    the first and the last third of a quarter of a second. The first rate that agrees with a unit determines it. If none does,
    a steady clock has another unit; an unsteady one belongs to a simulated robot on a busy computer.

    Attributes:
        unit: unit of the counter [s]; None: not detected yet.
    """

    def __init__(self) -> None:
        self.unit: float | None = None
        self._seen: list[tuple[int, float]] = []
        self._rates: list[float] = []

    def add(self, count: int, received: float) -> None:
        """Add a sample's counter and its time of arrival [s].

        Raises:
            CommunicationError: the counter has an unsupported unit, or does not advance.
        """
        self._seen.append((count, received))
        if self.unit is not None or received - self._seen[0][1] < _STRETCH or len(self._seen) < _LEAST_SAMPLES:
            return
        self._rates.append(_rate(self._seen))
        self._seen.clear()
        self.unit = _unit(self._rates[-1], 1 / _AGREES)
        if self.unit is None and len(self._rates) >= _STRETCHES:
            self._decide()

    def _decide(self) -> None:
        fastest = max(self._rates)
        steady = fastest < _STEADY * min(self._rates)
        self.unit = None if steady else _unit(fastest, 1 / _SLOWEST)
        if self.unit is None:
            raise CommunicationError(
                f"the robot's clock counts {np.median(self._rates):.4g} steps per second, neither milliseconds nor "
                "microseconds: set tick, the seconds of a step (0 if it does not advance: samples then get their time of "
                "arrival)"
            )


def _rate(seen: list[tuple[int, float]]) -> float:
    """Return the counts per second."""
    table = np.array([(_ahead(count, seen[0][0]), received) for count, received in seen])
    third = len(table) // 3
    counts, passed = np.median(table[-third:], axis=0) - np.median(table[:third], axis=0)
    return float(counts / passed) if passed > 0 else 0.0


def _unit(rate: float, slowest: float) -> float | None:
    """Return the unit that agrees with a rate in counts per second, which may be slower by a ratio, or None."""
    return next((unit for unit in _UNITS if slowest < rate * unit < _AGREES), None)


def _ahead(count: int, other: int) -> int:
    """Return the smallest difference of two wrapping 32-bit counts."""
    return (count - other + 2**31) % 2**32 - 2**31
