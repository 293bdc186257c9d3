"""The log of a run read while it is written: what another process did, a quarter of a second ago.

Nothing of this is known to the process that moves the robot: it writes its log as it always does.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from equipoise.recording.log_messages import INERTIAL, JOINTS, LOG, TYPES
from equipoise.recording.mcap_reader import MessageReader
from equipoise.recording.messages import read_text
from equipoise.recording.recording import Recording
from equipoise.recording.run_log_reader import LoggedPiece, check_format, damage_reported, log_files


@dataclass(frozen=True, eq=False)
class News:
    """What has come since one looked last.

    Attributes:
        pieces: of all motions, in order.
        recordings: that were kept meanwhile: the trials that are complete.
        anew: whether everything that came before is void, because the run was resumed and part of it is played again.
    """

    pieces: tuple[Recording, ...] = ()
    recordings: tuple[Recording, ...] = ()
    anew: bool = False


class Source(Protocol):
    """Where recordings come from."""

    @property
    def complete(self) -> bool:
        """Whether nothing more will come."""
        ...

    def news(self) -> News:
        """What has come since the last call."""
        ...


class GivenRecordings:
    """Recordings that are at hand: a log that is not ours, with what was found in it.

    Args:
        whole: all of it.
        parts: what in it can be used, as trials.
    """

    complete = True

    def __init__(self, whole: Recording, parts: tuple[Recording, ...] = ()) -> None:
        self._news = News((whole,), parts)

    def news(self) -> News:
        """Everything the first time."""
        news, self._news = self._news, News()
        return news


class FollowedLog:
    """A log of ours, whether it is still written or not.

    Args:
        path: file of the log, which need not be there yet; or the folder of a run.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._begin()

    @property
    def complete(self) -> bool:
        """Whether the log was closed."""
        return self._readers[-1].closed and self._readers[-1].path == self._files()[-1]

    def news(self) -> News:
        """Return what was written since the last call. Once a run was resumed, all of its log is new.

        Raises:
            RecordingError: a file is damaged or of another format.
        """
        anew = self._readers[-1].path != self._files()[-1]
        if anew:
            self._begin()
        self._new, self._complete = [], []
        for reader in self._readers:
            if reader.path.exists():
                self._read(reader)
        return News(tuple(self._new), tuple(self._complete), anew)

    def _files(self) -> list[Path]:
        files = log_files(self.path) if self.path.is_dir() else [self.path]
        return [file for file in files if file.exists() and file.stat().st_size] or files[:1]

    def _begin(self) -> None:
        self._readers = [MessageReader(file) for file in self._files()]
        self._about: Mapping[str, Any] | None = None  # of the piece that is read
        self._sensed: dict[str, list[bytes]] = {topic: [] for topic in TYPES}
        self._plays: list[_Play] = []
        self._since = 0  # plays before the present trial
        self._new: list[Recording] = []
        self._complete: list[Recording] = []

    def _read(self, reader: MessageReader) -> None:
        messages = reader.messages()
        if messages:
            check_format(reader)
        with damage_reported(reader.path):
            for topic, _, _, message in messages:
                if topic == LOG:
                    self._entry(json.loads(read_text(message)))
                else:
                    self._sensed[topic].append(message)
            self._flush()

    def _entry(self, entry: Mapping[str, Any]) -> None:
        self._flush()
        if entry["entry"] == "play":
            self._plays.append(_Play(entry["trial"]))
        elif entry["entry"] == "piece":
            self._about = entry
        elif entry["entry"] == "kept":
            if not entry["broken"]:
                self._complete.append(self._recording(entry["trial"]))
            self._since = len(self._plays)
        elif entry["entry"] == "resumed":
            self._resume(int(entry["plays"]))

    def _recording(self, trial: int | None) -> Recording:
        plays = [play for play in self._plays[self._since :] if play.trial == trial]
        return Recording.concatenate([piece for play in plays[-1 if trial is None else 0 :] for piece in play.pieces])

    def _resume(self, count: int) -> None:
        """Leave out plays that are played again. All of the log is new then."""
        del self._plays[count:]
        self._new = [piece for play in self._plays for piece in play.pieces]
        self._since = count

    def _flush(self) -> None:
        """Make a recording of what has come of the present piece; the file may end in the middle of it."""
        if self._about is None or not (self._sensed[JOINTS] or self._sensed[INERTIAL]):
            return
        piece = LoggedPiece(self._about, self._sensed).recording()
        self._sensed = {topic: [] for topic in TYPES}
        self._plays[-1].pieces.append(piece)
        self._new.append(piece)


@dataclass
class _Play:
    """Motion that is read."""

    trial: int | None
    pieces: list[Recording] = field(default_factory=list[Recording])
