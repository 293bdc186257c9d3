"""The operator at the terminal: names the IMU's frame, answers yes or no, turns the robot while a calibration goes on."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import queue
import select
import sys
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from equipoise.errors import MotionError, SettingsError

if TYPE_CHECKING:
    from equipoise.robot.model import RobotModel

_ORIGIN = "origin"
_KEYS = 0.02  # [s] between looks at the keyboard

_ASKED = """
The robot lies limp. Turn it by 180 deg (150 to 210 will do) where it lies, on its belly again, its legs folded; leave the
cable's other end where it is. Then keep clear and press Enter: it stands up. Ctrl-C ends the run."""


class Keyboard:
    """The operator's keyboard while a robot is moved: the space bar stops the robot, lines answer questions.

    Use it as a context manager; at a terminal it reads keys as they are pressed.

    Args:
        stop: function that puts the robot down, as `RemoteRobot.stop`; None: the space bar does nothing.
    """

    def __init__(self, stop: Callable[[str], None] | None = None) -> None:
        self._stop, self._over = stop, threading.Event()
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        self._asked = False

    def __enter__(self) -> Keyboard:
        if self._stop is not None and sys.stdin.isatty():
            self._thread = threading.Thread(target=self._read_keys, name="keyboard", daemon=True)
            self._thread.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._over.set()
        if self._thread is not None:
            self._thread.join()

    def turned(self) -> bool:
        """Return whether Enter was pressed since the first call, which asks for the robot to be turned. It never waits."""
        if not self._asked:
            self._asked = True
            self._ask(_ASKED)
        return self._line() is not None

    def confirmed(self, question: str) -> bool:
        """Ask the operator a question while the robot stands; anything but yes is a no."""
        self._ask(f"\n{question}\nType yes to go on; anything else ends the run:")
        while (line := self._line()) is None:
            time.sleep(_KEYS)
        return line.strip().lower() in ("y", "yes")

    def _ask(self, question: str) -> None:
        while self._thread is not None and self._line() is not None:  # typed before it was asked
            pass
        print(question, file=sys.stderr, flush=True)

    def _line(self) -> str | None:
        """Return a line that was typed, or None; raise MotionError if nothing can be typed."""
        if self._thread is not None:
            with contextlib.suppress(queue.Empty):
                return self._lines.get_nowait()
            return None
        if not select.select([sys.stdin], [], [], 0)[0]:
            return None
        if not (line := sys.stdin.readline()):
            raise MotionError("the operator cannot answer: the standard input is closed. Run it at a terminal")
        return line

    def _read_keys(self) -> None:
        import termios

        descriptor = sys.stdin.fileno()
        before, keys = termios.tcgetattr(descriptor), termios.tcgetattr(descriptor)
        keys[3] &= ~termios.ICANON
        termios.tcsetattr(descriptor, termios.TCSANOW, keys)
        typed = ""
        try:
            while not self._over.is_set():
                if not select.select([descriptor], [], [], _KEYS)[0]:
                    continue
                for key in os.read(descriptor, 64).decode(errors="ignore"):
                    if key == " " and self._stop is not None:
                        self._stop("damp")
                    elif key in "\r\n":
                        self._lines.put(typed)
                        typed = ""
                    else:
                        typed += key
        finally:
            termios.tcsetattr(descriptor, termios.TCSADRAIN, before)


def with_known_imu(model: RobotModel, simulated: bool = False) -> RobotModel:
    """Return the model with a known pose of its IMU: if it is only assumed, ask the operator for the frame.

    A simulated IMU is where the model is assumed to have it: only a frame that may be the IMU's is asked about.

    Raises:
        SettingsError: its pose is not known, and there is no operator, or the answer is not a frame of the base.
    """
    imu = model.imu
    if imu.is_assumed and (imu.proposed or not simulated):
        if not sys.stdin.isatty():
            raise SettingsError(f"the pose of the IMU is not known: {imu.reason}. {_flags(model)}")
        return _described(model, _answer(model))
    return model


def _flags(model: RobotModel) -> str:
    frame = model.imu.proposed[0] if model.imu.proposed else "NAME"
    return (
        f"Give --imu-frame {frame} (frames of the base: {', '.join(model.imu.frames)}), or, if the IMU is at "
        "the origin of the base, --imu-position 0 0 0"
    )


def _answer(model: RobotModel) -> str:
    imu = model.imu
    proposal = f", or press Enter for {imu.proposed[0]!r}" if imu.proposed else ""
    print(
        f"The pose of the IMU is not known: {imu.reason}.\n"
        f"Frames of the base: {', '.join(imu.frames)}.\n"
        f"Type the name of the IMU's frame, or '{_ORIGIN}' if it is at the origin of the base{proposal}: ",
        end="", file=sys.stderr, flush=True,
    )  # fmt: skip
    answer = sys.stdin.readline().strip() or (imu.proposed[0] if imu.proposed else "")
    if not answer:
        raise SettingsError(f"no frame was named. {_flags(model)}")
    return answer


def _described(model: RobotModel, answer: str) -> RobotModel:
    said: dict[str, Any] = {"imu_position": (0.0, 0.0, 0.0)} if answer == _ORIGIN else {"imu_frame": answer}
    described = dataclasses.replace(model, description=dataclasses.replace(model.description, **said))
    _ = described.imu  # raises SettingsError if there is no such frame
    return described
