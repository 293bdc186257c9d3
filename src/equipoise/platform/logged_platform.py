"""Platform in this process, usually simulated, that logs each motion as soon as it is complete."""

from __future__ import annotations

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import MotionError
from equipoise.platform.platform import JointCommand, MotionInterrupted, Platform, RobotState, TiltLimit, Trajectory
from equipoise.platform.stepped import PlatformWrapper
from equipoise.platform.stepping import recording_of
from equipoise.recording.recording import Recording
from equipoise.recording.run_log import RunLog

_STEPS_TIME = 0.25  # [s] of steps that are written at once


class Logged(PlatformWrapper):
    """Platform that logs complete motions, also those that the robot's guard ended, and steps in pieces of 0.25 s.

    Raises:
        OutputError: the log cannot be written.
    """

    def __init__(self, inner: Platform, log: RunLog) -> None:
        super().__init__(inner)
        self._log = log
        self._steps: list[tuple[RobotState, FloatArray]] = []  # not written yet: previous states and sent targets
        self._state: RobotState | None = None  # after the last step; None after a motion

    def play(self, trajectory: Trajectory, stop: TiltLimit | None = None) -> Recording:
        self._write_steps()
        self._state = None
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
        if self._state is None:
            self._log.begin(0)
        before, self._state = self._state or self._inner.read(), None
        self._state = self._inner.step(command)
        self._steps.append((before, command.position))
        if len(self._steps) * self.control_period >= _STEPS_TIME:
            self._write_steps()
        return self._state

    def close(self) -> None:
        try:
            self._write_steps()
        finally:
            self._inner.close()

    def _write_steps(self) -> None:
        steps, self._steps = self._steps, []
        if steps:
            states, targets = [state for state, _ in steps], np.array([target for _, target in steps])
            self._log.add(recording_of(self.joint_names, states, targets, ()))
