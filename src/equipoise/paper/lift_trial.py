"""One lift trial of a search, and what its recording says."""

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
from equipoise.paper.head_start import head_start
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
        offset: shift of the support line from where it is at the nominal stance, along the base's x axis [m].
        feet_in_base: (4, 3) centres that all four feet are to have in the base frame, still planted [m].
        settings: height, times and limits of the lift.

    Raises:
        MotionError: the joints did not come to rest near their targets.
    """
    trial = CommandedLift(
        diagonal=diagonal, offset=offset, lift_height=settings.height, tilt_threshold=settings.tilt_threshold
    )
    before = _move_over(standing, trial, feet_in_base, settings)
    tipping = tipping_from(standing, before.phase(Phase.REST), diagonal)
    # The CoM is what is searched: what the model says of it must not end a lift before it shows.
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
    """Replant the feet, move, settle until the joints are near their targets and still, and rest."""
    motion, home = standing.motion().begin(trial), standing.home
    motion.phase(Phase.REPLANT).move_feet(
        home, standing.move_time(home, motion.target.feet_in_base, settings.move_time)
    )
    replant(motion, home, trial.diagonal, settings)
    motion.phase(Phase.MOVE).move_feet(feet_in_base, standing.move_time(feet_in_base, home, settings.move_time))
    return come_to_rest(standing, motion, settings, f"before a lift on {trial.diagonal}")


@dataclass(frozen=True, eq=False)
class LiftReading:
    """What the recording of a lift trial says.

    Attributes:
        trial: lift as it was commanded.
        recording: samples of the whole trial.
        tilt: rotation by which the robot tipped, and its direction.
        plane: support plane at the nominal stance in the base frame, less the robot's head start.
        ahead: distance of the CoM from that plane, by how fast the robot tipped; positive: forward [m].
    """

    trial: CommandedLift
    recording: Recording
    tilt: Tilt
    plane: SupportPlane
    ahead: float

    @property
    def tried(self) -> TriedOffset:
        """What it means for the bracket."""
        return TriedOffset(self.trial.offset, self.trial.lift_height, self.tilt.verdict, self.plane, self.ahead)


def read_lift_trial(robot: RobotModel, recording: Recording, stance: FloatArray) -> LiftReading:
    """Read a complete lift trial.

    Args:
        robot: model of the robot.
        recording: recording of the trial.
        stance: (nj,) joint positions of the nominal stance [rad].

    Raises:
        RecordingError: it holds no complete lift trial that we commanded.
    """
    trial = recording.trial
    if not isinstance(trial, CommandedLift) or not recording.complete:
        raise RecordingError("the recording holds no complete lift trial; was it interrupted?")
    at_rest = support_plane_of(robot, recording, trial.diagonal, stance)
    start = head_start(robot, recording, trial)
    return LiftReading(trial, recording, tilt_of(robot, recording, trial), at_rest.moved(-start.moved), start.ahead)


def read_lift_trials(robot: RobotModel, recordings: Sequence[Recording], stance: FloatArray) -> list[LiftReading]:
    """Read the recordings that hold a complete lift trial, in order; arguments as of `read_lift_trial`."""
    return [read_lift_trial(robot, recording, stance) for recording in recordings if holds_lift_trial(recording)]


def holds_lift_trial(recording: Recording) -> bool:
    """Whether a recording holds a complete lift trial that we commanded."""
    return isinstance(recording.trial, CommandedLift) and recording.complete
