"""A platform around another one: what passes straight through."""

from __future__ import annotations

from equipoise.platform.platform import JointCommand, Platform, RobotState, TiltLimit, Trajectory
from equipoise.recording.recording import Recording


class PlatformWrapper:
    """Does what the platform inside does; those that inherit do something besides."""

    def __init__(self, inner: Platform) -> None:
        self._inner = inner

    @property
    def control_period(self) -> float:
        return self._inner.control_period

    @property
    def joint_names(self) -> tuple[str, ...]:
        return self._inner.joint_names

    @property
    def accepts(self) -> frozenset[str]:
        return self._inner.accepts

    def read(self) -> RobotState:
        return self._inner.read()

    def step(self, command: JointCommand) -> RobotState:
        return self._inner.step(command)

    def play(self, trajectory: Trajectory, stop: TiltLimit | None = None) -> Recording:
        return self._inner.play(trajectory, stop)

    def close(self) -> None:
        self._inner.close()

    def __enter__(self) -> PlatformWrapper:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
