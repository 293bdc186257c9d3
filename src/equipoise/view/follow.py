"""The log of a run read while it is written: what another process did, a quarter of a second ago.

Nothing of this is known to the process that moves the robot: it writes its log as it always does.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from equipoise.errors import RecordingError
from equipoise.recording.log_messages import COMMANDS, EVENTS, FORMAT, INERTIAL, JOINTS, LOG
from equipoise.recording.mcap_reader import McapTail
from equipoise.recording.messages import read_text
from equipoise.recording.recording import Recording
from equipoise.recording.run_log_reader import LoggedPiece

_SENSED = (JOINTS, INERTIAL, COMMANDS, EVENTS)


@dataclass(frozen=True, eq=False)
class News:
    """What has come since one looked last.

    Attributes:
        pieces: of all motions, in order.
        recordings: that were kept meanwhile: the trials that are complete.
        anew: whether everything that came before is void, because another log has taken the place of this one.
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
        path: of the log; it need not be there yet.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._begin()

    @property
    def complete(self) -> bool:
        """Whether the log was closed."""
        return self._tail.closed

    def news(self) -> News:
        """What was written since the last call.

        Raises:
            RecordingError: the file is damaged or of another format.
        """
        if anew := self._tail.replaced:
            self._begin()
        messages = self._tail.read()
        if messages and (found := self._tail.channels.get(LOG, {}).get("format")) != FORMAT:
            raise RecordingError(f"the log {str(self.path)!r} is {found!r}; this version reads {FORMAT!r}")
        self._new, self._complete = [], []
        try:
            for topic, message in messages:
                if topic == LOG:
                    self._entry(json.loads(read_text(message)))
                else:
                    self._sensed[topic].append(message)
            self._flush()
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise RecordingError(f"the recording {str(self.path)!r} is damaged: {error!r}") from error
        return News(tuple(self._new), tuple(self._complete), anew)

    def _begin(self) -> None:
        self._tail = McapTail(self.path)
        self._about: Mapping[str, Any] | None = None  # of the piece that is read
        self._sensed: dict[str, list[bytes]] = {topic: [] for topic in _SENSED}
        self._plays: dict[int, list[Recording]] = {}
        self._play = -1
        self._new: list[Recording] = []
        self._complete: list[Recording] = []

    def _entry(self, entry: Mapping[str, Any]) -> None:
        self._flush()
        if entry["entry"] == "play":
            self._play = int(entry["number"])
        elif entry["entry"] == "piece":
            self._about = entry
        elif entry["entry"] == "kept" and not entry["broken"]:
            plays = [self._plays.get(int(number), []) for number in entry["plays"]]
            self._complete.append(Recording.concatenate([piece for play in plays for piece in play]))
        if entry["entry"] in ("kept", "aside"):
            self._plays = {}

    def _flush(self) -> None:
        """Make a recording of what has come of the present piece; the file may end in the middle of it."""
        if self._about is None or not (self._sensed[JOINTS] or self._sensed[INERTIAL]):
            return
        piece = LoggedPiece(self._about, self._sensed).recording()
        self._sensed = {topic: [] for topic in _SENSED}
        self._plays.setdefault(self._play, []).append(piece)
        self._new.append(piece)
