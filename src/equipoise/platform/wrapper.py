"""Base class of platforms around another platform."""

from __future__ import annotations

from equipoise.platform.platform import JointCommand, Platform, RobotState, TiltLimit, Trajectory
from equipoise.platform.stepped import SteppedPlatform
from equipoise.recording.recording import Recording


class PlatformWrapper(SteppedPlatform):
    """Platform that forwards all calls to an inner platform; subclasses add behaviour."""

    def __init__(self, inner: Platform) -> None:
        self._inner = inner
        self.control_period, self.joint_names, self.accepts = inner.control_period, inner.joint_names, inner.accepts

    def read(self) -> RobotState:
        return self._inner.read()

    def step(self, command: JointCommand) -> RobotState:
        return self._inner.step(command)

    def play(self, trajectory: Trajectory, stop: TiltLimit | None = None) -> Recording:
        return self._inner.play(trajectory, stop)

    def close(self) -> None:
        self._inner.close()
