"""Commands of ros2_control's controllers: topics and messages."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from equipoise.drivers.ros2.ros2_settings import IMPEDANCE, Ros2Settings
from equipoise.drivers.ros2.ros_messages import (
    ENCODED_ARRAY,
    Duration,
    Header,
    JointTrajectory,
    JointTrajectoryPoint,
    encoded_array,
)
from equipoise.drivers.ros2.sensor_topics import listed
from equipoise.errors import SettingsError
from equipoise.platform.platform import ACCEPTS_EVERYTHING, JointCommand
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import nominal_stance

Messages = dict[str, Any]
"""Messages by topic."""


@dataclass(frozen=True)
class Controllers:
    """Controllers that together execute a command.

    Attributes:
        messages: types of messages, by topic.
        encode: function that returns the messages of a command by topic, in the order of sending.
        accepts: values that they use of a command besides positions, as a platform's.
        limp: command that leaves the joints without torque; None: position controllers hold their last target.
    """

    messages: Mapping[str, Any]
    encode: Callable[[JointCommand], Messages]
    accepts: frozenset[str]
    limp: JointCommand | None = None


def controllers_of(robot: RobotModel, settings: Ros2Settings) -> Controllers:
    """Return the controllers of the settings; raise SettingsError if `joint_order` is not the model's joints."""
    names = settings.joint_order or robot.joint_names
    order = _order(robot.joint_names, names)
    if settings.command_type == "impedance":
        return _impedance(robot, names, order, settings.commands_to)
    return _positions(names, order, settings)


def _positions(names: tuple[str, ...], order: NDArray[np.intp], settings: Ros2Settings) -> Controllers:
    """Return one position controller; feed-forward torques become position offsets of a soft one."""
    topic, stiffness = settings.commands_to, settings.stiffness
    time = Duration(*divmod(round(1e9 * settings.time_from_start), 10**9))

    def target(command: JointCommand) -> list[float]:
        torque = 0.0 if command.torque is None or not stiffness else command.torque / stiffness
        return (command.position + torque)[order].tolist()

    def array(command: JointCommand) -> Messages:
        return {topic: encoded_array(target(command))}

    def trajectory(command: JointCommand) -> Messages:
        point = JointTrajectoryPoint(target(command), time_from_start=time)
        return {topic: JointTrajectory(Header(), list(names), [point])}

    arrays, accepts = settings.command_type == "float64_multi_array", frozenset({"torque"} if stiffness else ())
    return Controllers({topic: ENCODED_ARRAY if arrays else JointTrajectory}, array if arrays else trajectory, accepts)


def _impedance(robot: RobotModel, names: tuple[str, ...], order: NDArray[np.intp], pattern: str) -> Controllers:
    """Return a controller for each interface of all joints, or for each joint with all interfaces.

    Topics may overtake each other. Positions are therefore sent before stiffness, and a limp joint keeps its last target:
    in any order of arrival, stiffness never applies to a wrong position.
    """
    kp, kd = robot.gains(nominal_stance(robot).hip_height)
    by_interface = "{interface}" in pattern
    mark, marked = ("{interface}", IMPEDANCE) if by_interface else ("{joint}", names)
    topics = [pattern.replace(mark, name) for name in marked]

    def encode(command: JointCommand) -> Messages:
        table = command.table(kp, kd)[:, order]
        rows = zip(topics, (table if by_interface else table.T).tolist(), strict=True)
        skipped = int(by_interface and command.limp)
        return {topic: encoded_array(row) for topic, row in list(rows)[skipped:]}

    limp = JointCommand.damping(np.zeros(len(names)), 0.0)
    return Controllers(dict.fromkeys(topics, ENCODED_ARRAY), encode, ACCEPTS_EVERYTHING, limp)


def _order(joint_names: tuple[str, ...], names: tuple[str, ...]) -> NDArray[np.intp]:
    """Return the indices of the model's joints in the controllers' order."""
    wrong = tuple(sorted(set(names) ^ set(joint_names)))
    if wrong or len(set(names)) != len(names):
        fault = f"{listed(wrong)} in only one of them" if wrong else "a joint is listed twice"
        raise SettingsError(
            f"joint_order must list each joint of the model once: {fault}; the model has {listed(joint_names)}"
        )
    return np.array([joint_names.index(name) for name in names])
