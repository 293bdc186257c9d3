"""The log of a run: everything that was played, written as it happens, and which parts of it are recordings.

What it holds is said in `log_messages`.
"""

from __future__ import annotations

import secrets
import threading
from pathlib import Path
from typing import Any

import numpy as np

from equipoise.errors import OutputError
from equipoise.recording.clock import nanoseconds
from equipoise.recording.event import TRIAL
from equipoise.recording.log_messages import LOG, TOPICS, Entries, write_messages
from equipoise.recording.mcap_writer import McapWriter
from equipoise.recording.recording import Recording
from equipoise.recording.writer_process import WriterProcess


class RunLog:
    """Writes the log of a run. Use it as a context manager, or close it.

    A motion is announced by `begin` and written by `add`, whole or piece by piece; `keep` says that the motions since the last
    call are a recording. What `add` has returned from outlives the process. It is held in memory too until `keep` or
    `set_aside` says what it is. This process encodes, compresses and writes, or, after `write_beside`, another one.

    Raises:
        OutputError: the file cannot be written; also by every method. What was written before can be read.
    """

    def __init__(self, path: Path) -> None:
        self.file = McapWriter(path, TOPICS)
        self._beside: WriterProcess | None = None
        self._turn = threading.Lock()  # of the file: who closes it waits for a thread that still writes
        self._number = -1  # of the present play
        self._begun: int | None = None  # commands of the present play, while no piece of it is written
        self._open: list[tuple[int, list[Recording]]] = []  # plays since a recording was kept

    @property
    def empty(self) -> bool:
        """Whether no motion was written yet."""
        return self.file.message_counts[LOG] == 0

    def write_beside(self) -> None:
        """From now on a process of its own encodes, compresses and writes: here that would hold up who moves a robot.

        It waits until that is ready, a second; before the robot moves.
        """
        self._beside = self._beside or WriterProcess(self.file)

    def begin(self, commands: int) -> None:
        """A motion of so many commands begins; the pieces that are added until the next one does are its."""
        self._number += 1
        self._begun = commands

    def add(self, piece: Recording) -> None:
        """Write what was just played: a whole motion, or the next piece of it."""
        if not self._open and self._begun is None:
            self.begin(0)
        entries = [_piece_entry(piece)]
        if self._begun is not None:
            entries.insert(0, {"entry": "play", "number": self._number, "commands": self._begun})
        try:
            self._write(entries, None, piece)
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
        self._write([{"entry": "kept", "plays": plays, **about}], int(nanoseconds(time)[1]))
        self._open = []

    def set_aside(self) -> None:
        """Say that what was played since a recording was kept belongs to none."""
        self._write([{"entry": "aside"}], self.file.time_range[1])
        self._open = []

    def close(self) -> None:
        """Write the index at the end. May be called twice."""
        with self._turn:
            if self._beside is not None:
                self._beside.close()
            self.file.close()

    def __enter__(self) -> RunLog:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _write(self, entries: Entries, time: int | None, piece: Recording | None = None) -> None:
        write = write_messages if self._beside is None else self._beside.write
        with self._turn:
            write(self.file, entries, time, piece)

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
