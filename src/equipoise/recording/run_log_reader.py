"""The log of a run read back: its recordings, exactly as they were kept, and the plays that they came from."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from equipoise.errors import RecordingError
from equipoise.recording.event import TRIAL, Event
from equipoise.recording.log_messages import COMMANDS, EVENTS, FORMAT, INERTIAL, JOINTS, LOG
from equipoise.recording.mcap_reader import read_mcap
from equipoise.recording.messages import read_imu, read_joints, read_text
from equipoise.recording.recording import CommandStream, Recording


@dataclass(frozen=True, eq=False)
class Play:
    """One motion that was played.

    Attributes:
        commands: number of commands that were planned; a motion that was stopped early has fewer samples.
        recording: recording of the motion.
        trial: index of the recording that it is a part of, or that an attempt before was to become; None if it belongs to
            none, as standing up does.
    """

    commands: int
    recording: Recording
    trial: int | None = None


@dataclass(frozen=True, eq=False)
class LogContent:
    """What is in a log.

    Attributes:
        plays: all motions, in order.
        recordings: those that are complete, in order.
        unfinished: recording of what was played after them towards one that is not complete, or None.
        closed: whether the log was closed; else the process was killed.
    """

    plays: tuple[Play, ...]
    recordings: tuple[Recording, ...]
    unfinished: Recording | None
    closed: bool

    @property
    def complete_plays(self) -> tuple[Play, ...]:
        """Plays up to the end of the last complete recording."""
        last = max((index for index, play in enumerate(self.plays) if play.trial is not None), default=-1)
        return self.plays[: last + 1]


def read_log(path: Path) -> LogContent:
    """Read a log, also one whose process was killed: as far as it was written.

    Raises:
        RecordingError: the file is missing, damaged or of another format.
    """
    content = read_mcap(path)
    if content.channels or content.closed:
        found = content.channels.get(LOG, {}).get("format")
        if found is None:
            raise RecordingError(f"{str(path)!r} is no log of equipoise: it has no topic {LOG}")
        if found != FORMAT:
            raise RecordingError(f"the log {str(path)!r} is {found!r}; this version reads {FORMAT!r}")
    reading = _Reading()
    try:
        for topic, message in content.messages:
            reading.take(topic, message)
        return reading.content(content.closed)
    except RecordingError as error:
        raise RecordingError(f"the recording {str(path)!r} is damaged: {error}") from error
    except (KeyError, TypeError, ValueError, IndexError, OverflowError, RecursionError) as error:
        raise RecordingError(f"the recording {str(path)!r} is damaged: {error!r}") from error


@dataclass
class LoggedPiece:
    """Messages of one piece, by topic, under what its entry says."""

    entry: Mapping[str, Any]
    messages: dict[str, list[bytes]] = field(
        default_factory=lambda: {JOINTS: [], INERTIAL: [], COMMANDS: [], EVENTS: []}
    )

    def recording(self) -> Recording:
        names = tuple(str(name) for name in self.entry["joint_names"])
        commands = None
        if self.entry["commands"]:
            stream = read_joints(self.messages[COMMANDS], names, velocity=False, torque=False)
            commands = CommandStream(stream.time, stream.position)
        return Recording(
            names,
            read_joints(self.messages[JOINTS], names, bool(self.entry["velocity"]), bool(self.entry["torque"])),
            read_imu(self.messages[INERTIAL]),
            commands,
            tuple(_event(message) for message in self.messages[EVENTS]),
        )


@dataclass
class _Play:
    """A play whose pieces are still read."""

    number: int
    commands: int
    pieces: list[LoggedPiece] = field(default_factory=list[LoggedPiece])

    def whole(self) -> Play:
        return Play(self.commands, Recording.concatenate([piece.recording() for piece in self.pieces]))


@dataclass
class _Kept:
    """Indices of the first play since a recording was kept before, and of those that make up this one."""

    since: int
    plays: list[int]


class _Reading:
    """Takes messages in the order in which they were written."""

    def __init__(self) -> None:
        self._plays: list[_Play] = []
        self._kept: list[_Kept] = []
        self._broken: _Kept | None = None
        self._since = 0

    def take(self, topic: str, message: bytes) -> None:
        if topic != LOG:
            self._plays[-1].pieces[-1].messages[topic].append(message)
            return
        entry = json.loads(read_text(message))
        if entry["entry"] == "play":
            self._plays.append(_Play(int(entry["number"]), int(entry["commands"])))
        elif entry["entry"] == "piece":
            self._plays[-1].pieces.append(LoggedPiece(entry))
        elif entry["entry"] == "kept":
            self._keep(entry)
        if entry["entry"] in ("kept", "aside"):
            self._since = len(self._plays)

    def content(self, closed: bool) -> LogContent:
        plays = [play.whole() for play in self._plays]
        unfinished = self._unfinished(plays)
        return LogContent(
            tuple(_of_trials(plays, self._kept)),
            tuple(_joined(plays, kept.plays) for kept in self._kept),
            _joined(plays, unfinished).broken_off() if unfinished else None,
            closed,
        )

    def _unfinished(self, plays: Sequence[Play]) -> Sequence[int]:
        """Indices of the plays that began a recording last, and did not complete it."""
        if self._broken is not None:
            return self._broken.plays
        begun = [index for index in range(self._since, len(plays)) if _begins_trial(plays[index])]
        return range(begun[-1], len(plays)) if begun else ()

    def _keep(self, entry: Mapping[str, Any]) -> None:
        index = {play.number: index for index, play in enumerate(self._plays)}
        kept = _Kept(self._since, [index[int(number)] for number in entry["plays"]])
        self._broken = kept if entry["broken"] else None
        if not entry["broken"]:
            self._kept.append(kept)


def _of_trials(plays: Sequence[Play], recordings: Sequence[_Kept]) -> list[Play]:
    """Plays with the trials that they belong to: those of the recording, and of attempts at a trial before it."""
    marked = list(plays)
    for trial, kept in enumerate(recordings):
        attempts = [index for index in range(kept.since, kept.plays[0]) if _begins_trial(plays[index])]
        for index in range([*attempts, kept.plays[0]][0], kept.plays[-1] + 1):
            marked[index] = replace(plays[index], trial=trial)
    return marked


def _begins_trial(play: Play) -> bool:
    return any(event.name == TRIAL for event in play.recording.events)


def _joined(plays: Sequence[Play], indices: Sequence[int]) -> Recording:
    return Recording.concatenate([plays[index].recording for index in indices])


def _event(message: bytes) -> Event:
    said = json.loads(read_text(message))
    return Event(float(said["time"]), str(said["name"]), said["data"])
