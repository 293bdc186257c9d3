"""Samples of each equation from the recordings of a run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError
from equipoise.estimator.equations.equation import MotionSamples, RunContext
from equipoise.estimator.equations.table import EQUATIONS
from equipoise.estimator.measurements.heading import angle_turned
from equipoise.estimator.measurements.leg_motion import LegChains
from equipoise.estimator.measurements.walking import gyro_bias_of_walks
from equipoise.method.combined import base_recordings
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.recording.trials import MotorTrial, SteppingTrial, TurnTrial
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance


def read_motions(robot: RobotModel, stance: Stance, recordings: Sequence[Recording]) -> tuple[MotionSamples, ...]:
    """Read all recordings of a run; a motion states the reason if its recording cannot be read.

    Raises:
        RecordingError: no recording has a rest or a walk.
    """
    bias = _gyro_bias(base_recordings(recordings))
    legs, headings = LegChains(robot), _headings(robot, recordings)
    ends = np.cumsum([0.0 if isinstance(one.trial, MotorTrial) else one.duration for one in recordings])
    when = (ends - ends[-1] / 2) / ends[-1]
    return tuple(
        _read(RunContext(robot, stance, legs, bias, float(when[index]), float(headings[index])), index, recording)
        for index, recording in enumerate(recordings)
    )


def _read(run: RunContext, index: int, recording: Recording) -> MotionSamples:
    samples: list[object] = []
    left_out: str | None = None
    for equation in EQUATIONS:
        try:
            samples += equation.read(run, recording)
        except RecordingError as error:
            left_out = left_out or str(error)
    trial = recording.trial
    duration = trial.duration if isinstance(trial, SteppingTrial) else recording.duration
    return MotionSamples(index, trial, tuple(samples), left_out, duration)


def _gyro_bias(recordings: Sequence[Recording]) -> FloatArray:
    """Return the (3,) bias of the gyroscope, in the IMU frame [rad/s]."""
    rested = [recording for recording in recordings if recording.has_phase(Phase.REST)]
    if rested:  # the median over rests ignores one in which the robot still moved
        rests = [recording.phase(Phase.REST).imu.angular_velocity_in_imu for recording in rested]
        return np.asarray(np.median([rest.mean(axis=0) for rest in rests], axis=0), dtype=float)
    walks = [one.imu for one in recordings if isinstance(one.trial, SteppingTrial)]
    if not walks:
        raise RecordingError(
            "the recordings contain no rest before a lift or after a stance motion; record them with --method bayesian"
        )
    return gyro_bias_of_walks([(imu.time, imu.angular_velocity_in_imu, imu.acceleration_in_imu) for imu in walks])


def _headings(robot: RobotModel, recordings: Sequence[Recording]) -> FloatArray:
    """Return the (n,) heading at the end of each recording, relative to the run's start, positive to the left [rad]."""
    turned = [isinstance(recording.trial, TurnTrial) and recording.complete for recording in recordings]
    angles = [angle_turned(robot, one) if complete else 0.0 for one, complete in zip(recordings, turned, strict=True)]
    return np.cumsum(angles)
