"""rosbag2 logs, as sqlite3 or MCAP, with JointState and Imu, or with Unitree's LowState. No ROS needed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Connection, MessageDefinitionFormat
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from equipoise.errors import EquipoiseError, RecordingError
from equipoise.recordings.logs.joint_names import map_by_order
from equipoise.recordings.logs.log import Finding, RawImu, RawJoints, RawLog
from equipoise.recordings.logs.message_types import IMU, JOINT_STATE, LOW_CMD, LOW_STATE, MOTOR_LEGS, MOTOR_NAMES, known_types
from equipoise.recordings.logs.stamps import Stamps, common_times
from equipoise.robot.model import RobotModel

FloatArray = NDArray[np.float64]

SUFFIXES = (".mcap", ".db3")
_METADATA = "metadata.yaml"
_COMMAND_WORDS = ("command", "cmd", "target", "desired", "reference")
_OFTEN = 5  # times as many messages: the same data at a lower rate, as Unitree's lf/ topics


@dataclass(frozen=True)
class Topics:
    """Topics to read; None: found by their types."""

    joints: str | None = None
    imu: str | None = None
    commands: str | None = None


@dataclass(eq=False)
class _Gathered:
    """What a topic's messages held, in order."""

    type: str
    received: list[int] = field(default_factory=list[int])
    stamps: list[int] = field(default_factory=list[int])
    ticks: list[int] = field(default_factory=list[int])
    names: list[tuple[str, ...]] = field(default_factory=list[tuple[str, ...]])
    joints: list[tuple[Any, Any, Any]] = field(default_factory=list[tuple[Any, Any, Any]])
    imu: list[tuple[float, ...]] = field(default_factory=list[tuple[float, ...]])
    frame: str = ""

    def clock(self, topic: str) -> Stamps:
        return Stamps(topic, np.array(self.received, dtype=np.int64), np.array(self.stamps, dtype=np.int64),
                      np.array(self.ticks, dtype=np.int64))  # fmt: skip


def is_bag(path: Path) -> bool:
    """Whether a path looks like a bag: a folder of one, or one of its files."""
    if path.is_dir():
        return (path / _METADATA).exists() or any(_files(path))
    return path.suffix.lower() in SUFFIXES


def read_bag(path: Path, robot: RobotModel, topics: Topics | None = None) -> RawLog:
    """The streams of a bag.

    Args:
        path: folder of a bag, or an .mcap or .db3 file.
        robot: LowState has no names; its motors are in the order of this robot's legs.

    Raises:
        RecordingError: it cannot be read, or its topics do not say which to take.
    """
    try:
        return _read(path, robot, topics or Topics())
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
    findings: list[Finding] = []
    chosen: list[str | None] = []
    for part in parts:
        with Reader(part) as reader:
            if not chosen:
                found = {name: (info.msgtype or "", info.msgcount) for name, info in reader.topics.items()}
                chosen = list(_choose(found, wanted, findings))
                gathered = {topic: _Gathered(found[topic][0]) for topic in chosen if topic is not None}
            _gather(reader, gathered)
    joint_topic, imu_topic, command_topic = chosen
    if joint_topic is None or imu_topic is None:
        raise _nothing_to_read(path, found, joint_topic, imu_topic)
    return _raw_log(robot, gathered, (joint_topic, imu_topic, command_topic), findings)


def _gather(reader: Reader, gathered: Mapping[str, _Gathered]) -> None:
    connections = [connection for connection in reader.connections if connection.topic in gathered]
    if not connections:
        return
    store = get_typestore(Stores.EMPTY)
    store.register(known_types() | _own_types(connections))
    for connection, received, data in reader.messages(connections=connections):
        into = gathered[connection.topic]
        if connection.msgtype == into.type:
            into.received.append(received)
            _TAKE[into.type](into, store.deserialize_cdr(data, connection.msgtype))


