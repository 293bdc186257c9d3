"""From recordings to what the precise estimators need: lifts, planted moves and torques, and why others were left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError
from equipoise.estimator.measurements.heading import angle_turned
from equipoise.estimator.measurements.imu_place import SwaySamples
from equipoise.estimator.measurements.leg_motion import LegChains
from equipoise.estimator.measurements.leg_swing import LegSwing
from equipoise.estimator.measurements.lift_samples import LiftSamples, read_lift
from equipoise.estimator.measurements.planted_moves import PlantedMove, read_move
from equipoise.estimator.measurements.torque_balance import TorqueSamples
from equipoise.estimator.measurements.walking import gyro_bias_of_walks, read_walk
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.recording.trials import (
    CrawlTrial,
    LiftTrial,
    PostureTrial,
    RecordedTrial,
    SteppingTrial,
    SwayTrial,
    TurnTrial,
    WalkTrial,
)
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance


@dataclass(frozen=True, eq=False)
class MotionReading:
    """One recording: what it is, and what could be read from it.

    Attributes:
        index: index of the recording in the run.
        trial: trial that it is of; None if it does not say.
        lift, move: samples of a lift and a planted move; None if it holds none.
        torques: joint torques.
        left_out: reason why a lift could not be read, or None.
        duration: duration of the recording [s].
        steps: samples of a walk, of each time on two feet.
        leg_swing: what legs that swing in the air say of themselves.
        sway: samples of a sway.
    """

    index: int
    trial: RecordedTrial | None
    lift: LiftSamples | None
    move: PlantedMove | None
    torques: tuple[TorqueSamples, ...]
    left_out: str | None
    duration: float
    steps: tuple[LiftSamples, ...] = ()
    leg_swing: LegSwing | None = None
    sway: SwaySamples | None = None

    @property
    def on_two_feet(self) -> tuple[LiftSamples, ...]:
        """The lift or the steps."""
        return self.steps if self.lift is None else (self.lift, *self.steps)


@dataclass(frozen=True, eq=False)
class RunEvidence:
    """All motions of a run.

    Attributes:
        motions: readings of all recordings, in order.
    """

    motions: tuple[MotionReading, ...]

    def with_swing(self, swing: LegSwing) -> RunEvidence:
        """The same, and legs that swung in the air after it."""
        last = MotionReading(len(self.motions), swing.trial, None, None, (), None, swing.duration, leg_swing=swing)
        return RunEvidence((*self.motions, last))


def read_evidence(robot: RobotModel, stance: Stance, recordings: Sequence[Recording]) -> RunEvidence:
    """Read all recordings of a run; broken ones are noted, not raised.

    Raises:
        RecordingError: nothing in them can be used.
    """
    bias = _gyro_bias(recordings)
    legs, headings = LegChains(robot), _headings(robot, recordings)
    ends = np.cumsum([recording.duration for recording in recordings])
    when = (ends - ends[-1] / 2) / ends[-1]
    return RunEvidence(
        tuple(
            _read(robot, stance, legs, index, recording, bias, float(when[index]), float(headings[index]))
            for index, recording in enumerate(recordings)
        )
    )


def _gyro_bias(recordings: Sequence[Recording]) -> FloatArray:
    """(3,) bias of the gyroscope, in the IMU frame [rad/s]."""
    rested = [recording for recording in recordings if recording.has_phase(Phase.REST)]
    if rested:  # the median over rests: one in which the robot still swayed does not count
        rests = [recording.phase(Phase.REST).imu.angular_velocity_in_imu for recording in rested]
        return np.asarray(np.median([rest.mean(axis=0) for rest in rests], axis=0), dtype=float)
    walks = [one.imu for one in recordings if isinstance(one.trial, SteppingTrial)]
    if not walks:
        raise RecordingError(
            "the recordings hold no rest before a lift or after a move; are they of the precise method?"
        )
    return gyro_bias_of_walks([(imu.time, imu.angular_velocity_in_imu, imu.acceleration_in_imu) for imu in walks])


def _headings(robot: RobotModel, recordings: Sequence[Recording]) -> FloatArray:
    """(n,) angle by which the robot had been turned in the room when each recording ended, to its left [rad]."""
    turned = [isinstance(recording.trial, TurnTrial) and recording.complete for recording in recordings]
    angles = [angle_turned(robot, recording) if was else 0.0 for recording, was in zip(recordings, turned, strict=True)]
    return np.cumsum(angles)


def _read(
    robot: RobotModel, stance: Stance, legs: LegChains, index: int, recording: Recording, gyro_bias: FloatArray,
    when: float, heading: float,
) -> MotionReading:  # fmt: skip
    trial = recording.trial
    lift: LiftSamples | None = None
    steps: tuple[LiftSamples, ...] = ()
    move: PlantedMove | None = None
    sway: SwaySamples | None = None
    torques: list[TorqueSamples] = []
    left_out: str | None = None
    try:
        if recording.has_phase(Phase.REST) and (rest := TorqueSamples.of_rest(recording.phase(Phase.REST))) is not None:
            torques.append(rest)
        if isinstance(trial, LiftTrial) and recording.complete:
            read = read_lift(robot, legs, recording, trial.diagonal, stance, gyro_bias)
            if isinstance(read, str):
                left_out = read
            else:
                lift = replace(read, when=when, heading=heading)
        elif isinstance(trial, LiftTrial):
            refused = "not lifted: out of reach, or the robot could have tipped over"
            left_out = refused if recording.refused else "interrupted"
        elif isinstance(trial, PostureTrial) and recording.complete:
            moving = recording.phase(Phase.MOVE, until=Phase.REST)
            move = read_move(robot, legs, recording.phase(Phase.BEFORE), moving, recording.phase(Phase.REST), gyro_bias)
            move = replace(move, when=when, heading=heading)
            samples = TorqueSamples.of_motion(moving, gyro_bias, stance.scale.time)
            torques += [] if samples is None else [samples]
        elif isinstance(trial, SwayTrial) and recording.complete:
            swaying = recording.phase(Phase.SWAY)
            sway = SwaySamples.of(swaying, gyro_bias)
            samples = TorqueSamples.of_motion(swaying, gyro_bias, stance.scale.time)
            torques += [] if samples is None else [samples]
        elif isinstance(trial, WalkTrial) and recording.complete:
            steps, left_out = read_walk(recording, trial, stance, gyro_bias)
            steps = tuple(replace(step, when=when) for step in steps)
        elif isinstance(trial, CrawlTrial) and recording.complete:
            on_three = (
                TorqueSamples.of_motion(
                    recording.between(step.start, step.end), gyro_bias, stance.scale.time, step.lifted
                )
                for step in trial.steps
            )
            torques += [samples for samples in on_three if samples is not None]
            left_out = None if torques else "no joint torques, or no step long enough for them"
    except RecordingError as error:
        left_out = str(error)
    duration = trial.duration if isinstance(trial, SteppingTrial) else recording.duration
    return MotionReading(index, trial, lift, move, tuple(torques), left_out, duration, steps, sway=sway)
