"""The operator at the terminal: names the IMU's frame, confirms a given mass, turns the robot while a calibration goes on."""

from __future__ import annotations

import dataclasses
import select
import sys
from typing import TYPE_CHECKING, Any

from equipoise.alive import alive
from equipoise.errors import MotionError, SettingsError

if TYPE_CHECKING:
    from equipoise.robot.model import RobotModel

_ORIGIN = "origin"
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
