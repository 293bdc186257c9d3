"""ROS 2 robots and Gazebo, without a ROS installation: JointState and Imu in, position commands out, over DDS.

What the controllers on the other side must be is in docs/ros2.md.
"""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from equipoise.drivers.dds.domain import DdsDomain, Inbox, raw
from equipoise.drivers.ros2.messages import (
    Duration,
    Float64MultiArray,
    Header,
    Imu,
    JointState,
    JointTrajectory,
    JointTrajectoryPoint,
    dds_topic,
)
from equipoise.drivers.ros2.samples import ImuTopic, JointTopic, StampClock, listed, together
from equipoise.drivers.ros2.settings import Ros2Settings
from equipoise.errors import CommunicationError, SettingsError
from equipoise.platform.platform import JointCommand, RobotState
from equipoise.robot.model import RobotModel

_MESSAGES = {"float64_multi_array": Float64MultiArray, "joint_trajectory": JointTrajectory}
_FRESH = 0.25  # [s] for which a sample says where the joints are
_PATIENCE = 4.0  # [s] for both topics and the controller to be found; less than a platform's, because this knows more


class Ros2Link:
    """To a robot whose joints and IMU are on ROS 2 topics.

    A state is handed out whenever either topic brings something, with the newest of the other: joints and IMU keep their own
    times and rates. `received` is when the older of the two arrived, so that a topic that falls silent shows.
    """

    def __init__(self, robot: RobotModel, settings: Ros2Settings) -> None:
        self._settings = settings
        self._joint_names = robot.joint_names
        self._order = _controller_order(robot.joint_names, settings.joint_order or robot.joint_names)
        self._clock = StampClock(settings.stamps == "header")
        self._joints = JointTopic(settings.joint_state_topic, self._clock, robot.joint_names)
        self._imu = ImuTopic(settings.imu_topic, self._clock)
        self._commanded = False
        self._domain = DdsDomain(settings.domain, settings.interface, settings.peers, settings.accept_cyclonedds)
        self._joint_inbox = self._domain.inbox(dds_topic(settings.joint_state_topic), raw(JointState))
        self._imu_inbox = self._domain.inbox(dds_topic(settings.imu_topic), raw(Imu))
        self._outbox = self._domain.outbox(dds_topic(settings.commands_to), _MESSAGES[settings.command_type])
        self._opened = time.monotonic()

    @property
    def name(self) -> str:
        return f"ros2 domain {self._settings.domain} on {self._settings.interface}"

    @property
    def joint_names(self) -> tuple[str, ...]:
        return self._joint_names

    @property
    def accepts(self) -> frozenset[str]:
        return frozenset({"torque"}) if self._settings.stiffness else frozenset()

    @property
    def control_period(self) -> float:
        return 1 / self._settings.rate

    @property
    def damaged(self) -> int:
        """Messages that could not be read."""
        return self._joints.damaged + self._imu.damaged

    def receive(self) -> list[RobotState]:
        """As a link's.

        Raises:
            CommunicationError: one of the topics has brought nothing since the link was opened.
            SettingsError: the robot has other joints than the model.
            SensorError: the messages carry no times, or times of different clocks, or no angular velocity or acceleration.
        """
        arrived = [(received, self._joints.hear, sample) for received, sample in self._joint_inbox.take()]
        arrived += [(received, self._imu.hear, sample) for received, sample in self._imu_inbox.take()]
        states: list[RobotState] = []
        for received, hear, sample in sorted(arrived, key=lambda item: item[0]):
            if hear(received, sample.data) and self._joints.newest is not None and self._imu.newest is not None:
                states.append(together(self._joints.newest, self._imu.newest, self._clock.health))
        if self._joints.newest is None or self._imu.newest is None:
            self._look_for_both()
        return states

    def send(self, command: JointCommand) -> None:
        """As a link's.

        Raises:
            CommunicationError: no controller listens.
            SettingsError: a version of DDS that is unsafe beside this one has come to the domain.
        """
        if not self._outbox.heard and time.monotonic() - self._opened > _PATIENCE:
            raise CommunicationError(
                f"nobody listens to {self._settings.commands_to} in {self.name}: is the controller loaded and active "
                "('ros2 control list_controllers'), is command_topic its name?"
            )
        if not self._commanded:
            self._domain.check_company()  # others may have come since
        target = command.position
        if command.torque is not None and self._settings.stiffness:
            target = target + command.torque / self._settings.stiffness
        self._outbox.send(self._message(target[self._order].tolist()))
        self._commanded = True

    def release(self) -> None:
        """Let the robot stay where it is: a position controller has no torque to take away.

        Nothing is sent if nothing was before, or if it is not known where the joints are: they are held where they were sent.
        """
        here = self._joints.newest
        if self._commanded and here is not None and time.monotonic() - here.received < _FRESH:
            self._outbox.send(self._message(here.position[self._order].tolist()))
        self._commanded = False

    def close(self) -> None:
        self._domain.close()

    def _message(self, positions: list[float]) -> Float64MultiArray | JointTrajectory:
        if self._settings.command_type == "float64_multi_array":
            return Float64MultiArray(data=positions)
        nanoseconds = round(1e9 * self._settings.time_from_start)
        point = JointTrajectoryPoint(positions, time_from_start=Duration(*divmod(nanoseconds, 10**9)))
        return JointTrajectory(Header(), [self._joint_names[joint] for joint in self._order], [point])

    def _look_for_both(self) -> None:
        """Say what is missing, as long as something is."""
        if time.monotonic() - self._opened < _PATIENCE:
            return
        if self._joints.others and self._joints.newest is None:
            raise self._joints.refuse(self._joint_names, self._joints.others)
        topics = (("JointState", self._joints, self._joint_inbox), ("Imu", self._imu, self._imu_inbox))
        missing = [_silent(kind, topic.topic, inbox) for kind, topic, inbox in topics if topic.newest is None]
        raise CommunicationError(
            f"{' and '.join(missing)} in {self.name}: are the broadcasters active, are the topics' names right, is the domain "
            "the robot's ROS_DOMAIN_ID, does ROS use this interface?"
        )


def open_link(robot: RobotModel, settings: Ros2Settings) -> Ros2Link:
    """To the robot that the settings name.

    Raises:
        SettingsError: there is no such interface, `joint_order` is not the model's joints, or the version of cyclonedds is not
            proven beyond loopback.
        CommunicationError: the domain cannot be opened.
    """
    return Ros2Link(robot, settings)


def _controller_order(joint_names: tuple[str, ...], names: tuple[str, ...]) -> NDArray[np.intp]:
    """Which of the model's joints the controller has in each place."""
    wrong = tuple(sorted(set(names) ^ set(joint_names)))
    if wrong or len(set(names)) != len(names):
        told = f"{listed(wrong)} in only one of them" if wrong else "a joint is there twice"
        raise SettingsError(
            f"joint_order must hold each joint of the model once: {told}; the model has {listed(joint_names)}"
        )
    return np.array([joint_names.index(name) for name in names])


def _silent(kind: str, topic: str, inbox: Inbox) -> str:
    return f"nothing on {topic}" if inbox.offered else f"nobody publishes {kind} on {topic}"
