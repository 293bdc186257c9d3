"""Did it balance? By what a bystander saw, where there was one, else by what the robot felt of itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.lab.balance.run import ENDINGS, BalanceRun
from equipoise.lab.balance.two_foot_posture import stance_legs
from equipoise.robot.description import LEG_NAMES
from equipoise.simulation.ground_truth_view import GroundTruth

LIFT_GRACE = 0.2  # [s] from the lift's start, before which nothing is judged
_SETTLING = 2.0  # [s] after the lift, before which sway is not counted
# What balancing means. A foot's centre also travels as its sphere rolls: 8 mm for 0.4 rad of an A1's shank.
_CLEAR = 0.5e-3  # [m] that lifted feet must be above the floor, as a bystander sees it
_FELT_CLEAR = 0.1  # of the lift's height: the same, as joint encoders and IMU feel it
_PLANTED = 10e-3  # [m] that a standing foot may leave the floor
_TRAVEL = 20e-3  # [m] that the centre of a standing foot may move
_TILT = 0.6  # [rad]


@dataclass(frozen=True)
class Verdict:
    """How a trial went.

    Attributes:
        balanced: whether it stood on two feet for all of the time that was asked for.
        time_balanced: time for which it did [s].
        failure: event that ended it, in words; None if nothing did.
        judged_by: source of the verdict: "truth" or "senses".
        excitation: rms of the centre of mass about its mean, across the support line [m]; None if it fell too soon.
        off_line: mean of the distance of the centre of mass in front of the line [m]; likewise.
        tilt: tilt of the base, mean of the last second [rad].
        largest_tilt: largest tilt of the base [rad].
        largest_torque: largest torque of any joint, as reported [Nm]; None where torques are not.
        rms_torque: root mean square of the torques of all joints [Nm]; likewise.
        foot_travel: largest distance that the centre of a standing foot moved [m]; None without a bystander.
        observed_error: distance of the believed centre of mass in front of the true one, as observed [m]; None if it
            was not.
    """

    balanced: bool
    time_balanced: float
    failure: str | None
    judged_by: str
    excitation: float | None
    off_line: float | None
    tilt: float
    largest_tilt: float
    largest_torque: float | None
    rms_torque: float | None
    foot_travel: float | None
    observed_error: float | None


@dataclass(frozen=True, eq=False)
class BalanceTraces:
    """What is judged: from the lift on, by whichever eyes.

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


def felt_traces(run: BalanceRun) -> BalanceTraces:
    """As the robot felt it."""
    felt = run.felt
    return BalanceTraces(felt.time, felt.clearance, felt.com_ahead, felt.tilt)


def seen_traces(run: BalanceRun, ground_truths: Sequence[GroundTruth]) -> BalanceTraces:
    """As a bystander saw it."""
    end = run.lift_off + float(run.felt.time[-1])
    seen = [ground_truth for ground_truth in ground_truths if run.lift_off - 1e-9 <= ground_truth.time <= end + 1e-9]
    right, left = (LEG_NAMES.index(leg) for leg in stance_legs(run.diagonal))
    lifted = [row for row in range(4) if row not in (right, left)]
    clearance = np.array([ground_truth.clearance for ground_truth in seen])
    feet = np.array([ground_truth.feet for ground_truth in seen])[:, [right, left], :2]
    return BalanceTraces(
        np.array([ground_truth.time - run.lift_off for ground_truth in seen]),
        clearance[:, lifted].min(axis=1),
        np.array([_ahead(ground_truth, right, left) for ground_truth in seen]),
        np.array([ground_truth.tilt for ground_truth in seen]),
        clearance[:, [right, left]].max(axis=1),
        np.linalg.norm(feet - feet[0], axis=2).max(axis=1),
    )


def judge(run: BalanceRun, ground_truths: Sequence[GroundTruth] = ()) -> Verdict:
    """Judge a trial; with glimpses, which begin before the lift, by them."""
    traces = seen_traces(run, ground_truths) if ground_truths else felt_traces(run)
    failures = {
        "a lifted foot touched the floor": traces.clearance
        < (_CLEAR if ground_truths else _FELT_CLEAR * run.swing_height),
        "the base tilted over": traces.tilt > _TILT,
    }
    if traces.standing is not None and traces.travel is not None:
        failures["a standing foot left the floor"] = traces.standing > _PLANTED
        failures["a standing foot slipped away"] = traces.travel > _TRAVEL
    counted = traces.time >= LIFT_GRACE
    first, failure = float(traces.time[-1]), None if run.ending == "balanced" else ENDINGS[run.ending]
    for message, failed in failures.items():
        if (failed & counted).any():
            moment = float(traces.time[np.argmax(failed & counted)])
            if moment < first or failure is None:
                first, failure = moment, message
    stood = run.duration if failure is None else min(first, run.duration)
    return Verdict(
        failure is None, stood, failure, "truth" if ground_truths else "senses", *_excitation(traces, first), *_tilts(traces,
        first), *_torques(run), None if traces.travel is None else float(traces.travel[traces.time <= first].max()),
        _observed_error(run),
    )  # fmt: skip


def _excitation(traces: BalanceTraces, end: float) -> tuple[float | None, float | None]:
    settled = traces.com_ahead[(traces.time > _SETTLING) & (traces.time <= end)]
    return (float(settled.std()), float(settled.mean())) if settled.size else (None, None)


def _tilts(traces: BalanceTraces, end: float) -> tuple[float, float]:
    until = traces.time <= end
    return float(traces.tilt[until & (traces.time >= end - 1)].mean()), float(traces.tilt[until].max())


def _torques(run: BalanceRun) -> tuple[float | None, float | None]:
    joints = run.recording.between(run.lift_off, run.lift_off + float(run.felt.time[-1])).joints
    if joints.torque is None:
        return None, None
    return float(np.abs(joints.torque).max()), float(np.sqrt(np.mean(joints.torque**2)))


def _observed_error(run: BalanceRun) -> float | None:
    """Mean over the later half: less noise than the last value, and the observer has settled."""
    if not run.observing:
        return None
    return -float(run.felt.offset[run.felt.time >= run.felt.time[-1] / 2].mean())


def _ahead(ground_truth: GroundTruth, right: int, left: int) -> float:
    """Of the true centre of mass in front of the plane through the feet that holds gravity [m]."""
    along = ground_truth.feet[left] - ground_truth.feet[right]
    forward = np.cross(along, ground_truth.up)
    return float(forward @ (ground_truth.com - ground_truth.feet[right]) / np.linalg.norm(forward))
