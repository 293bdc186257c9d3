"""Content of a run's log: samples and entries as ROS 2 messages.

Foxglove, PlotJuggler and rosbag2's readers open its MCAP files:

/joint_states    sensor_msgs/JointState
/imu/data        sensor_msgs/Imu
/joint_commands  sensor_msgs/JointState, positions only
/events          std_msgs/String: events of the experiment as JSON
/run_log         std_msgs/String: entries of the log itself, as JSON:
    resumed the file continues a run: the number of plays in the files before it that still count
    play    a motion begins: the number of its commands, and the id of the trial that it is a part of, or null
    piece   samples of the motion follow: names of the joints, and which streams there are
    kept    a recording is complete: the id of its trial, whose plays it consists of, or null for the last play alone;
            whether its motion broke off
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from equipoise.recording import messages
from equipoise.recording.clock import nanoseconds
from equipoise.recording.recording import Recording

FORMAT = "equipoise.log/1"
JOINTS, INERTIAL, COMMANDS, EVENTS, LOG = "/joint_states", "/imu/data", "/joint_commands", "/events", "/run_log"
TYPES = {
    LOG: messages.STRING, JOINTS: messages.JOINT_STATE, INERTIAL: messages.IMU, COMMANDS: messages.JOINT_STATE,
    EVENTS: messages.STRING,
}  # fmt: skip
"""Types of the messages, by topic."""


def messages_of(piece: Recording) -> Iterator[tuple[int, str, bytes]]:
    """Yield times [ns], topics and bodies of a piece's messages; an event comes before the samples of its time."""
    names, joints, imu, commands = piece.joint_names, piece.joints, piece.imu, piece.commands
    # Events stay in the order in which they were recorded; their own times are in the texts.
    times = np.maximum.accumulate(nanoseconds(np.array([event.time for event in piece.events])))
    yield from _stamped(EVENTS, times, (messages.text_message(json.dumps(vars(event))) for event in piece.events))
    yield from _stamped(JOINTS, nanoseconds(joints.time), messages.joint_messages(names, joints))
    yield from _stamped(INERTIAL, nanoseconds(imu.time), messages.imu_messages(imu))
    if commands is not None:
        yield from _stamped(COMMANDS, nanoseconds(commands.time), messages.joint_messages(names, commands))


def piece_entry(piece: Recording) -> dict[str, Any]:
    """Return the entry that precedes a piece's samples."""
    return {
        "entry": "piece",
        "joint_names": list(piece.joint_names),
        "velocity": piece.joints.velocity is not None,
        "torque": piece.joints.torque is not None,
        "commands": piece.commands is not None,
    }


def _stamped(topic: str, times: Any, bodies: Iterable[bytes]) -> Iterator[tuple[int, str, bytes]]:
    # The format has no times before zero.
    return ((max(time, 0), topic, body) for time, body in zip(times.tolist(), bodies, strict=True))
