"""Prompts for the operator at the terminal: IMU frame, confirmation, rotation of the robot during a calibration."""

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
_KEYS = 0.02  # [s] between polls of the keyboard

_ROTATION_PROMPT = """
The joints are damped. Turn the robot by 180 deg (150 to 210 is enough) on the spot, on its belly with folded legs. Do not move
the far end of the cable. Then keep clear and press Enter: the robot stands up. Ctrl-C ends the run."""


class Keyboard:
    """Keyboard of the operator while a robot moves: the space bar stops the robot, lines answer questions.

    Use it as a context manager; at a terminal it reads single keys.

    Args:
        stop: function that stops the robot, such as `RemoteRobot.stop`; None: the space bar has no effect.
    """

    def __init__(self, stop: Callable[[str], None] | None = None) -> None:
        self._stop, self._over = stop, threading.Event()
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        self._prompted = False

    def __enter__(self) -> Keyboard:
        if self._stop is not None and sys.stdin.isatty():
            self._thread = threading.Thread(target=self._read_keys, name="keyboard", daemon=True)
            self._thread.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._over.set()
        if self._thread is not None:
            self._thread.join()

    def rotation_confirmed(self) -> bool:
        """Return true once Enter was pressed after the first call, which prints the prompt. It does not block."""
        if not self._prompted:
            self._prompted = True
            self._ask(_ROTATION_PROMPT)
        return self._line() is not None

    def confirmed(self, question: str) -> bool:
        """Ask a question while the robot stands; return true only for "y" or "yes"."""
        self._ask(f"\n{question}\nType yes to continue; any other answer ends the run:")
        while (line := self._line()) is None:
            time.sleep(_KEYS)
        return line.strip().lower() in ("y", "yes")

    def _ask(self, question: str) -> None:
        while self._thread is not None and self._line() is not None:  # discard lines typed before the question
            pass
        print(question, file=sys.stderr, flush=True)

    def _line(self) -> str | None:
        """Return a typed line, or None; raises MotionError if the standard input is closed."""
        if self._thread is not None:
            with contextlib.suppress(queue.Empty):
                return self._lines.get_nowait()
            return None
        if not select.select([sys.stdin], [], [], 0)[0]:
            return None
        if not (line := sys.stdin.readline()):
            raise MotionError("no answer is possible: the standard input is closed; run the command at a terminal")
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


def with_imu_pose(model: RobotModel, simulated: bool = False) -> RobotModel:
    """Return the model with the pose of its IMU; if it is only assumed, ask the operator for the frame.

    In simulation the assumed pose is correct, so the operator is asked only if the model has a candidate frame.

    Raises:
        SettingsError: the pose is unknown and there is no terminal, or the answer is not a frame of the base.
    """
    if (reason := imu_pose_missing(model, simulated)) is not None:
        if not sys.stdin.isatty():
            raise SettingsError(reason)
        return _described(model, _answer(model))
    return model


def imu_pose_missing(model: RobotModel, simulated: bool) -> str | None:
    """Return why a run needs the pose of the IMU, and the flags that give it; None if the model's pose suffices."""
    if not model.imu.is_assumed or (simulated and not model.imu.proposed):
        return None
    return f"the pose of the IMU is not known: {model.imu.reason}. {_flags(model)}"


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
        raise SettingsError(f"no IMU frame was given. {_flags(model)}")
    return answer


def _described(model: RobotModel, answer: str) -> RobotModel:
    pose: dict[str, Any] = {"imu_position": (0.0, 0.0, 0.0)} if answer == _ORIGIN else {"imu_frame": answer}
    described = dataclasses.replace(model, description=dataclasses.replace(model.description, **pose))
    _ = described.imu  # raises SettingsError if the frame does not exist
    return described
