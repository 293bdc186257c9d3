"""The clock of a page: play and pause, speed, scrubbing; and keeping up with a robot that is at work."""

from __future__ import annotations

_LAG = 0.5  # [s] that a page stays behind a log, which is written in pieces of a quarter of a second
_FASTEST = 5.0  # times real time: a simulation is faster, and nobody could see anything
_SLOWEST = 0.5
_PATIENCE = 10.0  # [s] to see what one has missed


class Player:
    """Says what moment to show.

    Attributes:
        time: that is shown [s].
        speed: factor on the recording's own time.
        playing: whether it goes on.
        live: whether it keeps up with what is written.
        rate: factor that time really went on by.
    """

    def __init__(self, live: bool) -> None:
        self.time, self.speed, self.playing, self.live, self.rate = 0.0, 1.0, True, live, 0.0

    def advance(self, elapsed: float, span: tuple[float, float], complete: bool) -> None:
        """So much real time has gone by [s].

        Args:
            span: first and last time that there is [s].
            complete: whether no more will come.
        """
        start, end = span
        before = min(max(self.time, start), end)
        self.time, self.rate = before, 0.0
        if not self.playing:
            return
        rate = self.speed
        if self.live:
            fastest = max(_FASTEST, (end - before) / _PATIENCE)
            rate = min(max((end - before) / (_PATIENCE if complete else _LAG), _SLOWEST), fastest)
        self.time = min(before + rate * elapsed, end)
        self.rate = (self.time - before) / elapsed if elapsed > 0 else 0.0
        if complete and self.time >= end:
            self.playing = self.live = False

    def jump(self, time: float) -> None:
        """Show another moment; the live picture is left."""
        self.time, self.live = time, False

    def toggle(self, span: tuple[float, float]) -> None:
        """Play or pause; from the end, play again from the start."""
        self.playing = not self.playing
        if self.playing and self.time >= span[1] and not self.live:
            self.time = span[0]
