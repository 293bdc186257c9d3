"""Connection of samples and commands, with a simulated robot that steps with every command."""

import time
from dataclasses import replace
from pathlib import Path

from equipoise import CommunicationError, JointCommand, RobotModel, RobotState, simulate
from outside_driver.settings import BusSettings


class BusConnection:
    """Connection to a robot on the bus."""

    rejected = 0

    def __init__(self, robot: RobotModel, settings: BusSettings, who: str) -> None:
        if settings.node != 1:
            raise CommunicationError(f"nobody answers at node {settings.node}")
        if settings.diary:
            with Path(settings.diary).open("a", encoding="utf-8") as diary:
                diary.write(f"{who}\n")
        self.name, self.joint_names = f"node {settings.node}", robot.joint_names
        self._there = simulate(robot, "ideal").platform
        self.accepts, self.control_period = self._there.accepts, self._there.control_period
        self._arrived: list[RobotState] = []

    def receive(self) -> list[RobotState]:
        arrived, self._arrived = self._arrived or [self._sample()], []
        return arrived

    def send(self, command: JointCommand) -> None:
        self._there.step(command)
        self._arrived.append(self._sample())

    def release(self) -> None: ...

    def close(self) -> None:
        self._there.close()

    def _sample(self) -> RobotState:
        now = time.monotonic()  # the simulated clock stops while no program commands the robot
        return replace(self._there.read(), time=now, received=now)


def open_connection(robot: RobotModel, settings: BusSettings) -> BusConnection:
    """Open a connection for the robot process, or to observe the robot."""
    return BusConnection(robot, settings, "program")


def open_second_connection(robot: RobotModel, settings: BusSettings) -> BusConnection:
    """Open a connection for the calibration process, which damps the robot if the robot process cannot."""
    return BusConnection(robot, settings, "second")
