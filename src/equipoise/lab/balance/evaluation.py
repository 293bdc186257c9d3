"""Evaluation of a balance trial of a simulated robot from its true states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.lab.balance.run import ENDINGS, BalanceRun
from equipoise.lab.balance.two_foot_posture import stance_legs
from equipoise.robot.description import LEG_NAMES
from equipoise.simulation.ground_truth_view import GroundTruth

LIFT_GRACE = 0.2  # [s] from the lift's start without evaluation
_SETTLING = 2.0  # [s] after the lift, not part of the statistics of the CoM
# Limits of a balanced robot. A foot's centre also travels as its sphere rolls: 8 mm for 0.4 rad of an A1's shank.
_CLEAR = 0.5e-3  # [m], least true height of lifted feet above the floor
_STANDING_RISE = 10e-3  # [m], largest height of a standing foot above the floor
_TRAVEL = 20e-3  # [m], largest displacement of a standing foot's centre
_TILT = 0.6  # [rad]


@dataclass(frozen=True)
class Verdict:
    """Result of a trial.

    Attributes:
        balanced: true if the robot stood on two feet for the whole requested time.
        time_balanced: time on two feet [s].
        failure: description of the event that ended the trial, or None.
        com_std: standard deviation of the CoM across the support line [m]; None if the robot fell too soon.
        off_line: mean distance of the CoM in front of the line [m]; None if the robot fell too soon.
        tilt: tilt of the base, mean of the last second [rad].
        largest_tilt: largest tilt of the base [rad].
        largest_torque: largest reported torque of any joint [Nm]; None if torques are not reported.
        rms_torque: root mean square of the torques of all joints [Nm]; None if torques are not reported.
        foot_travel: largest displacement of a standing foot's centre [m].
    """

    balanced: bool
    time_balanced: float
    failure: str | None
    com_std: float | None
    off_line: float | None
    tilt: float
    largest_tilt: float
    largest_torque: float | None
    rms_torque: float | None
    foot_travel: float


@dataclass(frozen=True, eq=False)
class BalanceTraces:
    """Time series that are evaluated, from the lift on.

    Attributes:
        time: (n,) times from the lift's start [s].
        clearance: (n,) height of the lower lifted foot over the floor [m].
        com_ahead: (n,) distance of the centre of mass in front of the support line [m].
        tilt: (n,) tilt of the base [rad].
        standing: (n,) height of the higher standing foot over the floor [m].
        travel: (n,) largest distance that a standing foot's centre has moved [m].
    """

    time: FloatArray
    clearance: FloatArray
    com_ahead: FloatArray
    tilt: FloatArray
    standing: FloatArray
    travel: FloatArray


def true_traces(run: BalanceRun, ground_truths: Sequence[GroundTruth]) -> BalanceTraces:
    """Return the true time series of a simulated robot."""
    end = run.lift_off + float(run.estimates.time[-1])
    states = [truth for truth in ground_truths if run.lift_off - 1e-9 <= truth.time <= end + 1e-9]
    right, left = (LEG_NAMES.index(leg) for leg in stance_legs(run.diagonal))
    lifted = [row for row in range(4) if row not in (right, left)]
    clearance = np.array([state.clearance for state in states])
    feet = np.array([state.feet for state in states])[:, [right, left], :2]
    return BalanceTraces(
        np.array([state.time - run.lift_off for state in states]),
        clearance[:, lifted].min(axis=1),
        np.array([_ahead(state, right, left) for state in states]),
        np.array([state.tilt for state in states]),
        clearance[:, [right, left]].max(axis=1),
        np.linalg.norm(feet - feet[0], axis=2).max(axis=1),
    )


def evaluate(run: BalanceRun, traces: BalanceTraces) -> Verdict:
    """Evaluate a trial from its true time series."""
    failures = {
        "a lifted foot touched the floor": traces.clearance < _CLEAR,
        "the base tilted over": traces.tilt > _TILT,
        "a standing foot left the floor": traces.standing > _STANDING_RISE,
        "a standing foot slipped away": traces.travel > _TRAVEL,
    }
    counted = traces.time >= LIFT_GRACE
    first, failure = float(traces.time[-1]), None if run.ending == "balanced" else ENDINGS[run.ending]
    for message, failed in failures.items():
        if (failed & counted).any():
            moment = float(traces.time[np.argmax(failed & counted)])
            if moment < first or failure is None:
                first, failure = moment, message
    time_balanced = run.duration if failure is None else min(first, run.duration)
    return Verdict(
        failure is None, time_balanced, failure, *_com_std_and_mean(traces, first), *_tilts(traces, first), *_torques(run),
        float(traces.travel[traces.time <= first].max()),
    )  # fmt: skip


def _com_std_and_mean(traces: BalanceTraces, end: float) -> tuple[float | None, float | None]:
    settled = traces.com_ahead[(traces.time > _SETTLING) & (traces.time <= end)]
    return (float(settled.std()), float(settled.mean())) if settled.size else (None, None)


def _tilts(traces: BalanceTraces, end: float) -> tuple[float, float]:
    until = traces.time <= end
    return float(traces.tilt[until & (traces.time >= end - 1)].mean()), float(traces.tilt[until].max())


def _torques(run: BalanceRun) -> tuple[float | None, float | None]:
    joints = run.recording.between(run.lift_off, run.lift_off + float(run.estimates.time[-1])).joints
    if joints.torque is None:
        return None, None
    return float(np.abs(joints.torque).max()), float(np.sqrt(np.mean(joints.torque**2)))


def _ahead(ground_truth: GroundTruth, right: int, left: int) -> float:
    """Return the distance of the true CoM in front of the support plane [m]."""
    along = ground_truth.feet[left] - ground_truth.feet[right]
    forward = np.cross(along, ground_truth.up)
    return float(forward @ (ground_truth.com - ground_truth.feet[right]) / np.linalg.norm(forward))
