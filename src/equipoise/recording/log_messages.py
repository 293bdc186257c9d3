"""What stands in the log of a run, and how it gets there: samples and entries as messages, and messages into the file.

An MCAP file that Foxglove, PlotJuggler and rosbag2's readers open:

/joint_states    sensor_msgs/JointState
/imu/data        sensor_msgs/Imu
/joint_commands  sensor_msgs/JointState, positions only
/events          std_msgs/String: what the experiment says about moments, as JSON
/run_log         std_msgs/String: the log's own entries, as JSON:
    play    a motion begins: its number, and how many commands it has
    piece   samples of it follow: names of the joints, and which streams there are
    kept    the plays that make up a recording, by number; when it begins and ends, and whether it broke off
    aside   what was played since a recording was kept belongs to none
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from equipoise.recording.clock import nanoseconds
from equipoise.recording.mcap_writer import Batch, McapWriter, Topic
from equipoise.recording.messages import (
    DEFINITIONS,
    IMU,
    JOINT_STATE,
    STRING,
    command_messages,
    imu_messages,
    joint_messages,
    text_message,
)
from equipoise.recording.recording import Recording

FORMAT = "equipoise.log/1"
JOINTS, INERTIAL, COMMANDS, EVENTS, LOG = "/joint_states", "/imu/data", "/joint_commands", "/events", "/run_log"
# In the order of the file: wherever that is cut, a channel in it says whose file it is.
_TYPES = {LOG: STRING, JOINTS: JOINT_STATE, INERTIAL: IMU, COMMANDS: JOINT_STATE, EVENTS: STRING}
TOPICS = tuple(
    Topic(name, kind, DEFINITIONS[kind], {"offered_qos_profiles": "", "format": FORMAT})
    for name, kind in _TYPES.items()
)

Entries = Sequence[Mapping[str, Any]]
"""Entries of a log, as JSON values."""


def write_messages(file: McapWriter, entries: Entries, time: int | None, piece: Recording | None = None) -> None:
    """Write entries, and what was played behind them.

    Args:
        file: file of the log.
        entries: entries of the log.
        time: time of the entries [ns]; None: that of the first sample.
        piece: whole motion, or part of one; None: nothing was played.

    Raises:
        OutputError: the file cannot be written.
    """
    batches = [] if piece is None else _batches(piece)
    if time is None:
        time = min((int(batch.time[0]) for batch in batches if len(batch.time)), default=0)
    messages = [text_message(json.dumps(entry)) for entry in entries]
    file.write([Batch(LOG, np.full(len(entries), time, dtype=np.int64), messages), *batches])


def _batches(piece: Recording) -> list[Batch]:
    """A piece as messages; an event comes before the samples of its moment."""
    names, joints, imu, commands = piece.joint_names, piece.joints, piece.imu, piece.commands
    times = nanoseconds(np.array([event.time for event in piece.events]))
    texts = [{"name": event.name, "data": event.data, "time": event.time} for event in piece.events]
    batches = [
        # In the order that they were noted in, whatever their times: those are in the texts.
        Batch(EVENTS, np.maximum.accumulate(times), [text_message(json.dumps(text)) for text in texts]),
        Batch(JOINTS, nanoseconds(joints.time), joint_messages(names, joints)),
        Batch(INERTIAL, nanoseconds(imu.time), imu_messages(imu)),
    ]
    if commands is not None:
        batches.append(Batch(COMMANDS, nanoseconds(commands.time), command_messages(names, commands)))
    return batches
