"""From recordings to what the precise estimators need: lifts, planted moves and torques, and why others were left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from equipoise.alive import alive
from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError
from equipoise.precise.measurements.heading import angle_turned
from equipoise.precise.measurements.leg_motion import LegChains
from equipoise.precise.measurements.lift_samples import LiftSamples, read_lift
from equipoise.precise.measurements.planted_moves import PlantedMove, read_move
from equipoise.precise.measurements.torque_balance import TorqueSamples
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.recording.trials import LiftTrial, PostureTrial, RecordedTrial, SwayTrial, TurnTrial
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance


@dataclass(frozen=True, eq=False)
class MotionReading:
    """One recording: what it is, and what could be read from it.

    Attributes:
        index: index of the recording in the run.
        trial: trial that it is of; None if it does not say.
        lift, move, torque: samples of a lift, a planted move and joint torques; None if it holds none.
        left_out: reason why a lift could not be read, or None.
        duration: duration of the recording [s].
    """

    index: int
    trial: RecordedTrial | None
    lift: LiftSamples | None
    move: PlantedMove | None
    torques: tuple[TorqueSamples, ...]
    left_out: str | None
    duration: float


@dataclass(frozen=True, eq=False)
class RunEvidence:
    """All motions of a run.

    Attributes:
        motions: readings of all recordings, in order.
    """

    motions: tuple[MotionReading, ...]


def read_evidence(robot: RobotModel, stance: Stance, recordings: Sequence[Recording]) -> RunEvidence:
    """Read all recordings of a run; broken ones are noted, not raised.

    Raises:
        RecordingError: nothing in them can be used.
    """
    rested = [recording for recording in recordings if recording.has_phase(Phase.REST)]
    if not rested:
        raise RecordingError(
            "the recordings hold no rest before a lift or after a move; are they of the precise method?"
        )
    # The median over rests: one in which the robot still swayed does not count.
    bias = np.median(
        [recording.phase(Phase.REST).imu.angular_velocity_in_imu.mean(axis=0) for recording in rested], axis=0
    )
    legs, headings = LegChains(robot), _headings(robot, recordings)
    ends = np.cumsum([recording.duration for recording in recordings])
    when = (ends - ends[-1] / 2) / ends[-1]
    return RunEvidence(
        tuple(
            _read(robot, stance, legs, index, recording, bias, float(when[index]), float(headings[index]))
            for index, recording in enumerate(recordings)
        )
    )


def _headings(robot: RobotModel, recordings: Sequence[Recording]) -> FloatArray:
    """(n,) angle by which the robot had been turned in the room when each recording ended, to its left [rad]."""
    turned = [isinstance(recording.trial, TurnTrial) and recording.complete for recording in recordings]
    angles = [angle_turned(robot, recording) if was else 0.0 for recording, was in zip(recordings, turned, strict=True)]
    return np.cumsum(angles)


def _read(
    robot: RobotModel, stance: Stance, legs: LegChains, index: int, recording: Recording, gyro_bias: FloatArray,
    when: float, heading: float,
) -> MotionReading:  # fmt: skip
    alive()
    trial = recording.trial
    lift: LiftSamples | None = None
    move: PlantedMove | None = None
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
            samples = TorqueSamples.of_motion(recording.phase(Phase.SWAY), gyro_bias, stance.scale.time)
            torques += [] if samples is None else [samples]
    except RecordingError as error:
        left_out = str(error)
    return MotionReading(index, trial, lift, move, tuple(torques), left_out, recording.duration)
