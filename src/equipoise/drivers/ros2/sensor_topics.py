"""Samples of a robot from ROS 2 messages: joints by their names, times by the robot's clock or ours."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from equipoise.conventions import FloatArray
from equipoise.drivers.ros2.ros_messages import Imu, JointState
from equipoise.errors import SensorError, SettingsError
from equipoise.platform.platform import Health, RobotState

_PACE_WINDOW = 2.0  # [s] over which the robot's clock is held against ours
_PACE_TOLERANCE = 0.4  # as a fraction: a busy computer may cost some of it; a simulation in slow motion is far off
_ASUNDER = 1.0  # [s] between the newest of both topics, beyond which they are not of one clock


@dataclass(frozen=True, eq=False)
class JointSample:
    """Sample of a JointState, vectors in the model's order; a value that the robot does not report is None."""

    time: float
    received: float
    position: FloatArray
    velocity: FloatArray | None
    torque: FloatArray | None


@dataclass(frozen=True, eq=False)
class ImuSample:
    """Sample of an Imu, in its frame."""

    time: float
    received: float
    angular_velocity_in_imu: FloatArray
    acceleration_in_imu: FloatArray


class StampClock:
    """The times of samples, counted from the second in which the first was stamped, and how fast they pass.

    Args:
        by_header: whether to take the messages' stamps; else the times of their arrival.

    Attributes:
        health: warning if the robot's time passes much faster or slower than ours: a simulation in slow motion, which
            would be moved too fast.
    """

    def __init__(self, by_header: bool) -> None:
        self._by_header = by_header
        self._origin: int | None = None
        self._began: tuple[float, float] | None = None
        self.health: Health | None = None

    def time(self, header: Any, received: float) -> float | None:
        """Return the time of a message [s]; None if it has no stamp."""
        stamp = header.stamp
        if not self._by_header:
            return received
        if stamp.sec == stamp.nanosec == 0:
            return None
        if self._origin is None:
            self._origin = stamp.sec
        return stamp.sec - self._origin + 1e-9 * stamp.nanosec

    def compare(self, at: float, received: float) -> None:
        """Hold the robot's clock against ours, every two seconds."""
        if self._began is None:
            self._began = at, received
        elif received - self._began[1] > _PACE_WINDOW:
            pace = (at - self._began[0]) / (received - self._began[1])
            off = abs(pace - 1) > _PACE_TOLERANCE
            self.health = Health(fault=f"its time passes {pace:.2f} times as fast as ours") if off else None
            self._began = at, received


class _Topic:
    """Messages of one topic.

    Attributes:
        newest: newest sample, or None.
        damaged: number of messages that could not be read.
    """

    kind: Any

    def __init__(self, topic: str, clock: StampClock) -> None:
        self.topic = topic
        self.damaged: int = 0
        self._clock = clock
        self._unstamped: int = 0

    def _message(self, data: bytes | bytearray) -> Any:
        """None if it is damaged: cyclonedds has checked the layout, but a name may still be no text."""
        try:
            return self.kind.deserialize(bytes(data))
        except (ValueError, IndexError, struct.error):
            self.damaged += 1
            return None

    def _time(self, header: Any, received: float) -> float | None:
        """[s]; a simulation's first message may have no stamp, as its time is zero.

        Raises:
            SensorError: another one has none.
        """
        at = self._clock.time(header, received)
        self._unstamped += at is None
        if self._unstamped > 1:
            raise SensorError(f"{self.topic} does not say when it measured: its stamps are zero. Use stamps=arrival")
        return at


