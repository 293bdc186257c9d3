"""What can be looked at: a run, one that is about to begin, or a log."""

from __future__ import annotations

import os
import time
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from equipoise.calibration.run_folder import RunFolder
from equipoise.errors import EquipoiseError
from equipoise.logs.log import Log
from equipoise.logs.motions.segments import find_segments, usable
from equipoise.method.method import Method
from equipoise.precise.method import Precise
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import nominal_stance
from equipoise.view.closing_in import ClosingIn
from equipoise.view.film import Film
from equipoise.view.follow import FollowedLog, GivenRecordings, News, Source
from equipoise.view.frames import Camera

_GENTLE = 10  # levels of niceness: the process that moves the robot goes first
_LOOK = 0.1  # [s] between looks for estimates


@dataclass(frozen=True, eq=False)
class Showing:
    """Something to look at.

    Attributes:
        title: what it is called.
        robot: whose recordings they are.
        method: of the run.
        source: of the recordings.
    """

    title: str
    robot: RobotModel
    method: Method
    source: Source


def open_run(path: Path) -> Showing:
    """A run folder, also one that is still written.

    Raises:
        RecordingError: it is none, or damaged.
    """
    folder = RunFolder.open(path)
    robot = folder.robot()
    return Showing(f"equipoise: {robot.name}, {folder.path.name}", robot, folder.method(), FollowedLog(path))


def open_log(path: Path, robot: RobotModel, log: Log) -> Showing:
    """A log that is not ours, with the trials that are found in it."""
    try:
        parts = usable(find_segments(robot, nominal_stance(robot), log.recording, log.foot_forces))
    except EquipoiseError:  # sensors that no estimate believes can be looked at all the same
        parts = []
    events = tuple(sorted((event for part in parts for event in part.events), key=lambda event: event.time))
    whole = replace(log.recording, events=events)
    return Showing(f"equipoise: {robot.name}, {path.name}", robot, Precise(), GivenRecordings(whole, tuple(parts)))


def follow_log(path: Path, robot: RobotModel) -> Showing:
    """A log of ours that belongs to no run, while it is written: that of `equipoise record`."""
    return Showing(f"equipoise: {robot.name}, {path.name}", robot, Precise(), FollowedLog(path))


def be_gentle() -> None:
    """Let other processes go first: one of them may move a robot, and what it starts inherits its urgency."""
    with suppress(AttributeError, OSError):  # not every system schedules so
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    os.nice(_GENTLE)


class Viewing:
    """A showing that is taken up piece by piece. Use it as a context manager.

    Attributes:
        film, closing_in, camera: what has been taken up.
    """

    def __init__(self, showing: Showing) -> None:
        stance = nominal_stance(showing.robot)
        self.film = Film(showing.robot, stance, showing.method)
        self.closing_in = ClosingIn(showing.robot, stance, showing.method)
        self.camera = Camera(self.film, self.closing_in)
        self._source = showing.source

    def refresh(self) -> bool:
        """Take up what is new; returns whether no more will come."""
        news = self._source.news()
        if news.anew:
            self.film.clear()
        self._take(news)
        return self._source.complete

    def _take(self, news: News) -> None:
        if news.pieces or news.recordings or news.anew:
            self.film.take(news.pieces, news.recordings)
            self.closing_in.take(news.recordings, news.anew)

    def settle(self) -> None:
        """Wait until there is an estimate after every trial."""
        while not self.closing_in.settled:
            time.sleep(_LOOK)

    def __enter__(self) -> Viewing:
        return self

    def __exit__(self, *exception: object) -> None:
        self.closing_in.close()
