"""rosbag2 logs, as sqlite3 or MCAP, with JointState and Imu, or with Unitree's LowState. No ROS needed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Connection, MessageDefinitionFormat
from rosbags.rosbag2 import Reader
from rosbags.typesys import get_types_from_idl, get_types_from_msg

from equipoise.conventions import FloatArray
from equipoise.drivers.unitree.motors import MOTOR_LEGS
from equipoise.errors import EquipoiseError, RecordingError
from equipoise.logs.cdr_arrays import Messages, read_messages
from equipoise.logs.finding import LogFinding
from equipoise.logs.joint_names import map_by_order
from equipoise.logs.log import RawImu, RawJoints, RawLog
from equipoise.logs.message_types import IMU, JOINT_STATE, LOW_CMD, LOW_STATE, MOTOR_NAMES, known_types
from equipoise.logs.stamps import Stamps, common_times
from equipoise.logs.topics import Topics, choose_topics, nothing_to_read
from equipoise.robot.model import RobotModel

SUFFIXES = (".mcap", ".db3")
_METADATA = "metadata.yaml"


@dataclass(eq=False)
class _Gathered:
    """A topic's messages as they are in the bag, in order."""

    type: str
    received: list[int] = field(default_factory=list[int])
    bodies: list[bytes] = field(default_factory=list[bytes])


def is_bag(path: Path) -> bool:
    """Whether a path looks like a bag: a folder of one, or one of its files."""
    if path.is_dir():
        return (path / _METADATA).exists() or any(_files(path))
    return path.suffix.lower() in SUFFIXES


def read_bag(path: Path, robot: RobotModel, topics: Topics) -> RawLog:
    """The streams of a bag.

    Args:
        path: folder of a bag, or an .mcap or .db3 file.
        robot: LowState has no names; its motors are in the order of this robot's legs.

    Raises:
        RecordingError: it cannot be read, or its topics do not say which to take.
    """
    try:
        return _read(path, robot, topics)
    except EquipoiseError:
        raise
    except Exception as error:  # damaged files fail in many ways in several libraries, few of them typed
        hint = ""
        if path.suffix.lower() == ".mcap" or any(file.suffix == ".mcap" for file in _files(path)):
            hint = "; if the recorder was killed, `mcap recover` repairs the file"
        raise RecordingError(f"the bag {str(path)!r} cannot be read: {error or repr(error)}{hint}") from error


def _files(path: Path) -> list[Path]:
    return sorted(file for file in path.glob("*") if file.suffix in SUFFIXES) if path.is_dir() else []


def _read(path: Path, robot: RobotModel, wanted: Topics) -> RawLog:
    # A recorder that was killed leaves files without metadata.
    parts = [path] if not path.is_dir() or (path / _METADATA).exists() else _files(path)
    if not parts:
        raise RecordingError(f"the folder {str(path)!r} is no bag: it has neither {_METADATA} nor .mcap or .db3 files")
    found: dict[str, tuple[str, int]] = {}
    gathered: dict[str, _Gathered] = {}
    findings: list[LogFinding] = []
    chosen: list[str | None] = []
    types = dict(known_types())
    for part in parts:
        with Reader(part) as reader:
            if not chosen:
                found = {name: (info.msgtype or "", info.msgcount) for name, info in reader.topics.items()}
                chosen = list(choose_topics(found, wanted, findings))
                gathered = {topic: _Gathered(found[topic][0]) for topic in chosen if topic is not None}
            types |= _gather(reader, gathered)
    joint_topic, imu_topic, command_topic = chosen
    if joint_topic is None or imu_topic is None:
        raise nothing_to_read(path, found, joint_topic, imu_topic)
    streams = {
        topic: _TAKE[of.type](topic, of, read_messages(types, of.type, of.bodies)) for topic, of in gathered.items()
    }
    return _raw_log(robot, streams, (joint_topic, imu_topic, command_topic), findings)


def _gather(reader: Reader, gathered: Mapping[str, _Gathered]) -> dict[str, Any]:
    """Collects the messages of topics; returns the definitions that the bag itself carries."""
    connections = [connection for connection in reader.connections if connection.topic in gathered]
    if connections:
        for connection, received, body in reader.messages(connections=connections):
            into = gathered[connection.topic]
            if connection.msgtype == into.type:
                into.received.append(received)
                into.bodies.append(body)
    return _own_types(connections)


def _own_types(connections: Iterable[Connection]) -> dict[str, Any]:
    types: dict[str, Any] = {}
    for connection in connections:
        definition = connection.msgdef
        if definition.format == MessageDefinitionFormat.MSG:
            types.update(get_types_from_msg(definition.data, connection.msgtype))
        elif definition.format == MessageDefinitionFormat.IDL and not definition.data.startswith("="):
            types.update(get_types_from_idl(definition.data))
    return types


@dataclass(frozen=True, eq=False)
class _Stream:
    """A topic's messages as arrays; what a type does not have is None."""

    type: str
    clock: Stamps
    joints: RawJoints | None = None
    imu: FloatArray | None = None
    frame: str = ""


