"""The messages of a bag's topics as arrays: JointState, Imu, and Unitree's states and commands.

Messages become numbers some thousand at a time, while the bag is read: a message's bytes take four times the memory of its
numbers, and the bytes of a long log more than there is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from equipoise.conventions import FloatArray
from equipoise.drivers.unitree.motors import MOTOR_LEGS
from equipoise.errors import RecordingError
from equipoise.logs.cdr_arrays import Messages, read_messages
from equipoise.logs.log import RawJoints
from equipoise.logs.message_types import COMMANDS, IMU, JOINT_STATE, MOTOR_NAMES, STATES
from equipoise.logs.stamps import IntArray, Stamps
from equipoise.robot.model import LEG_NAMES

_BATCH, _ROOM = 4096, 1 << 20  # messages
_NONE = np.empty(0, dtype=np.int64)


@dataclass(frozen=True, eq=False)
class BagStream:
    """A topic's messages as arrays; what a type does not have is None.

    Attributes:
        type: type of the messages.
        clock: when they were made.
        joints: joint columns; their times are not known before the clocks of all topics are.
        imu: (n, 6) angular velocity and specific force [rad/s], [m/s2].
        quat_wxyz: (n, 4) orientation of the IMU in the room; not a number where a message says that it has none.
        foot_force: (n, 4) what the sensors of the feet FL FR RL RR say, in counts.
        frame: frame that an IMU names.
    """

    type: str
    clock: Stamps
    joints: RawJoints | None = None
    imu: FloatArray | None = None
    quat_wxyz: FloatArray | None = None
    frame: str = ""
    foot_force: FloatArray | None = None


class GatheredTopic:
    """A topic's messages while a bag is read."""

    def __init__(self, topic: str, message_type: str, types: Mapping[str, Any]) -> None:
        self.topic, self.type, self._types = topic, message_type, types
        self._received: list[IntArray] = []
        self._bodies: list[NDArray[np.uint8]] = []
        self._waiting = 0  # messages that are not in the tables yet
        self._names: tuple[str, ...] = ()
        self._frame: str | None = None
        self._tables: dict[str, _Table] = {}
        self._count = 0  # of messages in the tables

    def take(self, received: IntArray, bodies: NDArray[np.uint8]) -> None:
        """More messages: (n,) times of receipt [ns], and (n, length) bytes."""
        self._received.append(received)
        self._bodies.append(bodies)
        self._waiting += len(bodies)
        if self._waiting >= _BATCH:
            self._read()

    def stream(self) -> BagStream:
        """All of them in the order in which they were received, once there are no more."""
        if self._bodies or not self._tables:
            self._read()
        whole = {name: self._tables.pop(name).whole() for name in list(self._tables)}
        received = whole["received"]
        if (np.diff(received) < 0).any():
            order = np.argsort(received, kind="stable")
            whole = {name: table[order] if len(table) else table for name, table in whole.items()}
        clock = Stamps(self.topic, whole["received"], whole["header"], whole["ticks"])
        joints = None
        if "position" in whole:
            joints = RawJoints(np.empty(0), self._names, whole["position"], whole.get("velocity"), whole.get("torque"))
        imu, orientation, force = (whole.get(name) for name in ("imu", "quat_wxyz", "foot_force"))
        return BagStream(self.type, clock, joints, imu, orientation, self._frame or "", force)

    def _read(self) -> None:
        """Numbers of the messages that were taken last."""
        groups = read_messages(self._types, self.type, self._bodies)
        received = np.concatenate(self._received) if self._received else _NONE
        part = _TAKE[self.type](self.topic, self.type, received, groups)
        self._received, self._bodies, self._waiting = [], [], 0
        self._frame = part.frame if self._frame is None else self._frame
        new: dict[str, NDArray[Any]] = {name: getattr(part.clock, name) for name in ("received", "header", "ticks")}
        new |= {name: rows for name in ("imu", "quat_wxyz", "foot_force") if (rows := getattr(part, name)) is not None}
        if part.joints is not None:
            new |= self._by_name(part.joints)
        for name, rows in new.items():
            if name not in self._tables:
                self._tables[name] = _Table(rows, self._count)
            self._tables[name].add(rows)
        self._count += len(new["received"])

    def _by_name(self, joints: RawJoints) -> dict[str, FloatArray]:
        """Tables of joints whose columns are those of all messages so far; what a message lacks is not a number."""
        quantities = {"position": joints.position, "velocity": joints.velocity, "torque": joints.torque}
        before, self._names = self._names, tuple(dict.fromkeys((*self._names, *joints.names)))
        if before != self._names:
            for name in self._tables.keys() & quantities.keys():
                self._tables[name].widen(len(self._names))
        wide: dict[str, FloatArray] = {}
        for name, table in quantities.items():
            if table is None and name not in self._tables:
                continue
            if table is None or joints.names != self._names:
                wide[name] = np.full((len(joints.position), len(self._names)), np.nan)
                if table is not None:
                    wide[name][:, [self._names.index(joint) for joint in joints.names]] = table
            else:
                wide[name] = table
        return wide


