"""ROS 2 robots and Gazebo, without a ROS installation: JointState and Imu in, commands of joints out, over DDS.

docs/hardware/ros2.md lists the required controllers.
"""

from __future__ import annotations

import time
from typing import Any

from equipoise.drivers.checkup import CheckupFinding
from equipoise.drivers.dds.domain import DdsDomain, Inbox, raw
from equipoise.drivers.ros2.command_topics import controllers_of
from equipoise.drivers.ros2.ros2_settings import Ros2Settings
from equipoise.drivers.ros2.ros_messages import Imu, JointState, dds_topic
from equipoise.drivers.ros2.sensor_topics import ImuTopic, JointTopic, StampClock, together
from equipoise.drivers.ros2.takeover_checks import REMEDY, stiffness, subscribers
from equipoise.errors import CommunicationError
from equipoise.platform.platform import JointCommand, RobotState
from equipoise.robot.model import RobotModel

_FRESH = 0.25  # [s] for which a sample determines the joint positions
_PATIENCE = 4.0  # [s] for discovery of topics and controllers; less than a platform's, whose message is less specific
_LOOK = 5e-3  # [s] between checks for controllers
_RELEASES = 10  # repetitions of the last command: some may get lost


class Ros2Connection:
    """Connection to a robot whose joints and IMU are on ROS 2 topics.

    Each message of either topic gives a state, with the newest sample of the other: joints and IMU keep their own times and
    rates. `received` is the earlier time of arrival of the two, so that a silent topic is detected.
    """

    def __init__(self, robot: RobotModel, settings: Ros2Settings) -> None:
        self._robot, self._settings = robot, settings
        self._controllers = controllers_of(robot, settings)
        self.name, self.joint_names = f"ros2 domain {settings.domain} on {settings.interface}", robot.joint_names
        self.accepts, self.control_period = self._controllers.accepts, 1 / settings.rate
        self._clock = StampClock(settings.stamps == "header")
        self._joints = JointTopic(settings.joint_state_topic, self._clock, robot.joint_names)
        self._imu = ImuTopic(settings.imu_topic, self._clock)
        self._commanded = False
        self._writers: dict[str, int] = {}
        self._domain = DdsDomain(settings.domain, settings.interface, settings.peers, settings.accept_cyclonedds)
        self._joint_inbox = self._domain.inbox(dds_topic(settings.joint_state_topic), raw(JointState))
        self._imu_inbox = self._domain.inbox(dds_topic(settings.imu_topic), raw(Imu))
        self._outboxes = {
            topic: self._domain.outbox(dds_topic(topic), kind) for topic, kind in self._controllers.messages.items()
        }
        self._opened = time.monotonic()

    @property
    def rejected(self) -> int:
        """Number of messages that could not be decoded."""
        return self._joints.damaged + self._imu.damaged

    def receive(self) -> list[RobotState]:
        """Return the samples that have arrived, as a connection does.

        Raises:
            CommunicationError: one of the topics has had no message for seconds, or two robots write on one.
            SettingsError: the robot's joints are not the model's.
            MotionError: the messages have no stamps, stamps of different clocks, or no angular velocity or acceleration.
        """
        topics = ((self._joints, self._joint_inbox), (self._imu, self._imu_inbox))
        arrived = [(received, topic, inbox, sample) for topic, inbox in topics for received, sample in inbox.take()]
        states: list[RobotState] = []
        for received, topic, inbox, sample in sorted(arrived, key=lambda item: item[0]):
            if not topic.add(received, sample.data):
                continue
            self._check_one_writer(topic.topic, inbox, sample)
            if self._joints.newest is not None and self._imu.newest is not None:
                states.append(together(self._joints.newest, self._imu.newest, self._clock.health))
        if self._joints.newest is None or self._imu.newest is None:
            self._look_for_both()
        return states

    def send(self, command: JointCommand) -> None:
        """Send a command, as a connection does.

        Raises:
            CommunicationError: a command topic has no subscriber.
            SettingsError: a process with an unsafe version of DDS has joined the domain.
        """
        if not self._commanded:
            self._domain.check_versions()  # others may have joined since
            self._wait_for_controllers()
        self._send_all(command)
        self._commanded = True
        if topics := self._unread():  # the others still get the command: it may be a damping command
            raise self._no_subscriber(topics)

    def check_takeover(self) -> list[CheckupFinding]:
        """Return findings about the first command: subscribers of the command topics, and limp joints."""
        torque = None if self._joints.newest is None else self._joints.newest.torque
        limp_at_first = self._controllers.limp is not None
        return [subscribers(tuple(self._outboxes), self._unread()), *stiffness(self._robot, torque, limp_at_first)]

    def release(self) -> None:
        """Send zero torque under impedance control; let position controllers hold the present positions.

        Nothing is sent if no command was sent before. Without fresh positions, position controllers hold their last target.
        """
        here, limp = self._joints.newest, self._controllers.limp
        if self._commanded and limp is not None:
            for _ in range(_RELEASES):
                self._send_all(limp)
                time.sleep(self.control_period)
        elif self._commanded and here is not None and time.monotonic() - here.received < _FRESH:
            self._send_all(JointCommand(here.position))
        self._commanded = False

    def close(self) -> None:
        self._domain.close()

    def _check_one_writer(self, topic: str, inbox: Inbox, sample: Any) -> None:
        """Raise CommunicationError if two processes write these joints or the IMU: they are two robots."""
        writer, previous = sample.sample_info.publication_handle, self._writers.get(topic)
        self._writers[topic] = writer
        if previous not in (None, writer) and previous in (names := inbox.names_of_writers()):
            raise CommunicationError(
                f"two robots write on {topic} in {self.name}, and both would execute the same commands: "
                f"{names[previous]} and {names.get(writer, 'another process')}. End the other one, or give this robot its "
                "own ROS_DOMAIN_ID"
            )

    def _send_all(self, command: JointCommand) -> None:
        for topic, message in self._controllers.encode(command).items():
            self._outboxes[topic].send(message)

    def _unread(self) -> list[str]:
        return [topic for topic, outbox in self._outboxes.items() if not outbox.readers]

    def _wait_for_controllers(self) -> None:
        """Wait for a subscriber of every command topic: a part of an impedance command may lack its damping."""
        while (topics := self._unread()) and time.monotonic() - self._opened < _PATIENCE:
            time.sleep(_LOOK)
        if topics:
            raise self._no_subscriber(topics)

    def _no_subscriber(self, topics: list[str]) -> CommunicationError:
        return CommunicationError(f"no controller subscribes to {', '.join(topics)} in {self.name}: {REMEDY}")

    def _look_for_both(self) -> None:
        """After `_PATIENCE`, raise CommunicationError with the silent topics, or SettingsError with the missing joints."""
        if time.monotonic() - self._opened < _PATIENCE:
            return
        if self._joints.others and self._joints.newest is None:
            raise self._joints.missing_joints(self.joint_names, self._joints.others)
        topics = (("JointState", self._joints, self._joint_inbox), ("Imu", self._imu, self._imu_inbox))
        missing = [_silent(kind, topic.topic, inbox) for kind, topic, inbox in topics if topic.newest is None]
        raise CommunicationError(
            f"{' and '.join(missing)} in {self.name}: are the broadcasters active, are the topic names right, is the domain "
            "the robot's ROS_DOMAIN_ID, and does ROS use this interface?"
        )


def open_connection(robot: RobotModel, settings: Ros2Settings) -> Ros2Connection:
    """Open the connection to a robot.

    Raises:
        SettingsError: the interface does not exist, `joint_order` is not the model's joints, or the version of cyclonedds
            is not proven beyond loopback.
        CommunicationError: the domain cannot be opened.
    """
    return Ros2Connection(robot, settings)


def _silent(kind: str, topic: str, inbox: Inbox) -> str:
    return f"no message on {topic}" if inbox.writers else f"no publisher of {kind} on {topic}"
