"""Resumption of an interrupted run: the routine begins again and first receives the recordings of the log.

Decisions depend on recordings alone, so the routine requests the same motions again. A simulated robot plays them again, to
return to its last state. A real robot stands still meanwhile.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from equipoise.errors import RecordingError
from equipoise.platform.platform import Platform, TiltLimit, Trajectory
from equipoise.platform.ramp import smooth_step
from equipoise.platform.stepped import PlatformWrapper
from equipoise.recording.event import PHASE, TRIAL, Event
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.recording.run_log_reader import LogContent, Play

_REJOINING_TIME = 2.0  # [s]
# A robot stands up to slightly different joint positions each time; inverse kinematics begins at them.
_SAME_COMMAND = 1e-4  # [rad]


class RepeatedSimulation(PlatformWrapper):
    """Simulated robot that repeats a run's motions, and then continues.

    Args:
        live: simulated robot for the remaining motions, logged.
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
                f"{_described(self._content, stored)} differs from its recording: a simulation repeats exactly only with the "
                "same versions of equipoise and MuJoCo on the same kind of machine; begin a new run"
            )
        return recording


class ResumedRobot(PlatformWrapper):
    """Real robot that stands up, skips the recorded motions of a run, and then continues.

    Before it continues, it moves smoothly to the beginning of the next motion, all feet on the floor.

    Args:
        live: the robot.
        content: content of the run's log.

    Raises:
        RecordingError: the requested motions are not the recorded ones.
    """

    def __init__(self, live: Platform, content: LogContent) -> None:
        super().__init__(live)
        self._content = content
        self._stored = deque(play for play in content.complete_plays if play.trial is not None)
        self._skipped = False  # whether motions were skipped since the robot last moved
        self._sent: Trajectory | None = None  # the last command

    def play(self, trajectory: Trajectory, stop: TiltLimit | None = None) -> Recording:
        if self._stored and (self._skipped or any(event.name == TRIAL for event in trajectory.events)):
            self._skipped = True
            stored = self._stored.popleft()
            _check_commands(self._content, stored, trajectory)
            return stored.recording
        if self._skipped:
            self._move(self._way_to(trajectory))
            self._skipped = False
        return self._move(trajectory, stop)

    def _move(self, trajectory: Trajectory, stop: TiltLimit | None = None) -> Recording:
        recording = super().play(trajectory, stop)
        count = len(trajectory.position) if recording.commands is None else len(recording.commands.time)
        last = slice(count - 1, count)
        torque = None if trajectory.torque is None else trajectory.torque[last]
        self._sent = Trajectory(trajectory.position[last], torque=torque)
        return recording

    def _way_to(self, trajectory: Trajectory) -> Trajectory:
        """Return the motion from the last command to the first one of a trajectory, at rest at both ends."""
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
            f"the commands of {_described(content, stored)} differ from the recorded ones: the settings, or the version of "
            "equipoise or of the simulator, have changed; resume with the original ones, or begin a new run"
        )


def _described(content: LogContent, play: Play) -> str:
    """Return the name of a motion for messages."""
    if play.trial is None:
        return "standing up"
    trial = next(begun.recording.trial for begun in content.plays if begun.trial == play.trial)
    name = "motion" if trial is None else f"{trial.kind} {trial.about}".strip()
    return f"trial {play.trial} ({name})"