class _Table:
    """Rows that become more. It doubles when it is full; room that is not used takes no memory."""

    def __init__(self, like: NDArray[Any], missing: int) -> None:
        """Of rows like these, behind some that are missing: not numbers."""
        self._rows, self._count = np.empty((_ROOM, *like.shape[1:]), like.dtype), 0
        if missing:
            self.add(np.full((missing, *like.shape[1:]), np.nan))

    def add(self, rows: NDArray[Any]) -> None:
        count = self._count + len(rows)
        if count > len(self._rows):
            self._move(np.empty((2 * count, *self._rows.shape[1:]), self._rows.dtype))
        self._rows[self._count : count] = rows
        self._count = count

    def widen(self, columns: int) -> None:
        """More columns, on the right, of what is not a number."""
        wider = np.empty((len(self._rows), columns))
        wider[: self._count] = np.nan
        self._move(wider)

    def whole(self) -> NDArray[Any]:
        """The rows, read-only."""
        self._rows.setflags(write=False)
        return self._rows[: self._count]

    def _move(self, into: NDArray[Any]) -> None:
        into[(slice(self._count), *(slice(size) for size in self._rows.shape[1:]))] = self._rows[: self._count]
        self._rows = into


def _joint_states(topic: str, message_type: str, received: IntArray, groups: Sequence[Messages]) -> BagStream:
    """Columns by name; messages may name different joints, or the same in another order."""
    named = [
        tuple(of.texts[f"name.{k}"] for k in range(sum(path.startswith("name.") for path in of.texts))) for of in groups
    ]
    columns = {name: index for index, name in enumerate(dict.fromkeys(name for names in named for name in names))}
    tables = {quantity: np.full((len(received), len(columns)), np.nan) for quantity in _JOINT_QUANTITIES}
    for names, of in zip(named, groups, strict=True):
        where = of.rows[:, None], np.array([columns[name] for name in names], dtype=np.intp)
        for quantity, table in tables.items():
            if of.numbers[quantity].shape[1] == len(names):
                table[where if len(groups) > 1 else (slice(None), where[1])] = of.numbers[quantity]
    velocity, torque = (None if np.isnan(tables[name]).all() else tables[name] for name in _JOINT_QUANTITIES[1:])
    clock = Stamps(topic, received, _headers(groups, len(received)), _NONE)
    return BagStream(message_type, clock, RawJoints(np.empty(0), tuple(columns), tables["position"], velocity, torque))


def _imus(topic: str, message_type: str, received: IntArray, groups: Sequence[Messages]) -> BagStream:
    quantities = {"angular_velocity": "xyz", "linear_acceleration": "xyz", "orientation": "wxyz"}
    tables = {name: np.empty((len(received), len(parts))) for name, parts in quantities.items()}
    for of in groups:
        for name, parts in quantities.items():
            tables[name][of.rows] = of.stacked(f"{name}.{{}}", parts)
        unknown = of.numbers["orientation_covariance"][:, 0] == -1  # as the message's definition has it
        tables["orientation"][of.rows[unknown]] = np.nan
    clock = Stamps(topic, received, _headers(groups, len(received)), _NONE)
    turning, acceleration, orientation = tables.values()
    imu, frame = np.hstack([turning, acceleration]), groups[0].texts["header.frame_id"]
    return BagStream(message_type, clock, None, imu, orientation, frame)


def _whole_states(topic: str, message_type: str, received: IntArray, groups: Sequence[Messages]) -> BagStream:
    (of,) = groups  # nothing in it varies in length
    motors, called = range(len(MOTOR_NAMES)), STATES[message_type]
    if f"{called.motors}.0.q" not in of.numbers:
        raise RecordingError(
            f"the {message_type} of {topic} hold no motors: its robot publishes them elsewhere, if at all"
        )
    position, velocity, torque = (
        of.stacked(f"{called.motors}.{{}}.{name}", motors) for name in ("q", "dq", called.torque)
    )
    imu = np.hstack([of.numbers[f"{called.imu}.{sensor}"] for sensor in ("gyroscope", "accelerometer")]).astype(float)
    stamps = _stamps(of, "stamp") if "stamp.sec" in of.numbers else _NONE  # as some recorders add them
    ticks = of.numbers["tick"].astype(np.int64) if "tick" in of.numbers else _NONE
    joints = RawJoints(np.empty(0), MOTOR_NAMES, position, velocity, torque)
    force = of.numbers.get(called.foot_force)
    if force is not None:
        force = force[:, [MOTOR_LEGS.index(leg) for leg in LEG_NAMES]].astype(float)
    return BagStream(message_type, Stamps(topic, received, stamps, ticks), joints, imu, foot_force=force)


def _commands(topic: str, message_type: str, received: IntArray, groups: Sequence[Messages]) -> BagStream:
    (of,) = groups
    position = of.stacked(f"{COMMANDS[message_type]}.{{}}.q", range(len(MOTOR_NAMES)))
    return BagStream(message_type, Stamps(topic, received, _NONE, _NONE), RawJoints(np.empty(0), MOTOR_NAMES, position))


def _headers(groups: Sequence[Messages], count: int) -> NDArray[np.int64]:
    """(count,) the messages' own stamps [ns]."""
    stamps = np.zeros(count, dtype=np.int64)
    for of in groups:
        stamps[of.rows] = _stamps(of, "header.stamp")
    return stamps


def _stamps(of: Messages, path: str) -> NDArray[np.int64]:
    """(n,) times of a field [ns]."""
    seconds, rest = (of.numbers[f"{path}.{part}"].astype(np.int64) for part in ("sec", "nanosec"))
    return np.asarray(seconds * 10**9 + rest, dtype=np.int64)


_JOINT_QUANTITIES = ("position", "velocity", "effort")
_TAKE: dict[str, Callable[[str, str, IntArray, Sequence[Messages]], BagStream]] = {
    JOINT_STATE: _joint_states,
    IMU: _imus,
    **dict.fromkeys(STATES, _whole_states),
    **dict.fromkeys(COMMANDS, _commands),
}
