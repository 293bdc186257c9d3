"""An interrupted run that is resumed: its routine begins again and is given the recordings as long as there are any.

Decisions depend on recordings alone, so the routine asks for the same motions again. In simulation they are played again, so
that the simulated robot, too, is where it was. A real robot stands still meanwhile.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from equipoise.errors import RecordingError
from equipoise.platform.platform import Platform, TiltLimit, Trajectory
from equipoise.platform.ramp import smooth_step
from equipoise.platform.wrapper import PlatformWrapper
from equipoise.recording.event import PHASE, TRIAL, Event
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.recording.run_log_reader import LogContent, Play

_REJOINING_TIME = 2.0  # [s]
# A robot does not stand up to quite the same joint positions twice; inverse kinematics begins at them.
_SAME_COMMAND = 1e-4  # [rad]


class RepeatedSimulation(PlatformWrapper):
    """A simulated robot that plays a run's motions again, and then goes on.

    Args:
        live: the simulated robot as it is to go on: logged.
        again: the same robot, not logged.
        content: content of the run's log.

    Raises:
        RecordingError: the simulation does not repeat.
    """

    def __init__(self, live: Platform, again: Platform, content: LogContent) -> None:
        super().__init__(live)
        self._again, self._content = again, content
        self._stored = deque(content.complete_plays)

    def play(self, trajectory: Trajectory, stop: TiltLimit | None = None) -> Recording:
        if not self._stored:
            return super().play(trajectory, stop)
        stored = self._stored.popleft()
        _check_commands(self._content, stored, trajectory)
        recording = self._again.play(trajectory, stop)
        if not recording.equals(stored.recording):
            raise RecordingError(
                f"{_described(self._content, stored)} went otherwise than it was recorded: a simulation repeats with the same "
                "versions of equipoise and MuJoCo on the same kind of machine only; begin a new run"
            )
        return recording


class ResumedRobot(PlatformWrapper):
    """A real robot that stands up, is spared the motions of a run that are recorded, and then goes on.

    Before it goes on it moves smoothly from where it stands to where the next motion begins, all feet on the ground.

    Args:
        live: the robot.
        content: content of the run's log.

    Raises:
        RecordingError: the routine asks for other motions than were recorded.
    """

    def __init__(self, live: Platform, content: LogContent) -> None:
        super().__init__(live)
        self._content = content
        self._stored = deque(play for play in content.complete_plays if play.trial is not None)
        self._spared = False  # a motion since the robot moved last
        self._sent: Trajectory | None = None  # what it was sent last: one command

    def play(self, trajectory: Trajectory, stop: TiltLimit | None = None) -> Recording:
        if self._stored and (self._spared or any(event.name == TRIAL for event in trajectory.events)):
            self._spared = True
            stored = self._stored.popleft()
            _check_commands(self._content, stored, trajectory)
            return stored.recording
        if self._spared:
            self._move(self._way_to(trajectory))
            self._spared = False
        return self._move(trajectory, stop)

    def _move(self, trajectory: Trajectory, stop: TiltLimit | None = None) -> Recording:
        recording = super().play(trajectory, stop)
        count = len(trajectory.position) if recording.commands is None else len(recording.commands.time)
        last = slice(count - 1, count)
        torque = None if trajectory.torque is None else trajectory.torque[last]
        self._sent = Trajectory(trajectory.position[last], torque=torque)
        return recording

    def _way_to(self, trajectory: Trajectory) -> Trajectory:
        """From what was sent last to the first command of a trajectory, at rest at both ends."""
        start = self._sent or Trajectory(self.read().joint_position[None])
        share = smooth_step(round(_REJOINING_TIME / self.control_period))[:, None]
        torque = None
        if trajectory.torque is not None:
            before = trajectory.torque[:1] if start.torque is None else start.torque
            torque = (1 - share) * before + share * trajectory.torque[:1]
        position = (1 - share) * start.position + share * trajectory.position[:1]
        return Trajectory(position, torque=torque, events=(Event(0.0, PHASE, {"name": Phase.RESUME}),))


def _check_commands(content: LogContent, stored: Play, trajectory: Trajectory) -> None:
    commands = stored.recording.commands
    sent = trajectory.position[:0] if commands is None else commands.position
    asked = trajectory.position[: len(sent)]
    same = stored.commands == len(trajectory.position) and sent.shape == asked.shape
    if not (same and np.abs(sent - asked).max(initial=0.0) <= _SAME_COMMAND):
        raise RecordingError(
            f"{_described(content, stored)} would be commanded otherwise now than when it was recorded: by other settings, or "
            "by other versions of equipoise or of the simulator; go on with those, or begin a new run"
        )


def _described(content: LogContent, play: Play) -> str:
    """Return a play in words."""
    if play.trial is None:
        return "standing up"
    trial = next(begun.recording.trial for begun in content.plays if begun.trial == play.trial)
    what = "motion" if trial is None else f"{trial.kind} {trial.about}".strip()
    return f"trial {play.trial} ({what})"
