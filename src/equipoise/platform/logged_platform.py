"""Platform in this process, usually simulated, that logs each motion as soon as it is complete."""

from __future__ import annotations

from equipoise.errors import MotionError
from equipoise.platform.platform import JointCommand, MotionInterrupted, Platform, RobotState, TiltLimit, Trajectory
from equipoise.platform.stepping import recording_of
from equipoise.platform.wrapper import PlatformWrapper
from equipoise.recording.recording import Recording
from equipoise.recording.run_log import RunLog


class Logged(PlatformWrapper):
    """Platform that logs complete motions, also those that the robot's guard ended; a step is a motion of one command.

    Raises:
        OutputError: the log cannot be written.
    """

    def __init__(self, inner: Platform, log: RunLog) -> None:
        super().__init__(inner)
        self._log = log

    def play(self, trajectory: Trajectory, stop: TiltLimit | None = None) -> Recording:
        self._log.begin(len(trajectory.position), trajectory.trial)
        try:
            recording = self._inner.play(trajectory, stop)
        except (MotionInterrupted, MotionError) as stopped:
            parts = (stopped.recording,) if isinstance(stopped, MotionInterrupted) else stopped.recordings
            for part in parts:
                if part is not None:
                    self._log.add(part)
            raise
        try:
            self._log.add(recording)
        except KeyboardInterrupt:  # the motion is complete, and the routine needs its recording
            raise MotionInterrupted(recording) from None
        return recording

    def step(self, command: JointCommand) -> RobotState:
        before = self._inner.read()
        self._log.begin(1)
        state = self._inner.step(command)
        self._log.add(recording_of(self.joint_names, [before], command.position[None], ()))
        return state
