"""Reader of a run's log: its recordings, exactly as they were kept, and the plays that they were made of."""

from __future__ import annotations

import json
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from equipoise.errors import RecordingError
from equipoise.recording.event import Event
from equipoise.recording.log_messages import COMMANDS, EVENTS, FORMAT, INERTIAL, JOINTS, LOG, TYPES
from equipoise.recording.mcap_reader import MessageReader
from equipoise.recording.messages import read_imu, read_joints, read_text
from equipoise.recording.recording import CommandStream, Recording
from equipoise.user_file import check_schema

LoggedPiece = tuple[Mapping[str, Any], dict[str, list[bytes]]]
"""Entry of a piece, and its messages by topic."""


@dataclass(eq=False)
class Play:
    """Motion that was played.

    Attributes:
        commands: number of commands that were planned; a motion that was stopped early has fewer samples.
        trial: id of the trial that it is a part of; None if it is a part of none, as standing up is, or of one that a
            resumed run began again.
        pieces: what its recording is made of, in order.
    """

    commands: int
    trial: int | None = None
    pieces: list[LoggedPiece] = field(default_factory=list["LoggedPiece"])

    @cached_property
    def recording(self) -> Recording:
        """Return the recording of the motion; raise the error of a damaged message."""
        return Recording.concatenate([read_piece(entry, messages) for entry, messages in self.pieces])


def log_file(folder: Path, number: int) -> Path:
    """Return the path of one file of a run's log: the first is written when the run begins, each other by a resume."""
    return folder / f"recording_{number}.mcap"


def log_files(folder: Path) -> list[Path]:
    """Return the paths of all files of a run's log, in order; the first and those between two others may be missing."""
    numbers = [int(path.stem.removeprefix("recording_")) for path in folder.glob("recording_[0-9]*.mcap")]
    return [log_file(folder, number) for number in range(max(numbers, default=0) + 1)]


def read_log(path: Path) -> LogContent:
    """Read a log as far as it was written, even if its process was killed.

    Args:
        path: a file, or the folder of a run, whose files are joined.

    Raises:
        RecordingError: a file is missing, damaged or of another format.
    """
    content = LogContent()
    for file in log_files(path) if path.is_dir() else [path]:
        reader = MessageReader(file)
        messages = reader.messages()
        content.closed = reader.closed
        if reader.channels or reader.closed:
            check_format(reader)
        with damage_reported(file):
            for topic, _, _, message in messages:
                content.take(topic, message)
    with damage_reported(path):
        content.finish()
    return content


def check_format(reader: MessageReader) -> None:
    """Raise RecordingError for the file of another program or version."""
    found = reader.channels.get(LOG, {}).get("format")
    if found is None:
        raise RecordingError(f"{str(reader.path)!r} is not an equipoise log: it has no topic {LOG}")
    check_schema(found, FORMAT, f"the log {str(reader.path)!r}")


@contextmanager
def damage_reported(path: Path) -> Generator[None]:
    """Raise RecordingError for invalid entries and messages of a log."""
    try:
        yield
    except RecordingError as error:
        raise RecordingError(f"the recording {str(path)!r} is damaged: {error}") from error
    except (KeyError, TypeError, ValueError, IndexError, OverflowError, RecursionError) as error:
        raise RecordingError(f"the recording {str(path)!r} is damaged: {error!r}") from error


def read_piece(entry: Mapping[str, Any], messages: Mapping[str, list[bytes]]) -> Recording:
    """Return the recording of one piece from its entry and its messages by topic."""
    names = tuple(str(name) for name in entry["joint_names"])
    commands = None
    if entry["commands"]:
        stream = read_joints(messages[COMMANDS], names, velocity=False, torque=False)
        commands = CommandStream(stream.time, stream.position)
    return Recording(
        names,
        read_joints(messages[JOINTS], names, bool(entry["velocity"]), bool(entry["torque"])),
        read_imu(messages[INERTIAL]),
        commands,
        tuple(_event(message) for message in messages[EVENTS]),
    )


class LogContent:
    """Content of a log, assembled from its messages in the order in which they were written.

    Attributes:
        plays: motions so far.
        kept: indices of the motions of each complete recording.
        closed: whether the log was closed; else the process was killed.
        recordings: complete recordings, in order, once `finish` was called.
        unfinished: recording of what was played after them towards one that is not complete, or None; likewise.
    """

    def __init__(self) -> None:
        self.plays: list[Play] = []
        self.kept: list[list[int]] = []
        self.closed = False
        self.recordings: tuple[Recording, ...] = ()
        self.unfinished: Recording | None = None
        self._broken: list[int] = []  # those of the last one, if its motion broke off
        self._complete = 0  # plays up to the end of the last complete recording
        self._since = 0  # plays before the present trial

    def take(self, topic: str, message: bytes) -> None:
        if topic != LOG:
            self.plays[-1].pieces[-1][1][topic].append(message)
            return
        entry = json.loads(read_text(message))
        if entry["entry"] == "play":
            trial = None if entry["trial"] is None else int(entry["trial"])
            self.plays.append(Play(int(entry["commands"]), trial))
        elif entry["entry"] == "piece":
            self.plays[-1].pieces.append((entry, {name: [] for name in TYPES}))
        elif entry["entry"] == "kept":
            self._keep(entry)
        elif entry["entry"] == "resumed":
            self._resume(int(entry["plays"]))

    def finish(self) -> None:
        """Make the recordings of all messages."""
        for play in self.plays:
            _ = play.recording  # cached: the messages are no longer needed
            play.pieces.clear()
        self.recordings = tuple(_joined(self.plays, kept) for kept in self.kept)
        unfinished = self._broken or self._begun()
        self.unfinished = _joined(self.plays, unfinished).broken_off() if unfinished else None

    @property
    def complete_plays(self) -> Sequence[Play]:
        """Return the plays up to the end of the last complete recording."""
        return self.plays[: self._complete]

    def _begun(self) -> list[int]:
        """Return the indices of the plays of the last trial, if no recording was made of it."""
        trials = [play.trial for play in self.plays[self._since :] if play.trial is not None]
        return self._plays_of(trials[-1]) if trials else []

    def _plays_of(self, trial: int) -> list[int]:
        return [index for index in range(self._since, len(self.plays)) if self.plays[index].trial == trial]

    def _keep(self, entry: Mapping[str, Any]) -> None:
        plays = [len(self.plays) - 1] if entry["trial"] is None else self._plays_of(int(entry["trial"]))
        self._broken = plays if entry["broken"] else []
        if not entry["broken"]:
            self.kept.append(plays)
            self._complete = plays[-1] + 1
        self._since = len(self.plays)

    def _resume(self, count: int) -> None:
        """Remove plays that are repeated; remaining plays after the last recording belong to none."""
        if count > len(self.plays):
            raise RecordingError(
                f"the files before it hold {len(self.plays)} of {count} motions; copy the complete files again"
            )
        del self.plays[count:]
        for play in self.plays[self._complete :]:
            play.trial = None
        self._broken, self._since = [], count


def _joined(plays: Sequence[Play], indices: Sequence[int]) -> Recording:
    whole = Recording.concatenate([plays[index].recording for index in indices])
    return replace(whole, trial_id=plays[indices[0]].trial)


def _event(message: bytes) -> Event:
    noted = json.loads(read_text(message))
    return Event(float(noted["time"]), str(noted["name"]), noted["data"])
