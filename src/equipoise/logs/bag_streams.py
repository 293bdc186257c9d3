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
from equipoise.logs.raw_log import RawImu, RawJoints, any_numbers
from equipoise.recording.mcap_reader import Message
from equipoise.recording.recording import read_only
from equipoise.robot.model import LEG_NAMES

Arrays = dict[str, NDArray[Any]]
"""Numbers of n messages, (n,) or (n, k), by quantity."""
Named = tuple[Sequence[str], Arrays]
"""Names of joints, which are the columns of _OF_JOINTS, and the numbers of some messages."""

_BATCH = 4096  # messages
_PERIOD = 10_000_000  # [ns] of thinned topics: commands only help to detect encoders that are frozen for a longer time
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
        thinned: True to keep one message per period only.
        received: (n,) times at which the recorder received the messages [ns since 1970], once `finish` was called.
        header: (n,) stamps in the messages [ns], or empty if they have none; likewise.
        ticks: (n,) counts of an onboard clock in an unknown unit, or empty; likewise.
    """

    def __init__(self, topic: str, message_type: str, types: Mapping[str, Any], room: int) -> None:
        self.topic, self.type, self.frame, self._types, self._room = topic, message_type, "", types, room
        self.thinned = False
        self._messages: list[Message] = []  # those that are not in the tables yet
        self._names: list[str] = []  # columns of quantities of joints
        self._tables: Arrays = {}
        self._count = 0  # of messages in the tables

    def take(self, messages: Sequence[Message]) -> None:
        """Add messages, those of other topics and types excluded."""
        self._messages += [message for message in messages if message[0] == self.topic and message[1] == self.type]
        if len(self._messages) >= _BATCH:
            self._read()

    def finish(self) -> None:
        """Put all messages in order of receipt."""
        self._read()
        tables: Arrays = {name: read_only(table)[: self._count] for name, table in self._tables.items()}
        whole: Arrays = {key: part for key, part in tables.items() if key not in _OF_JOINTS or not np.isnan(part).all()}
        if (np.diff(whole["received"]) < 0).any():  # as a recorder with several threads writes them
            order = np.argsort(whole["received"], kind="stable")
            whole = {quantity: read_only(table[order]) for quantity, table in whole.items()}
        none = np.empty(0, dtype=np.int64)
        self.received, self.header, self.ticks = (whole.get(quantity, none) for quantity in _WHOLE_NUMBERS)
        self._tables = whole

    def joints(self, time: FloatArray) -> RawJoints | None:
        """Return the joints, or None if the messages have no positions; to be called after `finish`.

        Args:
            time: (n,) times of the messages [s].
        """
        if "position" not in self._tables:
            return None
        measured = (self._tables.get(quantity) for quantity in ("velocity", "torque", "foot_force"))
        return RawJoints(time, tuple(self._names), self._tables["position"], *measured)

    def imu(self, time: FloatArray) -> RawImu | None:
        """Return the IMU's samples, as `joints` does."""
        if "gyroscope" not in self._tables:
            return None
        orientation = self._tables.get("orientation")
        return RawImu(time, self._tables["gyroscope"], self._tables["accelerometer"], orientation)

    def _read(self) -> None:
        """Put the messages that were taken last into the tables."""
        messages, self._messages = self._messages, []
        if self.thinned:
            messages = [*{message[2] // _PERIOD: message for message in messages}.values()]
        start, self._count = self._count, self._count + len(messages)
        if self._count > self._room:  # metadata may be older than the bag
            self._room = 2 * self._count
            self._tables = {name: self._table(name, table[:start]) for name, table in self._tables.items()}
        for quantity, table in self._tables.items():
            table[start : self._count] = _missing(quantity)
        for group in read_messages(self._types, self.type, [message[3] for message in messages]):
            if not self._tables:
                self.frame = group.texts.get("header.frame_id", "")
            names, arrays = _ARRAYS[self.type](self, group)
            columns = self._columns(names)
            for quantity, values in arrays.items():
                self._put(quantity, start + group.rows, columns, values)
        self._put("received", np.arange(start, self._count), [], np.array([message[2] for message in messages]))

    def _columns(self, names: Sequence[str]) -> list[int]:
        """Return the columns of joints; the tables are widened by those that are new."""
        new = [name for name in dict.fromkeys(names) if name not in self._names]
        self._names += new
        for quantity in self._tables.keys() & _OF_JOINTS if new else ():
            known, added = self._tables[quantity][: self._count], np.full((self._count, len(new)), np.nan)
            self._tables[quantity] = self._table(quantity, np.hstack([known, added]))
        return [self._names.index(name) for name in names]

    def _put(self, quantity: str, rows: NDArray[np.intp], columns: Sequence[int], values: NDArray[Any]) -> None:
        of_joints = quantity in _OF_JOINTS
        if quantity not in self._tables:
            shape = (len(self._names),) if of_joints else values.shape[1:]
            self._tables[quantity] = self._table(quantity, np.full((self._count, *shape), _missing(quantity)))
        all_columns = not of_joints or columns == [*range(len(self._names))]
        self._tables[quantity][rows if all_columns else (rows[:, None], columns)] = values

    def _table(self, quantity: str, rows: NDArray[Any]) -> NDArray[Any]:
        """Return a table that begins with some rows; the rest takes no memory until it is written."""
        table = np.empty((self._room, *rows.shape[1:]), np.int64 if quantity in _WHOLE_NUMBERS else float)
        table[: len(rows)] = rows
        return table


def _missing(quantity: str) -> float:
    return 0 if quantity in _WHOLE_NUMBERS else np.nan


def _joint_states(topic: GatheredTopic, of: Messages) -> Named:
    """Return quantities by name; messages may name different joints, or the same in another order."""
    del topic
    names = [text for path, text in of.texts.items() if path.startswith("name.")]
    arrays: Arrays = {"header": _stamps(of, "header.stamp")}
    for quantity, field in zip(_OF_JOINTS, ("position", "velocity", "effort"), strict=True):
        if names and of.numbers[field].shape[1] == len(names):
            arrays[quantity] = of.numbers[field]
    return names, arrays


def _imus(_: GatheredTopic, of: Messages) -> Named:
    turning, force = (of.stacked(f"{name}.{{}}", "xyz") for name in ("angular_velocity", "linear_acceleration"))
    arrays: Arrays = {"header": _stamps(of, "header.stamp"), "gyroscope": turning, "accelerometer": force}
    if not any_numbers(turning):
        arrays["orientation"] = of.stacked("orientation.{}", "wxyz")
        arrays["orientation"][of.numbers["orientation_covariance"][:, 0] == -1] = np.nan  # by the message's definition
    return (), arrays


def _whole_states(topic: GatheredTopic, of: Messages) -> Named:
    motors, torque, imu, foot_force = STATES[topic.type]
    if f"{motors}.0.q" not in of.numbers:
        raise RecordingError(
            f"the {topic.type} messages of {topic.topic} hold no motors: name the topic that has them with --joint-topic"
        )
    arrays: Arrays = {"gyroscope": of.numbers[f"{imu}.gyroscope"], "accelerometer": of.numbers[f"{imu}.accelerometer"]}
    for quantity, field in zip(_OF_JOINTS, ("q", "dq", torque), strict=True):
        arrays[quantity] = _of_motors(of, f"{motors}.{{}}.{field}")
    if "stamp.sec" in of.numbers:  # as some recorders add them
        arrays["header"] = _stamps(of, "stamp")
    if "tick" in of.numbers:
        arrays["ticks"] = of.numbers["tick"]
    if foot_force in of.numbers:
        arrays["foot_force"] = of.numbers[foot_force][:, [MOTOR_LEGS.index(leg) for leg in LEG_NAMES]]
    return MOTOR_NAMES, arrays


def _commands(topic: GatheredTopic, of: Messages) -> Named:
    return MOTOR_NAMES, {"position": _of_motors(of, f"{COMMANDS[topic.type]}.{{}}.q")}


def _of_motors(of: Messages, form: str) -> FloatArray:
    return of.stacked(form, range(len(MOTOR_NAMES)))


def _stamps(of: Messages, path: str) -> NDArray[np.int64]:
    """Return (n,) times of a field [ns]."""
    seconds, rest = (of.numbers[f"{path}.{part}"].astype(np.int64) for part in ("sec", "nanosec"))
    return np.asarray(seconds * 10**9 + rest, dtype=np.int64)


_ARRAYS: Mapping[str, Callable[[GatheredTopic, Messages], Named]] = {
    JOINT_STATE: _joint_states,
    IMU: _imus,
    **dict.fromkeys(STATES, _whole_states),
    **dict.fromkeys(COMMANDS, _commands),
}
