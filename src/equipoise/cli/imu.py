"""The pose of the IMU before a command uses it: stated, asked for at a terminal, or refused in a script."""

from __future__ import annotations

import dataclasses
import sys
from typing import TYPE_CHECKING, Any

from equipoise.errors import SettingsError

if TYPE_CHECKING:
    from equipoise.robot.model import RobotModel

_ORIGIN = "origin"


def with_known_imu(model: RobotModel, silent: bool, simulated: bool = False) -> RobotModel:
    """State where the IMU is; if that is only assumed, ask the operator for its frame.

    A simulated IMU is where the model is assumed to have it: only a frame that may be the IMU's is asked about.

    Args:
        silent: whether nothing is printed but a question.

    Raises:
        SettingsError: its pose is not known, and there is no operator, or the answer is no frame of the base.
    """
    imu = model.imu
    if imu.is_assumed and (imu.proposed or not simulated):
        if not sys.stdin.isatty():
            raise SettingsError(f"the pose of the IMU is not known: {imu.reason}. {_flags(model)}")
        model = _described(model, _answer(model))
    if not silent:
        print(model.imu.sentence, file=sys.stderr)
    return model


def _flags(model: RobotModel) -> str:
    from equipoise.robot.imu import frames_on_base

    frame = model.imu.proposed[0] if model.imu.proposed else "NAME"
    return (
        f"Give --imu-frame {frame} (frames of the base: {', '.join(frames_on_base(model.pinocchio))}), or, if the IMU is at "
        "the origin of the base, --imu-position 0 0 0"
    )


def _answer(model: RobotModel) -> str:
    from equipoise.robot.imu import frames_on_base

    imu = model.imu
    proposal = f", or press Enter for {imu.proposed[0]!r}" if imu.proposed else ""
    print(
        f"The pose of the IMU is not known: {imu.reason}.\n"
        f"Frames of the base: {', '.join(frames_on_base(model.pinocchio))}.\n"
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
    assert described.imu.described  # raises SettingsError where there is no such frame
    return described
