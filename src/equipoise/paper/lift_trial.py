"""Lift trial of a search: commands, and analysis of its recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError
from equipoise.experiments.lift import LiftSettings, come_to_rest, in_time, replant, tilt_limit, tipping_from
from equipoise.experiments.standing_robot import StandingRobot
from equipoise.experiments.tilt import SupportPlane, Tilt, support_plane_of, tilt_of
from equipoise.paper.bracket import TriedOffset
from equipoise.paper.tipping_onset import tipping_onset
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.recording.trials import CommandedLift
from equipoise.robot.model import DIAGONALS, LEG_NAMES, RobotModel


def lift_trial(
    standing: StandingRobot, diagonal: str, offset: float, feet_in_base: FloatArray, settings: LiftSettings
) -> Recording:
    """Move over the support line, lift the other diagonal's feet, watch, and return to four feet.

    Phases: replant, move, settle, rest, unload, lift, watch, lower.

    Args:
        standing: robot on four feet.
        diagonal: diagonal to stand on.
        offset: shift of the support line from the nominal stance along the base's x axis [m].
        feet_in_base: (4, 3) target centres of the feet in the base frame, all on the floor [m].
        settings: height, times and limits of the lift.

    Raises:
        MotionError: the joints did not come to rest near their targets.
    """
    trial = CommandedLift(
        diagonal=diagonal, offset=offset, lift_height=settings.height, tilt_threshold=settings.tilt_threshold
    )
    before = _move_over(standing, trial, feet_in_base, settings)
    tipping = tipping_from(standing, before.phase(Phase.REST), diagonal)
    # The CoM is searched, so a limit from the model's CoM must not end a lift before the tilt is measured.
    plain = tipping.from_rest(2 * settings.tilt_threshold)
    stance_legs = DIAGONALS[diagonal]
    lifted = np.array(feet_in_base)
    lifted[[leg not in stance_legs for leg in LEG_NAMES], 2] += settings.height
    settings = in_time(standing, feet_in_base, lifted, settings)
    safe = tipping.stop(settings.height, settings.lower_time, settings.stop_delay)
    limit = tilt_limit(standing, tipping, settings, (max(safe[0], plain), max(safe[1], plain)))
    up = standing.motion().phase(Phase.UNLOAD).shift_load(stance_legs, settings.unload_time)
    up.phase(Phase.LIFT).move_feet(lifted, settings.lift_time).phase(Phase.WATCH).hold(settings.watch_time)
    standing.play(up, limit)
    down = standing.motion().phase(Phase.LOWER).move_feet(feet_in_base, settings.lower_time)
    standing.play(down.shift_load(LEG_NAMES, settings.unload_time))
    return standing.finish()


def _move_over(
    standing: StandingRobot, trial: CommandedLift, feet_in_base: FloatArray, settings: LiftSettings
) -> Recording:
    """Replant the feet, move, settle until the joints are at rest near their targets, and rest."""
    motion, home = standing.motion().begin(trial), standing.home
    motion.phase(Phase.REPLANT).move_feet(
        home, standing.move_time(home, motion.target.feet_in_base, settings.move_time)
    )
    replant(motion, home, trial.diagonal, settings)
    motion.phase(Phase.MOVE).move_feet(feet_in_base, standing.move_time(feet_in_base, home, settings.move_time))
    return come_to_rest(standing, motion, settings, f"before a lift on {trial.diagonal}")


@dataclass(frozen=True, eq=False)
class LiftReading:
    """Lift trial with the results from its recording.

    Attributes:
        trial: lift that was commanded.
        recording: samples of the whole trial.
        tilt: rotation by which the robot tipped, and its direction.
        plane: support plane at the nominal stance in the base frame, corrected by the tipping onset.
        ahead: distance of the CoM from that plane, from the rate of tipping; positive: forward [m].
    """

    trial: CommandedLift
    recording: Recording
    tilt: Tilt
    plane: SupportPlane
    ahead: float

    @property
    def tried(self) -> TriedOffset:
        """Result of the trial for the bracket."""
        return TriedOffset(self.trial.offset, self.trial.lift_height, self.tilt.verdict, self.plane, self.ahead)


def read_lift_trial(robot: RobotModel, recording: Recording, stance: FloatArray) -> LiftReading:
    """Compute tilt and support plane of a complete lift trial.

    Args:
        robot: model of the robot.
        recording: recording of the trial.
        stance: (nj,) joint positions of the nominal stance [rad].

    Raises:
        RecordingError: the recording does not contain a complete lift trial commanded by equipoise.
    """
    trial = recording.trial
    if not isinstance(trial, CommandedLift) or not recording.complete:
        raise RecordingError("the recording does not contain a complete lift trial; repeat an interrupted run")
    at_rest = support_plane_of(robot, recording, trial.diagonal, stance)
    moved, ahead = tipping_onset(robot, recording, trial)
    return LiftReading(trial, recording, tilt_of(robot, recording, trial), at_rest.moved(-moved), ahead)


def read_lift_trials(robot: RobotModel, recordings: Sequence[Recording], stance: FloatArray) -> list[LiftReading]:
    """Apply `read_lift_trial` to the recordings with a complete lift trial, in order."""
    return [read_lift_trial(robot, recording, stance) for recording in recordings if holds_lift_trial(recording)]


def holds_lift_trial(recording: Recording) -> bool:
    """Return true for a recording of a complete lift trial commanded by equipoise."""
    return isinstance(recording.trial, CommandedLift) and recording.complete
