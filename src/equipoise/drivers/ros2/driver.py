"""ROS 2 robots and Gazebo, without a ROS installation: JointState and Imu in, commands of joints out, over DDS.

What the controllers on the other side must be is in docs/hardware/ros2.md.
"""

from __future__ import annotations

import time
from typing import Any

from equipoise.drivers.checkup import CheckupFinding
from equipoise.drivers.dds.domain import DdsDomain, Inbox, raw
from equipoise.drivers.ros2.command_topics import controllers_of
from equipoise.drivers.ros2.outlook import REMEDY, listeners, stiffness
from equipoise.drivers.ros2.ros2_settings import Ros2Settings
from equipoise.drivers.ros2.ros_messages import Imu, JointState, dds_topic
from equipoise.drivers.ros2.sensor_topics import ImuTopic, JointTopic, StampClock, together
from equipoise.errors import CommunicationError
from equipoise.platform.platform import JointCommand, RobotState
from equipoise.robot.model import RobotModel

_FRESH = 0.25  # [s] for which a sample says where the joints are
_PATIENCE = 4.0  # [s] for topics and controllers to be found; less than a platform's, because this knows more
_LOOK = 5e-3  # [s] between looks for controllers
_RELEASES = 10  # the last command, so often: some may get lost


class Ros2Connection:
    """To a robot whose joints and IMU are on ROS 2 topics.

    A state is handed out whenever either topic brings something, with the newest of the other: joints and IMU keep their own
    times and rates. `received` is when the older of the two arrived, so that a topic that falls silent shows.
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
        """Number of messages that arrived and could not be read."""
        return self._joints.damaged + self._imu.damaged

    def receive(self) -> list[RobotState]:
        """Return the samples that have arrived, as a connection does.

        Raises:
            CommunicationError: one of the topics has brought nothing since the link was opened, or two robots write on one.
            SettingsError: the robot has other joints than the model.
            SensorError: the messages carry no times, or times of different clocks, or no angular velocity or acceleration.
        """
        topics = ((self._joints, self._joint_inbox), (self._imu, self._imu_inbox))
        arrived = [(received, topic, inbox, sample) for topic, inbox in topics for received, sample in inbox.take()]
        states: list[RobotState] = []
        for received, topic, inbox, sample in sorted(arrived, key=lambda item: item[0]):
            if not topic.hear(received, sample.data):
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
            CommunicationError: a topic of commands has no controller that listens.
            SettingsError: a version of DDS that is unsafe beside this one has come to the domain.
        """
        if not self._commanded:
            self._domain.check_company()  # others may have come since
            self._wait_for_controllers()
        self._tell(command)
        self._commanded = True
        if unheard := self._unheard():  # the others were told all the same: it may be to damp
            raise self._nobody(unheard)

    def foretell(self) -> list[CheckupFinding]:
        """Predict the first command: which controllers listen, and whether joints that positions have to move are limp."""
        torque = None if self._joints.newest is None else self._joints.newest.torque
        limp_at_first = self._controllers.limp is not None
        return [listeners(tuple(self._outboxes), self._unheard()), *stiffness(self._robot, torque, limp_at_first)]

    def release(self) -> None:
        """No torque; a position controller has none to take away, and lets the robot stay where it is.

        Nothing is sent if nothing was before, or if it is not known where the joints are: they are held where they were sent.
        """
        here, limp = self._joints.newest, self._controllers.limp
        if self._commanded and limp is not None:
            for _ in range(_RELEASES):
                self._tell(limp)
                time.sleep(self.control_period)
        elif self._commanded and here is not None and time.monotonic() - here.received < _FRESH:
            self._tell(JointCommand(here.position))
        self._commanded = False

    def close(self) -> None:
        self._domain.close()

    def _check_one_writer(self, topic: str, inbox: Inbox, sample: Any) -> None:
        """Two writers of these joints, or of the IMU, are two robots; who writes other joints is not asked."""
        writer, known = sample.sample_info.publication_handle, self._writers.get(topic)
        self._writers[topic] = writer
        if known not in (None, writer) and known in (names := inbox.names_of_writers()):
            raise CommunicationError(
                f"two robots write on {topic} in {self.name}, and both would obey the same commands: "
                f"{names[known]} and {names.get(writer, 'another process')}. End the other one, or give this robot a "
                "ROS_DOMAIN_ID of its own"
            )

    def _tell(self, command: JointCommand) -> None:
        for topic, message in self._controllers.told(command).items():
            self._outboxes[topic].send(message)

    def _unheard(self) -> list[str]:
        return [topic for topic, outbox in self._outboxes.items() if not outbox.readers]

    def _wait_for_controllers(self) -> None:
        """All of them: half of an impedance is none, or one without damping."""
        while (unheard := self._unheard()) and time.monotonic() - self._opened < _PATIENCE:
            time.sleep(_LOOK)
        if unheard:
            raise self._nobody(unheard)

    def _nobody(self, unheard: list[str]) -> CommunicationError:
        return CommunicationError(f"nobody listens to {', '.join(unheard)} in {self.name}: {REMEDY}")

    def _look_for_both(self) -> None:
        """Say what is missing, as long as something is."""
        if time.monotonic() - self._opened < _PATIENCE:
            return
        if self._joints.others and self._joints.newest is None:
            raise self._joints.refuse(self.joint_names, self._joints.others)
        topics = (("JointState", self._joints, self._joint_inbox), ("Imu", self._imu, self._imu_inbox))
        missing = [_silent(kind, topic.topic, inbox) for kind, topic, inbox in topics if topic.newest is None]
        raise CommunicationError(
            f"{' and '.join(missing)} in {self.name}: are the broadcasters active, are the topics' names right, is the domain "
            "the robot's ROS_DOMAIN_ID, does ROS use this interface?"
        )


def open_connection(robot: RobotModel, settings: Ros2Settings) -> Ros2Connection:
    """Open the connection to the robot that the settings name.

    Raises:
        SettingsError: the interface does not exist, `joint_order` is not the model's joints, or the version of cyclonedds
            is not proven beyond loopback.
        CommunicationError: the domain cannot be opened.
    """
    return Ros2Connection(robot, settings)


def _silent(kind: str, topic: str, inbox: Inbox) -> str:
    return f"nothing on {topic}" if inbox.writers else f"nobody publishes {kind} on {topic}"
