"""Handling of Ctrl-C, SIGTERM and a closed terminal while a robot is under command."""

from __future__ import annotations

import signal
import threading
from collections.abc import Generator
from contextlib import contextmanager
from types import FrameType
from typing import Any, NoReturn

_DEADLY = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))


class Terminated(KeyboardInterrupt):
    """Request to end the process by a signal other than Ctrl-C's.

    Attributes:
        number: number of the signal.
    """

    def __init__(self, number: int) -> None:
        super().__init__(f"ended by {signal.Signals(number).name}")
        self.number = number


class Interruptions:
    """Signal handlers while a robot is under command.

    By default, signals raise KeyboardInterrupt or `Terminated`. Within `held` (a motion), the first one waits for `check`: an
    exception in the middle would leave lists incomplete. Within `noted` (the ending), signals do not interrupt. Python runs
    handlers in the main thread; other threads change none. Signals that the process ignores (`nohup`) stay ignored.

    Attributes:
        asked: whether a signal arrived while the robot was put down.
    """

    def __init__(self) -> None:
        self.asked = False
        self._holding = self._noting = False
        self._waiting: int | None = None
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Interruptions:
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, *_DEADLY):
                if signal.getsignal(number) not in (signal.SIG_IGN, self._hear):
                    self._before[number] = signal.getsignal(number)
                    signal.signal(number, self._hear)
        return self

    def __exit__(self, *exception: object) -> None:
        while self._before:
            signal.signal(*self._before.popitem())

    @contextmanager
    def held(self) -> Generator[None]:
        """Defer the first signal until `check` or the end; a second one interrupts at once."""
        self._holding = bool(self._before)
        try:
            yield
        finally:
            self._holding = False
        self.check()

    def check(self) -> None:
        """Raise the waiting signal, if any."""
        if self._waiting is not None:
            self._raise(self._waiting)

    @contextmanager
    def noted(self) -> Generator[None]:
        """Record signals in `asked` without an interruption."""
        self._noting = True  # before handlers are installed: this one store cannot be interrupted
        installed = not self._before
        try:
            if installed:
                self.__enter__()
            yield
        finally:
            if installed:
                self.__exit__()
            self._noting, self._waiting = False, None

    def _hear(self, number: int, frame: FrameType | None) -> None:
        if self._noting:
            self.asked, self._waiting = True, number
        elif self._holding and self._waiting is None:
            self._waiting = number
        else:
            self._raise(number)

    def _raise(self, number: int) -> NoReturn:
        self._waiting = None
        raise KeyboardInterrupt if number == signal.SIGINT else Terminated(number)
