"""Reader of a run's log while another process writes it, without its cooperation."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from equipoise.errors import EquipoiseError, RecordingError
from equipoise.logs.motions.segments import find_segments, usable
from equipoise.logs.raw_log import Log
from equipoise.recording.event import TRIAL, Event
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
    found = [(float(part.joints.time[0]), part.found_trial) for part in parts]
    starts = [Event(start, TRIAL, trial.to_data()) for start, trial in found if trial is not None]
    events = sorted([*starts, *(event for part in parts for event in part.events)], key=lambda event: event.time)
    return [replace(log.recording, events=tuple(events))], parts


def follow(path: Path, more: Callable[[], bool]) -> Iterator[News]:
    """Yield new data of a log of equipoise, complete or still being written, until it is closed.

    Args:
        path: file of the log, which need not exist yet, or the folder of a run.
        more: function that returns True to wait for more data of an open log. While it is open, the last piece of motion,
            which may still grow, is left for the next news.

    Raises:
        RecordingError: a file is damaged or of another format, or the run was resumed and repeats motions.
    """
    readers, content = [MessageReader(file) for file in _files(path)], LogContent()
    shown, kept = 0, 0  # pieces and complete trials that were yielded
    while True:
        waits = more()
        for reader in readers:
            _take(reader, content)
        ended = readers[-1].closed or not waits
        with damage_reported(path):
            plays, complete = content.plays, content.kept[kept:]
            pieces = [piece for play in plays for piece in play.pieces if any(piece[1].values())]
            pieces = pieces[shown : None if ended else -1]
            shown, kept = shown + len(pieces), kept + len(complete)
            trials = [Recording.concatenate([plays[index].recording for index in trial]) for trial in complete]
            news = [read_piece(*piece) for piece in pieces], trials
        yield news
        if readers[-1].path != _files(path)[-1]:
            raise RecordingError(f"the run {str(path)!r} was resumed; start the view again")
        if ended:
            return


def _take(reader: MessageReader, content: LogContent) -> None:
    """Add the new messages of a file."""
    if reader.path.exists() and (messages := reader.messages()):
        check_format(reader)
        with damage_reported(reader.path):
            for topic, _, _, message in messages:
                content.take(topic, message)


def _files(path: Path) -> list[Path]:
    files = log_files(path) if path.is_dir() else [path]
    return [file for file in files if file.exists() and file.stat().st_size] or files[:1]
