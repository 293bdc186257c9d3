"""What was recorded as something to look at: the robot's motion in even steps, its trials and their phases."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.method.method import Method
from equipoise.recording.event import PHASE, TRIAL
from equipoise.recording.recording import Recording
from equipoise.recording.trials import CommandedLift, DesignedLift, LiftTrial, RecordedTrial, read_trial
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance
from equipoise.view.base_motion import BaseMotion, BaseTracker
from equipoise.view.even_steps import STEP, EvenSteps, SensedSteps


@dataclass(frozen=True)
class TrialMark:
    """Where a trial begins.

    Attributes:
        number: its place among all trials, from one on.
        time: moment [s].
        what: what it is; None if it is of a kind that is not ours.
    """

    number: int
    time: float
    what: RecordedTrial | None

    @property
    def diagonal(self) -> str | None:
        """That a lift is on; None of other trials."""
        return self.what.diagonal if isinstance(self.what, LiftTrial) else None

    @property
    def title(self) -> str:
        """In few words."""
        if self.what is None:
            return "motion"
        words = [self.what.kind, self.what.about]
        if isinstance(self.what, DesignedLift):
            words.append(self.what.meanwhile)
        elif isinstance(self.what, CommandedLift) and self.what.offset:
            words.append(f"{1000 * self.what.offset:+.1f} mm")
        return " ".join(filter(None, words))


@dataclass(frozen=True, eq=False)
class Moments:
    """n even steps: what was sensed, and where the base was. See `SensedSteps` and `BaseMotion`."""

    time: FloatArray
    joint_position: FloatArray
    joint_torque: FloatArray
    rotation_base_to_world: FloatArray
    position_in_world: FloatArray
    feet_in_world: FloatArray
    standing: FloatArray

    @classmethod
    def of(cls, steps: SensedSteps, base: BaseMotion) -> Moments:
        """Both together."""
        return cls(
            steps.time,
            steps.joint_position,
            steps.joint_torque,
            base.rotation_base_to_world,
            base.position_in_world,
            base.feet_in_world,
            base.standing,
        )

    @classmethod
    def joined(cls, parts: Sequence[Moments]) -> Moments:
        """One after the other."""
        return cls(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(cls)))


class Film:
    """Grows as pieces come.

    Attributes:
        robot, stance: whose.
        method: of the run.
        trials: that have begun, in order of time.
        phases: time and name of every phase, in order.
        ends: times at which trials were complete [s].
    """

    def __init__(self, robot: RobotModel, stance: Stance, method: Method) -> None:
        self.robot, self.stance, self.method = robot, stance, method
        self.clear()

    def clear(self) -> None:
        """As if nothing had come."""
        self._even, self._tracker = EvenSteps(self.robot), BaseTracker(self.robot, self.stance)
        self._parts: list[Moments] = []
        self.trials: list[TrialMark] = []
        self.phases: list[tuple[float, str]] = []
        self.ends: list[float] = []

    def take(self, pieces: Sequence[Recording], complete: Sequence[Recording] = ()) -> None:
        """More was recorded.

        Args:
            pieces: in order.
            complete: trials that are complete now.
        """
        for piece in pieces:
            for event in piece.events:
                if event.name == TRIAL:
                    self.trials.append(TrialMark(len(self.trials) + 1, event.time, read_trial(event.data)))
                elif event.name == PHASE:
                    self.phases.append((event.time, str(event.data.get("name"))))
            steps = self._even.take(piece)
            if steps is not None:
                self._parts.append(Moments.of(steps, self._tracker.follow(steps)))
        self.ends += [float(recording.joints.time[-1]) for recording in complete]
        found = [(float(one.joints.time[0]), one.found_trial) for one in complete if one.found_trial is not None]
        self.trials += [TrialMark(number, *mark) for number, mark in enumerate(found, len(self.trials) + 1)]

    @property
    def empty(self) -> bool:
        """Whether there is nothing to see yet."""
        return not self._parts

    @property
    def moments(self) -> Moments:
        """All of it; raises IndexError if it is empty."""
        if len(self._parts) > 1:
            self._parts = [Moments.joined(self._parts)]
        return self._parts[0]

    @property
    def span(self) -> tuple[float, float]:
        """First and last time [s]; zeros if it is empty."""
        return (0.0, 0.0) if self.empty else (float(self._parts[0].time[0]), float(self._parts[-1].time[-1]))

    def trial_at(self, time: float) -> TrialMark | None:
        """The last one that has begun."""
        begun = [trial for trial in self.trials if trial.time <= time]
        return begun[-1] if begun else None

    @staticmethod
    def beginning(trial: TrialMark) -> float:
        """A time whose moment is the first of a trial [s]: the last moment before its command is still another's."""
        return trial.time + STEP

    def phase_at(self, time: float) -> str | None:
        """The last one that has begun."""
        begun = [name for start, name in self.phases if start <= time]
        return begun[-1] if begun else None

    def phase_start(self, name: str, trial: TrialMark, until: float) -> float | None:
        """When a phase of a trial began, if it did so up to a time [s]."""
        starts = [time for time, phase in self.phases if phase == name and trial.time <= time <= until]
        return starts[0] if starts else None

    def complete_at(self, time: float) -> int:
        """How many trials were complete."""
        return sum(end <= time + 1e-9 for end in self.ends)
