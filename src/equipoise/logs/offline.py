"""Estimation from external logs, with a report on the segments that are used and on what the log does not determine."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from equipoise.bayesian.method import BayesianMethod
from equipoise.errors import MotionError, RecordingError
from equipoise.estimator.diagnostics.screening import in_order_of_legs, screen_log
from equipoise.estimator.measurements.scale_reading import check_mass_of
from equipoise.estimator.unknowns import Priors
from equipoise.json_form import to_json
from equipoise.logs.finding import LogFinding
from equipoise.logs.motions.gyroscope import compare_gyroscope
from equipoise.logs.motions.segments import LogSegment, find_segments, marked, usable
from equipoise.logs.raw_log import Log, rate
from equipoise.method.method import Method
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.recording.trials import CrawlTrial, LiftTrial, PostureTrial, StandTrial, WalkTrial
from equipoise.result.calibration import Calibration
from equipoise.robot.model import DIAGONALS, LEG_NAMES, RobotModel
from equipoise.robot.stance import Stance, nominal_stance
from equipoise.robot.statics import PLAUSIBLE_LOAD, carried_mass

_CLOCK_TOLERANCE = 5e-3  # [s]: below what the legs resolve; the estimate finds the rest
_WALKING_TILT, _MARKER_POSITION = 0.01, 0.01  # [rad], [m]
_STANDS = 0.05  # [rad] by which a joint of a standing robot moves at most
_UPSIDE_DOWN = 0.7  # cosine of the largest angle between the measured vertical and straight down
_OTHER_ORDERS = (("FR", "FL", "RR", "RL"), ("RL", "RR", "FL", "FR"), ("RR", "RL", "FR", "FL"))
_SLOW = 80.0  # [Hz] on an A1
_OF_SEGMENT = ("start", "end", "kind", "what", "used", "reason_unused")  # in the JSON form


@dataclass(frozen=True, eq=False)
class LogReport:
    """Contents of a log.

    Attributes:
        log: log as it was read.
        segments: pieces of the log, and whether they are used.
        findings: findings of reader, conversion and clocks.
        limitations: messages on what the log does not determine, with the reason.
    """

    log: Log
    segments: tuple[LogSegment, ...]
    findings: tuple[LogFinding, ...]
    limitations: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "about": dict(self.log.about),
            **self.log.joint_map.to_dict(),
            "segments": [{name: getattr(segment, name) for name in _OF_SEGMENT} for segment in self.segments],
            "findings": to_json(self.findings),
            "limitations": list(self.limitations),
        }


@dataclass(frozen=True, eq=False)
class LogEstimate:
    """Result of a log, and the report on that log."""

    result: Calibration
    report: LogReport


def read_segments(robot: RobotModel, log: Log) -> LogReport:
    """Return the report on a log before an estimate, with the segments that an estimate can use.

    Raises:
        RecordingError: nothing in it can be used, or its sensors are not plausible (the error then carries the report); its
            units, signs or order of joints cannot be right.
        MotionError: the IMU is rotated.
    """
    stance = nominal_stance(robot)
    screen_log(robot, log.recording)
    findings = list(log.findings)
    recording = _on_one_clock(robot, stance, log.recording, findings)
    _check_upright(robot, recording)
    findings += _rates(recording, stance)
    segments = find_segments(robot, stance, recording, log.foot_forces, findings)
    report = LogReport(log, tuple(segments), tuple(findings))
    if not usable(segments):
        raise _nothing_usable(report)
    return report


def estimate_log(robot: RobotModel, log: Log, method: BayesianMethod | None = None) -> LogEstimate:
    """Estimate the robot's parameters from a log, by the Bayesian method.

    Raises:
        RecordingError, MotionError: as from `read_segments`.
        SettingsError: the mass does not fit the robot.
    """
    method = method or BayesianMethod()
    if method.mass is not None:
        check_mass_of(robot, method.mass)
    return estimate_segments(robot, read_segments(robot, log), method)


def estimate_segments(
    robot: RobotModel, report: LogReport, method: BayesianMethod, most_walks: int | None = None
) -> LogEstimate:
    """Estimate the robot's parameters from the segments of a log.

    Args:
        most_walks: largest number of pieces of walks to use, evenly spread over the log; default all.

    Raises:
        RecordingError: the estimate failed (the error then carries the report).
    """
    if most_walks is not None:
        report = replace(report, segments=tuple(_with_fewer_walks(report.segments, most_walks)))
    recordings = usable(report.segments)
    method = _with_wide_mounting_prior(method, recordings)
    try:
        result = method.estimate(robot, recordings, nominal_stance(robot), lifts_needed=False)
    except RecordingError as error:
        raise RecordingError(str(error), report, details={"log": report.to_dict()}) from error
    report = replace(report, segments=_judged(report.segments, result))
    return LogEstimate(result, replace(report, limitations=tuple(_limitations(result, report, method))))


def estimate_standing_log(robot: RobotModel, log: Log, method: Method) -> LogEstimate:
    """Estimate from a log of a robot that stands throughout, perhaps of one sample, by a method that needs no motion.

    Raises:
        RecordingError: the joints move, or the method cannot use the recording.
    """
    time, position = log.recording.joints.time, log.recording.joints.position
    moved = np.ptp(position, axis=0)
    if moved.max() > _STANDS:
        raise RecordingError(
            f"the robot does not stand still: {robot.joint_names[int(moved.argmax())]} moves by {moved.max():.2f} rad; at "
            f"most {_STANDS} rad are allowed. Select a part in which it stands with --from and --until"
        )
    torque = log.recording.joints.torque
    carried = 0.0 if torque is None else carried_mass(robot, position.mean(axis=0), torque.mean(axis=0))
    if torque is not None and carried < PLAUSIBLE_LOAD[0] * robot.mass:
        raise RecordingError(
            f"the joint torques carry {carried:.1f} kg of the model's {robot.mass:.1f} kg: the robot lies or hangs, or the "
            "torques have the wrong sign. Record it standing on four feet, or correct the sign"
        )
    start, end = float(time[0]), float(time[-1])
    recording = marked(log.recording, [(Phase.REST, start)], start, np.inf, StandTrial(found_at=start))
    result = method.estimate(robot, [recording], nominal_stance(robot))
    segment = LogSegment(start, end, "rest", "rest on four feet", None, recording)
    return LogEstimate(result, LogReport(log, (segment,), log.findings))


def _with_wide_mounting_prior(method: BayesianMethod, recordings: Sequence[Recording]) -> BayesianMethod:
    """Return the method with prior stds of the IMU's mounting that cover real robots, unless the user set them.

    Stance motions determine the tilt whatever the prior is; after a walk alone the intervals depend on the prior. The markers
    of a pose, in place of an IMU, are placed by hand.
    """
    if method.prior_run is not None:
        return method
    from_pose = recordings[0].imu.pose_noise is not None
    wide: dict[str, float] = {"imu_position": _MARKER_POSITION} if from_pose else {}
    if from_pose or not any(isinstance(one.trial, PostureTrial) for one in recordings):
        wide["imu_tilt"] = _WALKING_TILT
    unset = {name: std for name, std in wide.items() if getattr(method.priors, name) == getattr(Priors(), name)}
    return replace(method, priors=replace(method.priors, **unset))


def _on_one_clock(robot: RobotModel, stance: Stance, recording: Recording, findings: list[LogFinding]) -> Recording:
    """Return the recording with the IMU's stamps shifted so that the gyroscope agrees with the legs."""
    compared = compare_gyroscope(robot, stance, recording)
    if compared is None:
        message = "too little stance motion and too few steps to compare the clocks of joints and IMU"
        findings.append(LogFinding("clocks", message))
        return recording
    if not compared.agrees:
        _check_legs(robot, stance, recording)
        message = (
            f"in {compared.motion} the gyroscope differs from the rotation computed from the legs ({compared.unexplained:.0%} "
            "of the variance): check the joint map, the IMU's axes and the robot model"
        )
        findings.append(LogFinding("gyroscope", message))
        return recording
    if abs(compared.offset) < _CLOCK_TOLERANCE:
        return recording
    later = "late" if compared.offset < 0 else "early"
    message = (
        f"the IMU's time stamps are {abs(compared.offset) * 1000:.0f} ms {later} relative to the joints', by "
        f"{compared.time:.0f} s of {compared.motion}; the estimate corrects them"
    )
    findings.append(LogFinding("clocks", message))
    return replace(recording, imu=replace(recording.imu, time=recording.imu.time + compared.offset))


