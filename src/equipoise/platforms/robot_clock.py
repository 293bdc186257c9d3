"""A robot's own clock: a counter that wraps, and may not count what its makers say."""

from __future__ import annotations

from equipoise.errors import CommunicationError

_COMPARED_AFTER = 1.0  # [s] of samples, the clock is compared with this computer's
_RATIO = 10.0  # between the two clocks; a wrong unit is off by 1000


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
        ahead = (count - last + 2**31) % 2**32 - 2**31
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
