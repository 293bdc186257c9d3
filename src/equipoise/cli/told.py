"""Somebody at the terminal who turns the robot while a calibration goes on, and says when it is done."""

from __future__ import annotations

import select
import sys

from equipoise.errors import MotionError

_ASKED = """
The robot lies limp. Turn it by 180 deg (150 to 210 will do) where it lies, on its belly again, its legs folded; leave the
cable's other end where it is. Then keep clear and press Enter: it stands up. Ctrl-C ends the run."""


class EnterPressed:
    """Whether Enter was pressed since it was asked for, at the first call.

    It is called in the control loop, which holds the robot meanwhile: it never waits.
    """

    def __init__(self) -> None:
        self._asked = False

    def __call__(self) -> bool:
        if not self._asked:
            self._asked = True
            _forget_what_was_typed()
            print(_ASKED, file=sys.stderr, flush=True)
        if not select.select([sys.stdin], [], [], 0)[0]:
            return False
        if not sys.stdin.readline():
            raise MotionError(
                "nobody can say that the robot was turned: the standard input is closed. Run it at a terminal"
            )
        return True


def _forget_what_was_typed() -> None:
    if sys.stdin.isatty():
        import termios

        termios.tcflush(sys.stdin, termios.TCIFLUSH)
