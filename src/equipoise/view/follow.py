"""Reader of a run's log while another process writes it, without its cooperation."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from equipoise.errors import EquipoiseError, RecordingError
from equipoise.logs.motions.segments import find_segments, usable
from equipoise.logs.raw_log import Log
from equipoise.recording.mcap_reader import MessageReader
from equipoise.recording.recording import Recording
from equipoise.recording.run_log_reader import LogContent, check_format, damage_reported, log_files, read_piece
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import nominal_stance

News = tuple[Sequence[Recording], Sequence[Recording]]
"""New pieces of motion, in order, and newly complete trials."""


def log_news(robot: RobotModel, log: Log) -> News:
    """Return the recording of another program's log, and the trials detected in it."""
    try:
        parts = usable(find_segments(robot, nominal_stance(robot), log.recording, log.foot_forces))
    except EquipoiseError:  # a log that no estimate accepts can still be shown
        parts = []
    events = sorted((event for part in parts for event in part.events), key=lambda event: event.time)
    return [replace(log.recording, events=tuple(events))], parts


def follow(path: Path, more: Callable[[], bool]) -> Iterator[News]:
    """Yield new data of a log, as from `FollowedLog.news`, until the log is closed.

    Args:
        path: file or folder, as for `FollowedLog`.
        more: function that returns True to wait for more data of an open log.

    Raises:
        RecordingError: a file is damaged or of another format, or the run was resumed and repeats motions.
    """
    log = FollowedLog(path)
    while True:
        waits = more()
        yield log.news(not waits)
        if log.superseded:
            raise RecordingError(f"the run {str(path)!r} was resumed; start the view again")
        if log.closed or not waits:
            return


class FollowedLog:
    """Log of equipoise, complete or still being written.

    Args:
        path: file of the log, which need not exist yet, or the folder of a run.
    """

    def __init__(self, path: Path) -> None:
        self.path, self._content = path, LogContent()
        self._readers = [MessageReader(file) for file in self._files()]
        self._shown, self._kept = 0, 0  # pieces and complete trials that were returned

    @property
    def closed(self) -> bool:
        """True if the log was closed."""
        return self._readers[-1].closed and not self.superseded

    @property
    def superseded(self) -> bool:
        """True if the run was resumed, with a new file, since this log was opened."""
        return self._readers[-1].path != self._files()[-1]

    def news(self, final: bool) -> News:
        """Return pieces of motion and complete trials since the last call.

        Args:
            final: True in the last call; False leaves the last piece, which may still grow, for the next call.

        Raises:
            RecordingError: a file is damaged or has another format.
        """
        for reader in self._readers:
            if reader.path.exists() and (messages := reader.messages()):
                check_format(reader)
                with damage_reported(reader.path):
                    for topic, _, _, message in messages:
                        self._content.take(topic, message)
        with damage_reported(self.path):
            plays, kept = self._content.plays, self._content.kept[self._kept :]
            pieces = [piece for play in plays for piece in play.pieces if any(piece[1].values())]
            pieces = pieces[self._shown : None if final or self.closed else -1]
            self._shown, self._kept = self._shown + len(pieces), self._kept + len(kept)
            trials = [Recording.concatenate([plays[index].recording for index in trial]) for trial in kept]
            return [read_piece(*piece) for piece in pieces], trials

    def _files(self) -> list[Path]:
        files = log_files(self.path) if self.path.is_dir() else [self.path]
        return [file for file in files if file.exists() and file.stat().st_size] or files[:1]
