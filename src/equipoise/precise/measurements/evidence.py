"""From recordings to what the precise estimators need: lifts, planted moves and torques, and why others were left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from equipoise.alive import alive
from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError
from equipoise.precise.measurements.leg_motion import LegChains
from equipoise.precise.measurements.lift_samples import LiftSamples, read_lift
from equipoise.precise.measurements.planted_moves import PlantedMove, read_move
from equipoise.precise.measurements.torque_balance import TorqueSamples
from equipoise.recording.recording import Recording
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance


@dataclass(frozen=True, eq=False)
class MotionReading:
    """One recording: what it is, and what could be read from it.

    Attributes:
        index: of the recording.
        about: its trial event's data.
        lift, move, torque: what it holds; None if it holds none.
        left_out: why a lift could not be read, or None.
        duration: [s].
    """

    index: int
    about: Mapping[str, Any]
    lift: LiftSamples | None
    move: PlantedMove | None
    torques: tuple[TorqueSamples, ...]
    left_out: str | None
    duration: float


@dataclass(frozen=True, eq=False)
class RunEvidence:
    """All motions of a run.

    Attributes:
        motions: in order.
    """

    motions: tuple[MotionReading, ...]


def read_evidence(robot: RobotModel, stance: Stance, recordings: Sequence[Recording]) -> RunEvidence:
    """Read all recordings of a run; broken ones are noted, not raised.

    Raises:
        RecordingError: nothing in them can be used.
    """
    rested = [recording for recording in recordings if recording.has_phase("rest")]
    if not rested:
        raise RecordingError(
            "the recordings hold no rest before a lift or after a move; are they of the precise method?"
        )
    # The median over rests: one in which the robot still swayed does not count.
    bias = np.median([recording.phase("rest").imu.angular_velocity.mean(axis=0) for recording in rested], axis=0)
    legs = LegChains(robot)
    return RunEvidence(
        tuple(_read(robot, stance, legs, index, recording, bias) for index, recording in enumerate(recordings))
    )


def _read(
    robot: RobotModel, stance: Stance, legs: LegChains, index: int, recording: Recording, gyro_bias: FloatArray
) -> MotionReading:
    alive()
    about = recording.trial
    lift: LiftSamples | None = None
    move: PlantedMove | None = None
    torques: list[TorqueSamples] = []
    left_out: str | None = None
    try:
        if recording.has_phase("rest") and (rest := TorqueSamples.of_rest(recording.phase("rest"))) is not None:
            torques.append(rest)
        if about.get("kind") == "lift":
            if recording.has_phase("lower"):
                read = read_lift(robot, legs, recording, stance, gyro_bias)
                lift, left_out = (None, read) if isinstance(read, str) else (read, None)
            else:
                left_out = (
                    "interrupted"
                    if recording.has_phase("unload")
                    else "not lifted: out of reach, or the robot could have tipped over"
                )
        elif about.get("kind") == "posture" and recording.has_phase("rest"):
            moving = recording.phase("move", until="rest")
            move = read_move(robot, legs, recording.phase("before"), moving, recording.phase("rest"), gyro_bias)
            samples = TorqueSamples.of_motion(moving, gyro_bias, stance.scale.time)
            torques += [] if samples is None else [samples]
        elif about.get("kind") == "sway" and recording.has_phase("end"):
            samples = TorqueSamples.of_motion(recording.phase("sway"), gyro_bias, stance.scale.time)
            torques += [] if samples is None else [samples]
    except RecordingError as error:
        left_out = str(error)
    return MotionReading(index, about, lift, move, tuple(torques), left_out, recording.duration)
