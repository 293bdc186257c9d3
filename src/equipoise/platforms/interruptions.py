"""Ctrl-C, SIGTERM and a closed terminal, as one thing that Python code can end on; and a while without them."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from types import FrameType
from typing import Any, NoReturn

_DEADLY = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))


class Terminated(KeyboardInterrupt):
    """The process was asked to end by a signal other than Ctrl-C's."""

    def __init__(self, number: int) -> None:
        super().__init__(f"ended by {signal.Signals(number).name}")


@contextmanager
def signals_raise() -> Generator[None]:
    """SIGTERM and SIGHUP raise `Terminated` in the main thread, as Ctrl-C raises KeyboardInterrupt."""

    def end(number: int, frame: FrameType | None) -> NoReturn:
        raise Terminated(number)

    with _handled(_DEADLY, end):
        yield


class Hurry:
    """Whether somebody asked again while something was being ended."""

    def __init__(self) -> None:
        self.asked = False


@contextmanager
def signals_wait() -> Generator[Hurry]:
    """Ctrl-C, SIGTERM and SIGHUP interrupt nothing here; they are noted."""
    hurry = Hurry()

    def note(number: int, frame: FrameType | None) -> None:
        hurry.asked = True

    with _handled((signal.SIGINT, *_DEADLY), note):
        yield hurry


@contextmanager
def _handled(numbers: tuple[Any, ...], handler: Callable[[int, FrameType | None], object]) -> Generator[None]:
    """Signals are the main thread's: elsewhere this does nothing."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, handler) for number in numbers}
    try:
        yield
    finally:
        for number, previous in before.items():
            signal.signal(number, previous)