def _check_legs(robot: RobotModel, stance: Stance, recording: Recording) -> None:
    """Raise RecordingError if the gyroscope agrees with the legs once these are in another order."""
    for order in _OTHER_ORDERS:
        position = in_order_of_legs(robot, recording.joints.position, order)
        if _agrees(robot, stance, replace(recording, joints=replace(recording.joints, position=position))):
            raise RecordingError(
                f"the joints were read in the order of legs {' '.join(LEG_NAMES)}; the gyroscope agrees with the legs only in "
                f"the order {' '.join(order)}: name the joints in a file for --joint-map or --columns"
            )


def _agrees(robot: RobotModel, stance: Stance, recording: Recording) -> bool:
    with suppress(RecordingError, MotionError):
        compared = compare_gyroscope(robot, stance, recording)
        return compared is not None and compared.agrees
    return False


def _check_upright(robot: RobotModel, recording: Recording) -> None:
    """Raise RecordingError for an accelerometer that reads as if the robot lay on its back."""
    usual = np.median(recording.imu.acceleration_in_imu, axis=0)
    upward = float((usual @ np.array(robot.imu_in_base.rotation).T)[2])
    if upward < -_UPSIDE_DOWN * float(np.linalg.norm(usual)):
        raise RecordingError(
            f"the accelerometer reads {upward:.2f} m/s2 upward in the base frame, and a robot that stands reads +9.81: the "
            "accelerometer has the wrong sign, or the IMU hangs upside down. Negate its columns, or give --imu-rpy"
        )