class JointTopic(_Topic):
    """JointState messages, joints found by their names.

    Attributes:
        others: names in messages without any of the model's joints, as those of an arm or a gripper.
    """

    kind = JointState

    def __init__(self, topic: str, clock: StampClock, joint_names: tuple[str, ...]) -> None:
        super().__init__(topic, clock)
        self.newest: JointSample | None = None
        self.others: tuple[str, ...] = ()
        self._joint_names = joint_names
        self._places: dict[tuple[str, ...], NDArray[np.intp] | None] = {}

    def hear(self, received: float, data: bytes | bytearray) -> bool:
        """Take a message; whether it was the legs'.

        Raises:
            SettingsError: some of the model's joints are in it, and some not.
            SensorError: messages have no stamps.
        """
        message = self._message(data)
        if message is None or (places := self._places_of(tuple(message.name))) is None:
            return False
        position = _chosen(message.position, places, len(message.name))
        if position is None:
            self.damaged += 1
            return False
        at = self._time(message.header, received)
        if at is None:
            return False
        self._clock.compare(at, received)
        velocity, torque = (_chosen(each, places, len(message.name)) for each in (message.velocity, message.effort))
        self.newest = JointSample(at, received, position, _known(velocity), _known(torque))
        return True

    def refuse(self, missing: tuple[str, ...], seen: tuple[str, ...]) -> SettingsError:
        """The error that names the joints."""
        return SettingsError(
            f"{self.topic} lacks the model's {listed(missing)}; it has {listed(seen)}. Load the model that the robot itself "
            "runs: /robot_description holds it"
        )

    def _places_of(self, names: tuple[str, ...]) -> NDArray[np.intp] | None:
        """Return the places of the model's joints in a message; None if they are not in it."""
        if names not in self._places:
            missing = tuple(name for name in self._joint_names if name not in names)
            if 0 < len(missing) < len(self._joint_names):
                raise self.refuse(missing, names)
            self._places[names] = None if missing else np.array([names.index(name) for name in self._joint_names])
            self.others = names if missing else self.others
        return self._places[names]


class ImuTopic(_Topic):
    """Imu messages."""

    kind = Imu

    def __init__(self, topic: str, clock: StampClock) -> None:
        super().__init__(topic, clock)
        self.newest: ImuSample | None = None

    def hear(self, received: float, data: bytes | bytearray) -> bool:
        """Take a message; whether it could be read.

        Raises:
            SensorError: messages have no stamps, or no angular velocity or acceleration.
        """
        message = self._message(data)
        if message is None:
            return False
        if message.angular_velocity_covariance[0] == -1 or message.linear_acceleration_covariance[0] == -1:
            raise SensorError(f"{self.topic} says that it has no angular velocity or no acceleration; both are needed")
        at = self._time(message.header, received)
        if at is None:
            return False
        turning, felt = message.angular_velocity, message.linear_acceleration
        self.newest = ImuSample(
            at, received, np.array([turning.x, turning.y, turning.z]), np.array([felt.x, felt.y, felt.z])
        )
        return True


def together(joints: JointSample, imu: ImuSample, health: Health | None) -> RobotState:
    """The newest of both as one state, received when the older of the two was.

    Raises:
        SensorError: their times are far apart: of a simulation and of day, of two computers.
    """
    if abs(joints.time - imu.time) > _ASUNDER:
        raise SensorError(
            f"joints and IMU are stamped {joints.time - imu.time:+.1f} s apart: do all nodes use one clock (use_sim_time), "
            "are the computers' clocks right, has one of the topics fallen silent? Times of arrival may do: stamps=arrival"
        )
    return RobotState(
        joints.time,
        joints.position,
        joints.velocity,
        joints.torque,
        imu.angular_velocity_in_imu,
        imu.acceleration_in_imu,
        imu.time,
        min(joints.received, imu.received),
        health,
    )


def listed(names: tuple[str, ...]) -> str:
    """Names for a message."""
    return ", ".join(repr(name) for name in names)


def _chosen(values: list[float], places: NDArray[np.intp], count: int) -> FloatArray | None:
    """A vector of a JointState in the model's order; None if it is left empty."""
    return np.array(values)[places] if len(values) == count else None


def _known(values: FloatArray | None) -> FloatArray | None:
    """None if a joint has no such value: broadcasters write NaN for an interface that the hardware does not have."""
    return None if values is None or np.isnan(values).any() else values
