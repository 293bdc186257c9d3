"""Data of a balance trial: its recording, and the states that the robot estimated with two feet up."""

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
class StateEstimates:
    """States estimated from joint encoders, IMU and the design model, once a control period.

    Attributes:
        time: (n,) times from the moment at which two feet began to lift [s].
        up_in_base: (n, 3) unit vector against gravity, in base axes.
        com_ahead: (n,) distance of the design model's CoM in front of the support line [m].
        clearance: (n,) height of the lower lifted foot over its foothold [m].
    """

    time: FloatArray
    up_in_base: FloatArray
    com_ahead: FloatArray
    clearance: FloatArray

    @property
    def tilt(self) -> FloatArray:
        """Angles (n,) of the base's z axis from the vertical [rad]."""
        return np.arccos(np.clip(self.up_in_base[:, 2], -1, 1))


@dataclass(frozen=True, eq=False)
class BalanceRun:
    """Trial on one diagonal.

    Attributes:
        diagonal: diagonal that the robot stood on.
        duration: requested time on two feet [s].
        lift_off: time at which two feet began to lift [s].
        ending: reason why the controller was switched off.
        recording: recording of the trial, with phases rest, move, unload, lift, balance, lower.
        estimates: estimated states from the lift to the end.
        unstable_pole: rate at which the design model with locked joints tips over [1/s].
    """

    diagonal: str
    duration: float
    lift_off: float
    ending: Ending
    recording: Recording
    estimates: StateEstimates
    unstable_pole: float


class TrialSamples:
    """Samples, commands and estimates of a trial in progress."""

    def __init__(self) -> None:
        self._samples: list[tuple[RobotState, FloatArray]] = []
        self._events: list[Event] = []
        self._estimates: list[tuple[float, FloatArray, float, float]] = []

    def phase(self, name: str, time: float) -> None:
        """Record the beginning of a phase."""
        self._events.append(Event(time, PHASE, {"name": name}))

    def add(self, state: RobotState, target: FloatArray) -> None:
        """Add a sample and the joint targets that follow from it, unless it is not newer than the last one."""
        if not self._samples or state.time > self._samples[-1][0].time:
            self._samples.append((state, target))

    def add_estimate(self, time: float, up: FloatArray, com_ahead: float, clearance: float) -> None:
        """Add an estimate as in `StateEstimates`, with the platform's time [s]."""
        self._estimates.append((time, up, com_ahead, clearance))

    def estimates(self, lift_off: float) -> StateEstimates:
        """Return all estimates."""
        time, up, ahead, clearance = (np.array(column) for column in zip(*self._estimates, strict=True))
        return StateEstimates(time - lift_off, up, ahead, clearance)

    def recording(self, joint_names: tuple[str, ...]) -> Recording:
        """Return all samples and commands, without samples that are not finite."""
        finite = [(state, target) for state, target in self._samples if _finite(state)]
        targets = np.array([target for _, target in finite])
        return recording_of(joint_names, [state for state, _ in finite], targets, tuple(self._events))


def _finite(state: RobotState) -> bool:
    arrays = (
        state.joint_position, state.joint_velocity, state.joint_torque,
        state.angular_velocity_in_imu, state.acceleration_in_imu,
    )  # fmt: skip
    return all(array is None or bool(np.isfinite(array).all()) for array in arrays)
