"""Data of a balance trial: its recording, and the states that the robot estimated with two feet up."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from equipoise.conventions import FloatArray
from equipoise.recording.recording import Recording

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
        tilt: (n,) angles of the base's z axis from the vertical [rad].
        com_ahead: (n,) distance of the design model's CoM in front of the support line [m].
        clearance: (n,) height of the lower lifted foot over its foothold [m].
    """

    time: FloatArray
    tilt: FloatArray
    com_ahead: FloatArray
    clearance: FloatArray


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
