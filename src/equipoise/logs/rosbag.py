"""Bags of ROS 2 (sqlite3, MCAP) and of ROS 1, with JointState and Imu or with Unitree's states. No ROS needed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from equipoise.errors import EquipoiseError, MissingDependencyError, RecordingError
from equipoise.user_file import UnreadableError, refuse_unreadable

try:
    from rosbags.interfaces import Connection, MessageDefinitionFormat
    from rosbags.rosbag1 import Reader as Ros1Reader
    from rosbags.rosbag2 import Reader as Ros2Reader
    from rosbags.rosbag2.storage_mcap import McapReader
    from rosbags.typesys import get_types_from_idl, get_types_from_msg
except ModuleNotFoundError as error:
    raise MissingDependencyError("bags need rosbags: pip install 'equipoise[logs]'") from error

from equipoise.drivers.unitree.motors import MOTOR_LEGS
from equipoise.logs.bag_files import METADATA, ROS1, bag_files
from equipoise.logs.bag_streams import GatheredTopic
from equipoise.logs.finding import LogFinding
from equipoise.logs.joint_names import map_by_order
from equipoise.logs.message_types import MOTOR_NAMES, STATES, known_types, store_of
from equipoise.logs.raw_log import RawLog
from equipoise.logs.stamps import common_times
from equipoise.logs.topics import Topics, choose_topics, nothing_to_read
from equipoise.recording.mcap_reader import Message, MessageReader
from equipoise.robot.model import RobotModel

Reader = Ros1Reader | Ros2Reader


def read_bag(path: Path, robot: RobotModel, topics: Topics) -> RawLog:
    """Return the streams of a bag.

    Args:
        path: folder of a bag, or an .mcap, .db3 or .bag file.
        robot: model of the robot; the motors of Unitree's states, which have no names, are mapped to its legs.

    Raises:
        RecordingError: it cannot be read, or its topics are ambiguous.
    """
    try:
        return _read(path, robot, topics)
    except EquipoiseError:
        raise
    except UnreadableError as error:
        raise RecordingError(f"the bag {str(path)!r} cannot be read: {error}") from error
    except Exception as error:  # damaged files fail in many ways in several libraries, few of them typed
        hint = ""
        if path.suffix.lower() == ".mcap" or any(file.suffix == ".mcap" for file in bag_files(path)):
            hint = "; if the recorder was killed, `mcap recover` repairs the file"
        raise RecordingError(f"the bag {str(path)!r} cannot be read: {error or repr(error)}{hint}") from error


def _read(path: Path, robot: RobotModel, wanted: Topics) -> RawLog:
    # A recorder that was killed leaves files without metadata.
    parts = [path] if not path.is_dir() or (path / METADATA).exists() else bag_files(path)
    if not parts:
        raise RecordingError(
            f"the folder {str(path)!r} is not a bag: it has neither {METADATA} nor .mcap or .db3 files"
        )
    found: dict[str, tuple[str, int]] = {}
    findings: list[LogFinding] = []
    types = dict(known_types())
    for part in parts:
        refuse_unreadable(part)
    with ExitStack() as opened:
        readers = [opened.enter_context(_opened(part)) for part in parts]
        for name, info in ((name, info) for reader in readers for name, info in reader.topics.items()):
            kind, count = found.get(name, (info.msgtype or "", 0))
            found[name] = kind, count + info.msgcount
        joint_topic, imu_topic, command_topic = chosen = choose_topics(found, wanted, findings)
        gathered = {topic: GatheredTopic(topic, found[topic][0], types, found[topic][1]) for topic in chosen if topic}
        if command_topic is not None and command_topic != joint_topic:
            gathered[command_topic].thinned = True
        for reader in readers:
            _gather(reader, gathered, types)
    if joint_topic is None or imu_topic is None:
        raise nothing_to_read(path, found, joint_topic, imu_topic)
    return _raw_log(robot, gathered, (joint_topic, imu_topic, command_topic), findings)


def _opened(part: Path) -> Reader:
    return Ros1Reader(part) if part.suffix.lower() == ROS1 else Ros2Reader(part)


def _gather(reader: Reader, gathered: Mapping[str, GatheredTopic], types: dict[str, Any]) -> None:
    """Collect the messages of topics, and the definitions that the bag itself carries."""
    connections = [connection for connection in reader.connections if connection.topic in gathered]
    own = _own_types(connections)
    # A ROS 1 bag also defines ROS's own types, differently from ROS 2; its messages are read as ROS 2 messages.
    types |= own if isinstance(reader, Ros2Reader) else {name: own[name] for name in own.keys() - types.keys()}
    for messages in _chunks(reader, connections, types):
        for topic in gathered.values():
            topic.take(messages)


def _chunks(reader: Reader, connections: Sequence[Connection], types: Mapping[str, Any]) -> Iterator[list[Message]]:
    """Yield the messages of connections, and perhaps others, some at a time, as ROS 2 writes them."""
    files: list[McapReader] = []
    if isinstance(reader, Ros2Reader) and not reader.compression_mode:
        storage: Any = reader.storage
        files = [part for part in getattr(storage, "storages", [storage]) if isinstance(part, McapReader)]
    for file in files:  # in a fraction of the time that the library takes
        yield from MessageReader(Path(str(file.path))).chunks()
    if connections and not files:
        store = store_of(types) if isinstance(reader, Ros1Reader) else None
        for each, received, body in reader.messages(connections=connections):
            kind = each.msgtype or ""
            yield [(each.topic, kind, received, bytes(body if store is None else store.ros1_to_cdr(body, kind)))]


def _own_types(connections: Iterable[Connection]) -> dict[str, Any]:
    types: dict[str, Any] = {}
    for connection in connections:
        definition = connection.msgdef
        if definition.format == MessageDefinitionFormat.MSG:
            types.update(get_types_from_msg(definition.data, connection.msgtype))
        elif definition.format == MessageDefinitionFormat.IDL and not definition.data.startswith("="):
            types.update(get_types_from_idl(definition.data))
    return types


def _raw_log(
    robot: RobotModel,
    gathered: Mapping[str, GatheredTopic],
    topics: tuple[str, str, str | None],
    findings: list[LogFinding],
) -> RawLog:
    joint_topic, imu_topic, command_topic = topics
    for topic in gathered.values():
        topic.finish()
    times, kind = common_times([*gathered.values()], (joint_topic, imu_topic), findings)
    named = {"joints": joint_topic, "IMU": imu_topic, "commands": command_topic}
    about = {stream: f"{topic} ({gathered[topic].type})" for stream, topic in named.items() if topic is not None}
    about["stamps"] = kind
    if gathered[imu_topic].frame:
        about["IMU frame"] = gathered[imu_topic].frame
    joints, imu = gathered[joint_topic].joints(times[joint_topic]), gathered[imu_topic].imu(times[imu_topic])
    commands = None if command_topic is None else gathered[command_topic].joints(times[command_topic])
    if joints is None or imu is None:
        raise RecordingError(f"{joint_topic} holds no joints, or {imu_topic} no IMU samples")
    joint_map = map_by_order(robot, MOTOR_LEGS, MOTOR_NAMES) if gathered[joint_topic].type in STATES else None
    return RawLog(joints, imu, commands, about, tuple(findings), joint_map)