def _rates(recording: Recording, stance: Stance) -> list[LogFinding]:
    wanted = _SLOW / stance.scale.time
    rates = [("joint", rate(recording.joints.time)), ("IMU", rate(recording.imu.time))]
    message = "{} samples come at {:.0f} Hz; a lift lasts half a second and needs {:.0f} Hz"
    return [LogFinding("rates", message.format(name, found, wanted)) for name, found in rates if found < wanted]


def _with_fewer_walks(segments: Sequence[LogSegment], most: int) -> Sequence[LogSegment]:
    walks = [at for at, one in enumerate(segments) if one.recording and isinstance(one.recording.trial, WalkTrial)]
    if len(walks) <= most:
        return segments
    kept = {walks[round(float(at))] for at in np.linspace(0, len(walks) - 1, most)}
    reason = f"{most} of {len(walks)} pieces of walking suffice for this answer"
    return [
        replace(one, recording=None, reason_unused=reason) if at in walks and at not in kept else one
        for at, one in enumerate(segments)
    ]


def _judged(segments: Sequence[LogSegment], result: Calibration) -> tuple[LogSegment, ...]:
    """Return the segments with the estimate's notes: trials are in the order of their recordings."""
    notes = iter([trial.note for trial in result.trials])
    return tuple(one if one.recording is None else replace(one, reason_unused=next(notes)) for one in segments)


def _limitations(result: Calibration, report: LogReport, method: BayesianMethod) -> list[str]:
    """Return messages on what the log does not determine, causes first."""
    trials = [one.recording.trial for one in report.segments if one.used and one.recording is not None]
    diagonals = {trial.diagonal for trial in trials if isinstance(trial, LiftTrial)}
    crawls = any(isinstance(trial, CrawlTrial) for trial in trials)
    pairs = {step.pair for trial in trials if isinstance(trial, WalkTrial) for step in trial.steps}
    messages: list[str] = []
    if pairs and not diagonals:
        messages.append(
            "The robot walks and never lifts two feet from rest: the log does not separate joint offsets and the IMU's "
            "mounting from an offset of the CoM. Record lifts, or stance motions from rest to rest."
        )
        if len(pairs) == 1:
            messages.append(f"All steps are on {pairs.pop()}: the CoM along the line of these feet is not determined.")
    elif not diagonals and crawls:
        messages.append(
            "The robot crawls with at least three feet on the floor: the CoM's height and the inertia are not determined, and "
            "only joint torques determine the CoM's x and y. Record a trot, or lifts of two diagonal feet."
        )
    elif not diagonals:
        messages.append(
            "The log has no lift of two diagonal feet after a rest: the CoM's height and the inertia are not determined, and "
            "only joint torques determine the CoM's x and y."
        )
    elif len(diagonals) < len(DIAGONALS):
        messages.append(
            f"All lifts are on {diagonals.pop()}: they determine the CoM across that line; along it only joint torques do."
        )
    if not pairs and not any(isinstance(trial, PostureTrial) for trial in trials):
        messages.append(
            "The log has no stance motion from rest to rest: joint offsets are not separated from an offset of the CoM."
        )
    if method.mass is None and report.log.recording.joints.torque is None:
        messages.append(
            "The log has no joint torques and no --mass is given: the model file's mass is used. The inertia scales with it, "
            "so its relative uncertainty is that of this mass. Weigh the robot and give --mass."
        )
    for verdict, words in (
        ("doubtful", "Doubtful, because a check failed"),
        ("not identified", "Not identified by this log"),
        ("weak", "Weakly identified"),
    ):
        names = [quantity.name for quantity in result.composite if quantity.verdict == verdict]
        if names:
            messages.append(f"{words}: {', '.join(names)}.")
    return messages


def _nothing_usable(report: LogReport) -> RecordingError:
    by_reason = {segment.reason_unused: segment.what for segment in reversed(report.segments) if segment.reason_unused}
    reasons = dict.fromkeys(f"{what}: {reason_unused}" for reason_unused, what in reversed(by_reason.items()))
    return RecordingError(
        f"nothing in the log can be used. It contains {'; '.join(list(reasons)[:4]) or 'only rests'}. Record rests on four "
        "feet with joint torques, lifts of two diagonal feet, stance motions from rest to rest, a trot, or a crawl with joint "
        "torques",
        report,
        details={"log": report.to_dict()},
    )