def _joint_states(topic: str, gathered: _Gathered, groups: Sequence[Messages]) -> _Stream:
    """Columns by name; messages may name different joints, or the same in another order."""
    named = [
        tuple(of.texts[f"name.{k}"] for k in range(sum(path.startswith("name.") for path in of.texts))) for of in groups
    ]
    columns = {name: index for index, name in enumerate(dict.fromkeys(name for names in named for name in names))}
    tables = {quantity: np.full((len(gathered.bodies), len(columns)), np.nan) for quantity in _JOINT_QUANTITIES}
    for names, of in zip(named, groups, strict=True):
        where = of.rows[:, None], np.array([columns[name] for name in names], dtype=np.intp)
        for quantity, table in tables.items():
            if of.numbers[quantity].shape[1] == len(names):
                table[where] = of.numbers[quantity]
    velocity, torque = (None if np.isnan(tables[name]).all() else tables[name] for name in _JOINT_QUANTITIES[1:])
    clock = _clock(topic, gathered, _headers(groups, len(gathered.bodies)))
    return _Stream(gathered.type, clock, RawJoints(np.empty(0), tuple(columns), tables["position"], velocity, torque))


def _imus(topic: str, gathered: _Gathered, groups: Sequence[Messages]) -> _Stream:
    imu = np.empty((len(gathered.bodies), 6))
    for of in groups:
        for k, vector in enumerate(("angular_velocity", "linear_acceleration")):
            imu[of.rows, 3 * k : 3 * k + 3] = of.stacked(f"{vector}.{{}}", "xyz")
    clock = _clock(topic, gathered, _headers(groups, len(gathered.bodies)))
    return _Stream(gathered.type, clock, None, imu, groups[0].texts["header.frame_id"])


def _low_states(topic: str, gathered: _Gathered, groups: Sequence[Messages]) -> _Stream:
    (of,) = groups  # nothing in it varies in length
    motors = range(len(MOTOR_NAMES))
    position, velocity, torque = (of.stacked(f"motor_state.{{}}.{name}", motors) for name in ("q", "dq", "tau_est"))
    imu = np.hstack([of.numbers["imu_state.gyroscope"], of.numbers["imu_state.accelerometer"]]).astype(float)
    clock = _clock(topic, gathered, ticks=of.numbers["tick"])
    return _Stream(gathered.type, clock, RawJoints(np.empty(0), MOTOR_NAMES, position, velocity, torque), imu)


def _low_commands(topic: str, gathered: _Gathered, groups: Sequence[Messages]) -> _Stream:
    (of,) = groups
    position = of.stacked("motor_cmd.{}.q", range(len(MOTOR_NAMES)))
    return _Stream(gathered.type, _clock(topic, gathered), RawJoints(np.empty(0), MOTOR_NAMES, position))


def _headers(groups: Sequence[Messages], count: int) -> NDArray[np.int64]:
    """(count,) the messages' own stamps [ns]."""
    stamps = np.zeros(count, dtype=np.int64)
    for of in groups:
        seconds, rest = (of.numbers[f"header.stamp.{part}"].astype(np.int64) for part in ("sec", "nanosec"))
        stamps[of.rows] = seconds * 10**9 + rest
    return stamps


def _clock(
    topic: str, gathered: _Gathered, headers: NDArray[Any] | None = None, ticks: NDArray[Any] | None = None
) -> Stamps:
    none = np.empty(0, dtype=np.int64)
    return Stamps(
        topic,
        np.array(gathered.received, dtype=np.int64),
        none if headers is None else headers,
        none if ticks is None else ticks.astype(np.int64),
    )


_JOINT_QUANTITIES = ("position", "velocity", "effort")
_TAKE: dict[str, Callable[[str, _Gathered, Sequence[Messages]], _Stream]] = {
    JOINT_STATE: _joint_states,
    IMU: _imus,
    LOW_STATE: _low_states,
    LOW_CMD: _low_commands,
}


# --- streams


def _raw_log(
    robot: RobotModel, streams: Mapping[str, _Stream], topics: tuple[str, str, str | None], findings: list[LogFinding]
) -> RawLog:
    joint_topic, imu_topic, command_topic = topics
    times, kind = common_times([stream.clock for stream in streams.values()], (joint_topic, imu_topic), findings)
    named = {"joints": joint_topic, "IMU": imu_topic, "commands": command_topic}
    about = {what: f"{topic} ({streams[topic].type})" for what, topic in named.items() if topic is not None}
    about["stamps"] = kind
    if streams[imu_topic].frame:
        about["IMU frame"] = streams[imu_topic].frame
    joints = _timed(streams[joint_topic].joints, times[joint_topic])
    imu = streams[imu_topic].imu
    if joints is None or imu is None:
        raise RecordingError(f"{joint_topic} holds no joints, or {imu_topic} no IMU samples")
    return RawLog(
        joints,
        RawImu(times[imu_topic], imu[:, :3], imu[:, 3:]),
        None if command_topic is None else _timed(streams[command_topic].joints, times[command_topic]),
        about,
        tuple(findings),
        map_by_order(robot, MOTOR_LEGS, MOTOR_NAMES) if streams[joint_topic].type == LOW_STATE else None,
    )


def _timed(joints: RawJoints | None, time: FloatArray) -> RawJoints | None:
    return None if joints is None else replace(joints, time=time)
