"""The base of platforms that people write for robots of their own."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TypeVar

from equipoise.platform.platform import JointCommand, RobotState, TiltLimit, Trajectory
from equipoise.platform.stepping import play_by_stepping
from equipoise.recording.recording import Recording
from equipoise.robot.model import RobotModel

Self = TypeVar("Self", bound="SteppedPlatform")


class SteppedPlatform(ABC):
    """A platform that plays a motion step by step: a robot's class needs `control_period`, `read`, `step` and `close`.

    `equipoise calibrate --platform MODULE:CLASS` makes it as CLASS(robot, **settings) and guards it.

    Args:
        robot: model of the robot.

    Attributes:
        control_period: time between commands [s].
        joint_names: names of the robot's leg joints, in the model's order, which every joint vector has.
        accepts: those of "velocity", "torque" and "gains" that it uses of commands besides positions.
    """

    control_period: float
    accepts: frozenset[str] = frozenset()

    def __init__(self, robot: RobotModel) -> None:
        self.joint_names = robot.joint_names

    @abstractmethod
    def read(self) -> RobotState:
        """Sense without commanding. A real robot's state has `received`; without it time passes only when it is stepped."""

    @abstractmethod
    def step(self, command: JointCommand) -> RobotState:
        """Send a command, let one control period pass, and sense."""

    @abstractmethod
    def close(self) -> None:
        """End safely: the robot is left with its motors in a safe state. May be called twice."""

    def play(self, trajectory: Trajectory, stop: TiltLimit | None = None) -> Recording:
        """Play an open-loop motion by stepping, as `play_by_stepping` says."""
        return play_by_stepping(self, trajectory, stop)

    def __enter__(self: Self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