def _own_types(connections: Iterable[Connection]) -> dict[str, Any]:
    """Definitions that the bag itself carries."""
    types: dict[str, Any] = {}
    for connection in connections:
        definition = connection.msgdef
        if definition.format == MessageDefinitionFormat.MSG:
            types.update(get_types_from_msg(definition.data, connection.msgtype))
        elif definition.format == MessageDefinitionFormat.IDL and not definition.data.startswith("="):
            types.update(get_types_from_idl(definition.data))
    return types


def _take_joint_state(into: _Gathered, message: Any) -> None:
    into.stamps.append(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)
    into.names.append(tuple(message.name))
    into.joints.append((message.position, message.velocity, message.effort))


def _take_imu(into: _Gathered, message: Any) -> None:
    into.stamps.append(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)
    into.frame = message.header.frame_id
    turning, force = message.angular_velocity, message.linear_acceleration
    into.imu.append((turning.x, turning.y, turning.z, force.x, force.y, force.z))


def _take_low_state(into: _Gathered, message: Any) -> None:
    into.ticks.append(message.tick)
    motors = message.motor_state[: len(MOTOR_NAMES)]
    into.joints.append(([m.q for m in motors], [m.dq for m in motors], [m.tau_est for m in motors]))
    into.imu.append((*message.imu_state.gyroscope, *message.imu_state.accelerometer))


def _take_low_command(into: _Gathered, message: Any) -> None:
    into.joints.append(([motor.q for motor in message.motor_cmd[: len(MOTOR_NAMES)]], None, None))


_TAKE: dict[str, Callable[[_Gathered, Any], None]] = {
    JOINT_STATE: _take_joint_state,
    IMU: _take_imu,
    LOW_STATE: _take_low_state,
    LOW_CMD: _take_low_command,
}


# --- which topics


def _choose(
    found: Mapping[str, tuple[str, int]], wanted: Topics, findings: list[Finding]
) -> tuple[str | None, str | None, str | None]:
    """Topics of joints, IMU and commands; None where there is none."""
    low_state = _of_types(found, LOW_STATE)
    joints = _given(found, wanted.joints, "--joint-topic", (JOINT_STATE, LOW_STATE))
    if joints is None:
        states = _of_types(found, JOINT_STATE)
        not_commands = [topic for topic in states if not _names_commands(topic)]
        joints = _one(found, low_state or not_commands or states, "joint states", "--joint-topic", findings)
    imu = _given(found, wanted.imu, "--imu-topic", (IMU, LOW_STATE))
    if imu is None and joints is not None and found[joints][0] == LOW_STATE:
        imu = joints  # one message, one clock
    if imu is None:
        imu = _one(found, _of_types(found, IMU) or low_state, "IMU samples", "--imu-topic", findings)
    commands = _given(found, wanted.commands, "--command-topic", (JOINT_STATE, LOW_CMD))
    if commands is None:
        type_of_commands = LOW_CMD if joints is not None and found[joints][0] == LOW_STATE else JOINT_STATE
        likely = [t for t in _of_types(found, type_of_commands) if _names_commands(t) and t != joints]
        commands = likely[0] if len(likely) == 1 else None
    return joints, imu, commands


def _of_types(found: Mapping[str, tuple[str, int]], message_type: str) -> list[str]:
    return [topic for topic, (kind, count) in found.items() if kind == message_type and count > 0]


def _names_commands(topic: str) -> bool:
    return any(word in topic.lower() for word in _COMMAND_WORDS)


def _given(found: Mapping[str, tuple[str, int]], topic: str | None, flag: str, types: Sequence[str]) -> str | None:
    if topic is None:
        return None
    topic = topic if topic in found or topic.startswith("/") else f"/{topic}"
    if topic not in found or found[topic][0] not in types:
        what = f"is a {found[topic][0]}" if topic in found else "is not in the bag"
        raise RecordingError(f"{flag} {topic} {what}; it must be a {' or '.join(types)}. The bag has {_listed(found)}")
    return topic


