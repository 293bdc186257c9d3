"""The log of a run: everything that was played, written as it happens, and which parts of it are recordings.

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
import secrets
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from equipoise.errors import OutputError
from equipoise.recording.clock import nanoseconds
from equipoise.recording.event import TRIAL
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


class RunLog:
    """Writes the log of a run. Use it as a context manager, or close it.

    A motion is announced by `begin` and written by `add`, whole or piece by piece; `keep` says that the motions since the last
    call are a recording. What `add` has returned from outlives the process. It is held in memory too until `keep` or
    `set_aside` says what it is.

    Raises:
        OutputError: the file cannot be written; also by every method. What was written before can be read.
    """

    def __init__(self, path: Path) -> None:
        topics = [
            Topic(name, kind, DEFINITIONS[kind], {"offered_qos_profiles": "", "format": FORMAT})
            for name, kind in _TYPES.items()
        ]
        self.file = McapWriter(path, topics)
        self._number = -1  # of the present play
        self._begun: int | None = None  # commands of the present play, while no piece of it is written
        self._open: list[tuple[int, list[Recording]]] = []  # plays since a recording was kept

    @property
    def empty(self) -> bool:
        """Whether no motion was written yet."""
        return self.file.message_counts[LOG] == 0

    def begin(self, commands: int) -> None:
        """A motion of so many commands begins; the pieces that are added until the next one does are its."""
        self._number += 1
        self._begun = commands

    def add(self, piece: Recording) -> None:
        """Write what was just played: a whole motion, or the next piece of it."""
        if not self._open and self._begun is None:
            self.begin(0)
        batches = _batches(piece)
        entries = [_piece_entry(piece)]
        if self._begun is not None:
            entries.insert(0, {"entry": "play", "number": self._number, "commands": self._begun})
        start = min((int(batch.time[0]) for batch in batches if len(batch.time)), default=0)
        try:
            self.file.write([_entries(start, entries), *batches])
            if self._begun is not None:
                self._open.append((self._number, []))
                self._begun = None
            self._open[-1][1].append(piece)
        except BaseException:  # Ctrl-C: nobody knows how much of it is written, so `keep` is to write all of it
            self._open = []
            self.begin(0)
            raise

    def keep(self, recording: Recording) -> None:
        """Say that the last plays make up a recording. What was not added is added, as one play."""
        plays = self._plays_of(recording)
        if not plays:
            self.begin(0 if recording.commands is None else len(recording.commands.time))
            self.add(recording)
            plays = [self._number]
        time = recording.joints.time[[0, -1]] if recording.joints.time.size else np.zeros(2)
        about = {"start": time[0], "end": time[1], "broken": recording.broken, "about": _told(recording)}
        end = int(nanoseconds(time)[1])
        self.file.write([_entries(end, [{"entry": "kept", "plays": plays, **about}])])
        self._open = []

    def set_aside(self) -> None:
        """Say that what was played since a recording was kept belongs to none."""
        self.file.write([_entries(self.file.time_range[1], [{"entry": "aside"}])])
        self._open = []

    def close(self) -> None:
        """Write the index at the end. May be called twice."""
        self.file.close()

    def __enter__(self) -> RunLog:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _plays_of(self, recording: Recording) -> list[int]:
        """Numbers of the last plays, if they are the recording."""
        for first in range(len(self._open)):
            pieces = [piece for _, play in self._open[first:] for piece in play]
            if np.array_equal(pieces[0].joints.time[:1], recording.joints.time[:1]):
                whole = Recording.concatenate(pieces)
                whole = whole.broken_off() if recording.broken else whole
                return [number for number, _ in self._open[first:]] if whole.equals(recording) else []
        return []


def save_recording(recording: Recording, path: Path) -> None:
    """Write one recording by itself; the file appears under its name only when it is complete.

    Raises:
        OutputError: it cannot be written (no permission, disk full).
    """
    partial = path.with_name(f".{path.name}.{secrets.token_hex(4)}.partial")
    try:
        with RunLog(partial) as log:
            log.keep(recording)
            log.file.move_to(path)
    except OutputError:
        partial.unlink(missing_ok=True)
        raise


def _told(recording: Recording) -> dict[str, Any]:
    """The data of a recording's trial event, as they are; empty if it has none."""
    for event in recording.events:
        if event.name == TRIAL:
            return dict(event.data)
    return {}


def _piece_entry(piece: Recording) -> dict[str, Any]:
    return {
        "entry": "piece",
        "joint_names": list(piece.joint_names),
        "velocity": piece.joints.velocity is not None,
        "torque": piece.joints.torque is not None,
        "commands": piece.commands is not None,
    }


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


def _entries(time: int, entries: Sequence[Mapping[str, Any]]) -> Batch:
    messages = [text_message(json.dumps(entry)) for entry in entries]
    return Batch(LOG, np.full(len(entries), time, dtype=np.int64), messages)
