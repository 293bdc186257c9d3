"""Evaluation of a balance trial, from the simulated truth if available, else from the robot's own estimates."""

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
_ESTIMATED_CLEAR = 0.1  # of the lift's height: the same, estimated from joint encoders and IMU
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
        judged_by: source of the verdict: "truth" or "sensors" (the robot's own estimates).
        com_std: standard deviation of the CoM across the support line [m]; None if the robot fell too soon.
        off_line: mean distance of the CoM in front of the line [m]; None if the robot fell too soon.
        tilt: tilt of the base, mean of the last second [rad].
        largest_tilt: largest tilt of the base [rad].
        largest_torque: largest reported torque of any joint [Nm]; None if torques are not reported.
        rms_torque: root mean square of the torques of all joints [Nm]; None if torques are not reported.
        foot_travel: largest displacement of a standing foot's centre [m]; None without the simulated truth.
        observed_error: observed distance of the design model's CoM in front of the true one [m], or None.
    """

    balanced: bool
    time_balanced: float
    failure: str | None
    judged_by: str
    com_std: float | None
    off_line: float | None
    tilt: float
    largest_tilt: float
    largest_torque: float | None
    rms_torque: float | None
    foot_travel: float | None
    observed_error: float | None


@dataclass(frozen=True, eq=False)
class BalanceTraces:
    """Time series that are evaluated, from the lift on.

    Attributes:
        time: (n,) times from the lift's start [s].
        clearance: (n,) height of the lower lifted foot over the floor [m].
        com_ahead: (n,) distance of the centre of mass in front of the support line [m].
        tilt: (n,) tilt of the base [rad].
        standing: (n,) height of the higher standing foot over the floor [m], or None.
        travel: (n,) largest distance that a standing foot's centre has moved [m], or None.
    """

    time: FloatArray
    clearance: FloatArray
    com_ahead: FloatArray
    tilt: FloatArray
    standing: FloatArray | None = None
    travel: FloatArray | None = None


def estimated_traces(run: BalanceRun) -> BalanceTraces:
    """Return the time series that the robot estimated."""
    estimates = run.estimates
    return BalanceTraces(estimates.time, estimates.clearance, estimates.com_ahead, estimates.tilt)


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


def evaluate(run: BalanceRun, ground_truths: Sequence[GroundTruth] = ()) -> Verdict:
    """Evaluate a trial, from the simulated truth if given, which begins before the lift."""
    traces = true_traces(run, ground_truths) if ground_truths else estimated_traces(run)
    failures = {
        "a lifted foot touched the floor": traces.clearance
        < (_CLEAR if ground_truths else _ESTIMATED_CLEAR * run.swing_height),
        "the base tilted over": traces.tilt > _TILT,
    }
    if traces.standing is not None and traces.travel is not None:
        failures["a standing foot left the floor"] = traces.standing > _STANDING_RISE
        failures["a standing foot slipped away"] = traces.travel > _TRAVEL
    counted = traces.time >= LIFT_GRACE
    first, failure = float(traces.time[-1]), None if run.ending == "balanced" else ENDINGS[run.ending]
    for message, failed in failures.items():
        if (failed & counted).any():
            moment = float(traces.time[np.argmax(failed & counted)])
            if moment < first or failure is None:
                first, failure = moment, message
    time_balanced = run.duration if failure is None else min(first, run.duration)
    return Verdict(
        failure is None, time_balanced, failure, "truth" if ground_truths else "sensors", *_com_std_and_mean(traces, first),
        *_tilts(traces, first), *_torques(run),
        None if traces.travel is None else float(traces.travel[traces.time <= first].max()), _observed_error(run),
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


def _observed_error(run: BalanceRun) -> float | None:
    """Return the mean over the later half, when the observer has settled: it has less noise than the last value."""
    if not run.observing:
        return None
    return -float(run.estimates.offset[run.estimates.time >= run.estimates.time[-1] / 2].mean())


def _ahead(ground_truth: GroundTruth, right: int, left: int) -> float:
    """Return the distance of the true CoM in front of the support plane [m]."""
    along = ground_truth.feet[left] - ground_truth.feet[right]
    forward = np.cross(along, ground_truth.up)
    return float(forward @ (ground_truth.com - ground_truth.feet[right]) / np.linalg.norm(forward))
