"""Base class for platforms of your own robots, and of platforms around another one."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TypeVar

from equipoise.platform.platform import JointCommand, Platform, RobotState, TiltLimit, Trajectory
from equipoise.platform.stepping import play_by_stepping
from equipoise.recording.recording import Recording
from equipoise.robot.model import RobotModel

Self = TypeVar("Self", bound="SteppedPlatform")


class SteppedPlatform(ABC):
    """Platform that plays a motion step by step; subclasses need `control_period`, `read`, `step` and `close`.

    `equipoise calibrate --platform MODULE:CLASS` creates CLASS(robot, **settings) and guards it.

    Args:
        robot: model of the robot.

    Attributes:
        control_period: time between commands [s].
        joint_names: names of the robot's leg joints, in the model's order, the order of every joint vector.
        accepts: the values that it uses of a command besides positions: "velocity", "torque", "gains".
    """

    control_period: float
    accepts: frozenset[str] = frozenset()

    def __init__(self, robot: RobotModel) -> None:
        self.joint_names = robot.joint_names

    @abstractmethod
    def read(self) -> RobotState:
        """Return the state without commanding. With `received`, time passes without steps, as on real robots."""

    @abstractmethod
    def step(self, command: JointCommand) -> RobotState:
        """Send a command, let one control period pass, and return the state."""

    @abstractmethod
    def close(self) -> None:
        """Leave the motors in a safe state. May be called twice."""

    def play(self, trajectory: Trajectory, stop: TiltLimit | None = None) -> Recording:
        """Play an open-loop motion by stepping; see `play_by_stepping`."""
        return play_by_stepping(self, trajectory, stop)

    def __enter__(self: Self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


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
