"""The operator at the terminal: turns the robot while a calibration goes on, and confirms a given mass."""

from __future__ import annotations

import select
import sys

from equipoise.alive import alive
from equipoise.errors import MotionError

_WAIT = 0.1  # [s] between signs of life

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


def mass_confirmed(sentence: str) -> bool:
    """Ask the operator whether a given mass is right, while the robot stands.

    Args:
        sentence: given mass and mass that the joint torques carry.
    """
    _forget_what_was_typed()
    print(
        f"\nMass in doubt: {sentence}.\nMass and inertia scale with the given mass. Type yes if it is right and the run is to "
        "go on; anything else ends it:",
        file=sys.stderr, flush=True,
    )  # fmt: skip
    while not select.select([sys.stdin], [], [], _WAIT)[0]:
        alive()
    return sys.stdin.readline().strip().lower() in ("y", "yes")


def _forget_what_was_typed() -> None:
    if sys.stdin.isatty():
        import termios

        termios.tcflush(sys.stdin, termios.TCIFLUSH)
