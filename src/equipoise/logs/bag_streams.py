"""Messages of a bag's topics as arrays: JointState, Imu, and Unitree's states and commands.

Messages are converted in batches while the bag is read: their bytes take four times the memory of their numbers, and those
of a long log would not fit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from equipoise.conventions import FloatArray
from equipoise.drivers.unitree.motors import MOTOR_LEGS
from equipoise.errors import RecordingError
from equipoise.logs.cdr_arrays import Messages, read_messages
from equipoise.logs.message_types import COMMANDS, IMU, JOINT_STATE, MOTOR_NAMES, STATES
from equipoise.logs.raw_log import RawImu, RawJoints
from equipoise.logs.stamps import Stamps
from equipoise.recording.recording import read_only
from equipoise.robot.model import LEG_NAMES

Arrays = dict[tuple[str, str], NDArray[Any]]
"""Numbers of n messages, (n,) or (n, k), by quantity and joint; the joint is empty for quantities of the whole robot."""

_BATCH = 4096  # messages
_OF_JOINTS = ("position", "velocity", "torque")
_WHOLE_NUMBERS = ("received", "header", "ticks")


class GatheredTopic:
    """Messages of a topic while a bag is read.

    Args:
        topic: name of the topic.
        message_type: type of the messages.
        types: field definitions by type.
        room: number of messages that the bag states.

    Attributes:
        frame: frame that the first message names.
    """

    def __init__(self, topic: str, message_type: str, types: Mapping[str, Any], room: int) -> None:
        self.topic, self.type, self.frame, self._types, self._room = topic, message_type, "", types, room
        self._received: list[int] = []
        self._bodies: list[bytes] = []  # of messages that are not in the tables yet
        self._tables: Arrays = {}
        self._count = 0  # of messages in the tables

    def take(self, received: int, body: bytes) -> None:
        """Add a message, with its time of receipt [ns]."""
        self._received.append(received)
        self._bodies.append(body)
        if len(self._bodies) >= _BATCH:
            self._read()

    def streams(self) -> tuple[Stamps, RawJoints | None, RawImu | None]:
        """Return all messages in order of receipt: clock, joints and IMU. The times of joints and IMU are still empty."""
        self._read()
        names = tuple(dict.fromkeys(joint for _, joint in self._tables if joint))
        shared = {quantity for quantity, joint in self._tables if not joint}
        whole = {quantity: self._tables.pop((quantity, ""))[: self._count] for quantity in shared}
        whole |= {quantity: table for quantity in _OF_JOINTS if (table := self._stacked(quantity, names)) is not None}
        if (np.diff(whole["received"]) < 0).any():  # as a recorder with several threads writes them
            order = np.argsort(whole["received"], kind="stable")
            whole = {quantity: table[order] for quantity, table in whole.items()}
        for table in whole.values():
            read_only(table)
        none, empty = np.empty(0, dtype=np.int64), np.empty(0)
        clock = Stamps(self.topic, *(whole.get(quantity, none) for quantity in _WHOLE_NUMBERS))
        joints = imu = None
        if "position" in whole:
            velocity, torque, force = (whole.get(quantity) for quantity in ("velocity", "torque", "foot_force"))
            joints = RawJoints(empty, names, whole["position"], velocity, torque, force)
        if "gyroscope" in whole:
            imu = RawImu(empty, whole["gyroscope"], whole["accelerometer"], whole.get("orientation"))
        return clock, joints, imu

    def _read(self) -> None:
        """Put the messages that were taken last into the tables."""
        end = self._count + len(self._bodies)
        if end > self._room:  # metadata may be older than the bag
            self._room = 2 * end
            self._tables = {key: self._table(key, table[: self._count]) for key, table in self._tables.items()}
        for key, table in self._tables.items():
            table[self._count : end] = _missing(key)
        for group in read_messages(self._types, self.type, self._bodies):
            if not self._tables:
                self.frame = group.texts.get("header.frame_id", "")
            for key, values in _ARRAYS[self.type](self, group).items():
                self._put(key, self._count + group.rows, values)
        self._put(("received", ""), np.arange(self._count, end), np.array(self._received))
        self._count, self._received, self._bodies = end, [], []

    def _put(self, key: tuple[str, str], rows: NDArray[np.intp], values: NDArray[Any]) -> None:
        if key not in self._tables:
            before = np.full((self._count + len(self._bodies), *values.shape[1:]), _missing(key))
            self._tables[key] = self._table(key, before)
        self._tables[key][rows] = values

    def _table(self, key: tuple[str, str], rows: NDArray[Any]) -> NDArray[Any]:
        """Return a table that begins with some rows; the rest takes no memory until it is written."""
        table = np.empty((self._room, *rows.shape[1:]), np.int64 if key[0] in _WHOLE_NUMBERS else float)
        table[: len(rows)] = rows
        return table

    def _stacked(self, quantity: str, names: Sequence[str]) -> FloatArray | None:
        """Return a quantity of all joints, NaN where a message lacks it; None if all do. Its columns are removed."""
        missing = np.full(self._count, np.nan)
        columns = [self._tables.pop((quantity, name), missing)[: self._count] for name in names]
        return None if all(np.isnan(column).all() for column in columns) else np.column_stack(columns)


def _missing(key: tuple[str, str]) -> float:
    return 0 if key[0] in _WHOLE_NUMBERS else np.nan


def _joint_states(topic: GatheredTopic, of: Messages) -> Arrays:
    """Return columns by name; messages may name different joints, or the same in another order."""
    del topic
    names = [text for path, text in of.texts.items() if path.startswith("name.")]
    arrays: Arrays = {("header", ""): _stamps(of, "header.stamp")}
    for quantity, field in zip(_OF_JOINTS, ("position", "velocity", "effort"), strict=True):
        numbers = of.numbers[field]
        if numbers.shape[1] == len(names):
            arrays |= {(quantity, name): numbers[:, column] for column, name in enumerate(names)}
    return arrays


def _imus(topic: GatheredTopic, of: Messages) -> Arrays:
    del topic
    orientation = of.stacked("orientation.{}", "wxyz")
    orientation[of.numbers["orientation_covariance"][:, 0] == -1] = np.nan  # by the definition of the message
    return {
        ("header", ""): _stamps(of, "header.stamp"),
        ("gyroscope", ""): of.stacked("angular_velocity.{}", "xyz"),
        ("accelerometer", ""): of.stacked("linear_acceleration.{}", "xyz"),
        ("orientation", ""): orientation,
    }


def _whole_states(topic: GatheredTopic, of: Messages) -> Arrays:
    motors, torque, imu, foot_force = STATES[topic.type]
    if f"{motors}.0.q" not in of.numbers:
        raise RecordingError(
            f"the {topic.type} messages of {topic.topic} hold no motors: name the topic that has them with --joint-topic"
        )
    arrays: Arrays = {("gyroscope", ""): of.numbers[f"{imu}.gyroscope"]}
    arrays["accelerometer", ""] = of.numbers[f"{imu}.accelerometer"]
    for quantity, field in zip(_OF_JOINTS, ("q", "dq", torque), strict=True):
        arrays |= _of_motors(quantity, of, f"{motors}.{{}}.{field}")
    if "stamp.sec" in of.numbers:  # as some recorders add them
        arrays["header", ""] = _stamps(of, "stamp")
    if "tick" in of.numbers:
        arrays["ticks", ""] = of.numbers["tick"]
    if foot_force in of.numbers:
        arrays["foot_force", ""] = of.numbers[foot_force][:, [MOTOR_LEGS.index(leg) for leg in LEG_NAMES]]
    return arrays


def _commands(topic: GatheredTopic, of: Messages) -> Arrays:
    return _of_motors("position", of, f"{COMMANDS[topic.type]}.{{}}.q")


def _of_motors(quantity: str, of: Messages, form: str) -> Arrays:
    return {(quantity, name): of.numbers[form.format(index)] for index, name in enumerate(MOTOR_NAMES)}


def _stamps(of: Messages, path: str) -> NDArray[np.int64]:
    """Return (n,) times of a field [ns]."""
    seconds, rest = (of.numbers[f"{path}.{part}"].astype(np.int64) for part in ("sec", "nanosec"))
    return np.asarray(seconds * 10**9 + rest, dtype=np.int64)


_ARRAYS: Mapping[str, Callable[[GatheredTopic, Messages], Arrays]] = {
    JOINT_STATE: _joint_states,
    IMU: _imus,
    **dict.fromkeys(STATES, _whole_states),
    **dict.fromkeys(COMMANDS, _commands),
}
