"""Samples of a robot from ROS 2 messages: joints by name, times on the robot's or this computer's clock."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from equipoise.conventions import FloatArray
from equipoise.drivers.ros2.ros_messages import Imu, JointState
from equipoise.errors import MotionError, SettingsError
from equipoise.platform.platform import Health, RobotState

_PACE_WINDOW = 2.0  # [s] over which the robot's clock is compared with this computer's
_PACE_TOLERANCE = 0.4  # as a fraction: a busy computer needs some of it; a simulation in slow motion exceeds it
_MAX_STAMP_DIFFERENCE = 1.0  # [s] between the newest of both topics; beyond it they have different clocks


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
    """Clock of sample times, counted from the second of the first stamp, and its rate.

    Args:
        by_header: whether to use the messages' stamps; otherwise their times of arrival.

    Attributes:
        health: warning if the robot's clock is much faster or slower than this computer's: a simulation in slow motion
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
        """Compare the robot's clock with this computer's, every two seconds."""
        if self._began is None:
            self._began = at, received
        elif received - self._began[1] > _PACE_WINDOW:
            pace = (at - self._began[0]) / (received - self._began[1])
            off = abs(pace - 1) > _PACE_TOLERANCE
            self.health = Health(fault=f"its clock runs {pace:.2f} times as fast as this computer's") if off else None
            self._began = at, received


class _Topic:
    """Messages of one topic.

    Attributes:
        newest: newest sample, or None.
        damaged: number of messages that could not be decoded.
    """

    kind: Any

    def __init__(self, topic: str, clock: StampClock) -> None:
        self.topic = topic
        self.damaged: int = 0
        self._clock = clock
        self._unstamped: int = 0

    def _message(self, data: bytes | bytearray) -> Any:
        """Decode a message, or return None if it is damaged: cyclonedds checks the layout, but not that names are text."""
        try:
            return self.kind.deserialize(bytes(data))
        except (ValueError, IndexError, struct.error):
            self.damaged += 1
            return None

    def _time(self, header: Any, received: float) -> float | None:
        """Return a message's time [s]; a simulation's first message may have stamp zero.

        Raises:
            MotionError: a later stamp is zero.
        """
        at = self._clock.time(header, received)
        self._unstamped += at is None
        if self._unstamped > 1:
            raise MotionError(f"{self.topic}: the stamps are zero. Use stamps=arrival")
        return at


class JointTopic(_Topic):
    """JointState messages, with joints by name.

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

    def add(self, received: float, data: bytes | bytearray) -> bool:
        """Decode a message; return whether it has the model's joints.

        Raises:
            SettingsError: the message has only some of the model's joints.
            MotionError: messages have no stamps.
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
        self.newest = JointSample(at, received, position, _reported(velocity), _reported(torque))
        return True

    def missing_joints(self, missing: tuple[str, ...], found: tuple[str, ...]) -> SettingsError:
        """Return the error that names the missing joints."""
        return SettingsError(
            f"{self.topic} lacks the model's {listed(missing)}; it has {listed(found)}. Load the robot's own model, from "
            "/robot_description"
        )

    def _places_of(self, names: tuple[str, ...]) -> NDArray[np.intp] | None:
        """Return the indices of the model's joints in a message; None if they are not in it."""
        if names not in self._places:
            missing = tuple(name for name in self._joint_names if name not in names)
            if 0 < len(missing) < len(self._joint_names):
                raise self.missing_joints(missing, names)
            self._places[names] = None if missing else np.array([names.index(name) for name in self._joint_names])
            self.others = names if missing else self.others
        return self._places[names]


class ImuTopic(_Topic):
    """Imu messages."""

    kind = Imu

    def __init__(self, topic: str, clock: StampClock) -> None:
        super().__init__(topic, clock)
        self.newest: ImuSample | None = None

    def add(self, received: float, data: bytes | bytearray) -> bool:
        """Decode a message; return whether it was valid.

        Raises:
            MotionError: messages have no stamps, or no angular velocity or acceleration.
        """
        message = self._message(data)
        if message is None:
            return False
        if message.angular_velocity_covariance[0] == -1 or message.linear_acceleration_covariance[0] == -1:
            raise MotionError(f"{self.topic} reports no angular velocity or no acceleration; both are needed")
        at = self._time(message.header, received)
        if at is None:
            return False
        w, a = message.angular_velocity, message.linear_acceleration
        self.newest = ImuSample(at, received, np.array([w.x, w.y, w.z]), np.array([a.x, a.y, a.z]))
        return True


def together(joints: JointSample, imu: ImuSample, health: Health | None) -> RobotState:
    """Return the newest samples as one state, with the earlier time of arrival.

    Raises:
        MotionError: their times are far apart: from a simulation and a real clock, or from two computers.
    """
    if abs(joints.time - imu.time) > _MAX_STAMP_DIFFERENCE:
        raise MotionError(
            f"joints and IMU are stamped {joints.time - imu.time:+.1f} s apart: do all nodes use one clock (use_sim_time), "
            "are the computers' clocks right, has one of the topics stopped? stamps=arrival uses times of arrival instead"
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
    """Return a list of names for a message."""
    return ", ".join(repr(name) for name in names)


def _chosen(values: list[float], places: NDArray[np.intp], count: int) -> FloatArray | None:
    """Return a vector of a JointState in the model's order; None if it is empty."""
    return np.array(values)[places] if len(values) == count else None


def _reported(values: FloatArray | None) -> FloatArray | None:
    """Return values, or None if any is NaN: broadcasters write NaN for interfaces that the hardware does not have."""
    return None if values is None or np.isnan(values).any() else values
