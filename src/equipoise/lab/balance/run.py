"""What a balance trial leaves behind: its recording, and what the robot felt of itself while two feet were up."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.platform.platform import RobotState
from equipoise.platform.stepping import recording_of
from equipoise.recording.recording import PHASE, Event, Recording

Ending = Literal["balanced", "tilted", "touched"]
ENDINGS: dict[Ending, str] = {
    "balanced": "the time was over",
    "tilted": "the base tilted beyond the limit",
    "touched": "a lifted foot came down",
}


@dataclass(frozen=True, eq=False)
class Felt:
    """What the robot felt of itself, by joint encoders, IMU and the believed model, once a control period.

    Attributes:
        time: (n,) times from the moment at which two feet began to lift [s].
        up_in_base: (n, 3) unit vector against gravity, in base axes.
        com_ahead: (n,) distance of the believed centre of mass in front of the support line [m].
        clearance: (n,) height of the lower one of the lifted feet, over where it stood [m].
        offset: (n,) distance of the true centre of mass in front of the believed one, as observed; zero if it was not
            [m].
    """

    time: FloatArray
    up_in_base: FloatArray
    com_ahead: FloatArray
    clearance: FloatArray
    offset: FloatArray

    @property
    def tilt(self) -> FloatArray:
        """(n,) of the base's z axis from up [rad]."""
        return np.arccos(np.clip(self.up_in_base[:, 2], -1, 1))


@dataclass(frozen=True, eq=False)
class BalanceRun:
    """One trial on one diagonal.

    Attributes:
        robot: name of the robot.
        diagonal: diagonal that it stood on.
        duration: time for which it was to balance, once its feet were up [s].
        swing_height: height of the lifted feet, as commanded [m].
        observing: whether the offset of the centre of mass was observed.
        lift_off: time at which two feet began to lift [s].
        ending: reason why the law was switched off.
        recording: recording of all of it, with phases rest, move, unload, lift, balance, lower.
        felt: samples from the lift to the end.
        unstable_pole: rate at which the believed robot with locked joints tips over [1/s].
    """

    robot: str
    diagonal: str
    duration: float
    swing_height: float
    observing: bool
    lift_off: float
    ending: Ending
    recording: Recording
    felt: Felt
    unstable_pole: float


class TrialSamples:
    """Collects what is sensed, sent and felt while a trial runs."""

    def __init__(self) -> None:
        self._samples: list[tuple[RobotState, FloatArray]] = []
        self._events: list[Event] = []
        self._felt: list[tuple[float, FloatArray, float, float, float]] = []

    def phase(self, name: str, time: float) -> None:
        """A phase begins."""
        self._events.append(Event(time, PHASE, {"name": name}))

    def add(self, state: RobotState, target: FloatArray) -> None:
        """A sample, and the joint targets that are sent on it; a moment that is there already stays as it is."""
        if not self._samples or state.time > self._samples[-1][0].time:
            self._samples.append((state, target))

    def feel(self, time: float, up_in_base: FloatArray, com_ahead: float, clearance: float, offset: float) -> None:
        """What the robot feels of itself, as in `Felt`; the time is the platform's [s]."""
        self._felt.append((time, up_in_base, com_ahead, clearance, offset))

    def felt(self, lift_off: float) -> Felt:
        """All that was felt."""
        time, up, ahead, clearance, offset = (np.array(column) for column in zip(*self._felt, strict=True))
        return Felt(time - lift_off, up, ahead, clearance, offset)

    def recording(self, joint_names: tuple[str, ...]) -> Recording:
        """All that was sensed and sent, without samples that hold no numbers."""
        good = [(state, target) for state, target in self._samples if _finite(state)]
        targets = np.array([target for _, target in good])
        return recording_of(joint_names, [state for state, _ in good], targets, tuple(self._events))


def _finite(state: RobotState) -> bool:
    arrays = (
        state.joint_position, state.joint_velocity, state.joint_torque,
        state.angular_velocity_in_imu, state.acceleration_in_imu,
    )  # fmt: skip
    return all(array is None or bool(np.isfinite(array).all()) for array in arrays)