def _one(
    found: Mapping[str, tuple[str, int]], candidates: Sequence[str], what: str, flag: str, findings: list[Finding]
) -> str | None:
    """The only candidate, the one of the usual name, or the one with by far the most messages."""
    if len(candidates) <= 1:
        return candidates[0] if candidates else None
    usual = [topic for topic in candidates if topic.lower() in ("/joint_states", "/imu/data", "/imu")]
    by_count = sorted(candidates, key=lambda topic: -found[topic][1])
    if len(usual) == 1:
        choice, why = usual[0], "it has the usual name"
    elif found[by_count[0]][1] >= _OFTEN * found[by_count[1]][1]:
        choice, why = by_count[0], "it has by far the most messages"
    else:
        raise RecordingError(
            f"several topics hold {what}: {', '.join(candidates)}. Say which with {flag}; the bag has {_listed(found)}"
        )
    others = ", ".join(topic for topic in candidates if topic != choice)
    findings.append(Finding("topics", f"{choice} is taken for {what}, not {others}: {why}"))
    return choice


def _listed(found: Mapping[str, tuple[str, int]]) -> str:
    return ", ".join(f"{topic} ({kind}, {count})" for topic, (kind, count) in found.items()) or "no topics"


def _nothing_to_read(
    path: Path, found: Mapping[str, tuple[str, int]], joints: str | None, imu: str | None
) -> RecordingError:
    missing = [what for what, topic in (("joint states", joints), ("IMU samples", imu)) if topic is None]
    return RecordingError(
        f"the bag {str(path)!r} holds no {' and no '.join(missing)}: it needs {JOINT_STATE} and {IMU}, or {LOW_STATE}. It has "
        f"{_listed(found)}"
    )


# --- streams


def _raw_log(
    robot: RobotModel,
    gathered: Mapping[str, _Gathered],
    topics: tuple[str, str, str | None],
    findings: list[Finding],
) -> RawLog:
    times, kind = common_times([gathered[topic].clock(topic) for topic in gathered], topics[:2], findings)
    joint_topic, imu_topic, command_topic = topics
    imu, frame = gathered[imu_topic].imu, gathered[imu_topic].frame
    values = np.array(imu, dtype=float).reshape(-1, 6)
    about = {"joints": f"{joint_topic} ({gathered[joint_topic].type})", "IMU": f"{imu_topic} ({gathered[imu_topic].type})"}
    if command_topic is not None:
        about["commands"] = f"{command_topic} ({gathered[command_topic].type})"
    about["stamps"] = kind
    if frame:
        about["IMU frame"] = frame
    return RawLog(
        _joints(gathered[joint_topic], times[joint_topic]),
        RawImu(times[imu_topic], values[:, :3], values[:, 3:]),
        None if command_topic is None else _joints(gathered[command_topic], times[command_topic]),
        about,
        tuple(findings),
        map_by_order(robot, MOTOR_LEGS, MOTOR_NAMES) if gathered[joint_topic].type == LOW_STATE else None,
    )


def _joints(gathered: _Gathered, time: FloatArray) -> RawJoints:
    """Columns by name; messages may name different joints, or the same in another order."""
    names = gathered.names or [MOTOR_NAMES] * len(gathered.joints)
    columns = {name: index for index, name in enumerate(dict.fromkeys(name for each in set(names) for name in each))}
    tables = [np.full((len(time), len(columns)), np.nan) for _ in range(3)]
    for each in set(names):
        rows = [row for row, named in enumerate(names) if named == each]
        where = [columns[name] for name in each]
        for quantity, table in enumerate(tables):
            of_rows = [gathered.joints[row][quantity] for row in rows]
            whole = [k for k, values in enumerate(of_rows) if values is not None and len(values) == len(each)]
            if whole:
                table[np.ix_([rows[k] for k in whole], where)] = np.array([of_rows[k] for k in whole])
    velocity, torque = (None if np.isnan(table).all() else table for table in tables[1:])
    return RawJoints(time, tuple(columns), tables[0], velocity, torque)
