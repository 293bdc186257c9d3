"""Reads any log: a bag or a table, by what the path looks like."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from equipoise.errors import RecordingError
from equipoise.logs import tables
from equipoise.logs.log import Log, assemble
from equipoise.logs.rosbag import SUFFIXES, is_bag, read_bag
from equipoise.logs.topics import Topics
from equipoise.robot.model import RobotModel


def is_log(path: Path) -> bool:
    """Whether a path looks like a log of a kind that can be read."""
    return is_bag(path) or (path.is_file() and path.suffix.lower() in tables.SUFFIXES)


def read_log(
    path: str | Path,
    robot: RobotModel,
    topics: Topics | None = None,
    joint_map: Mapping[str, str | int] | None = None,
    span: tuple[float | None, float | None] = (None, None),
) -> Log:
    """A log that is not ours, as a recording of the robot.

    Args:
        path: folder of a rosbag2 bag, an .mcap, .db3, .csv or .parquet file.
        robot: that was logged.
        topics: of a bag, where their types do not say which.
        joint_map: the log's joint name or column, by the robot's name, where names do not say which.
        span: from when until when to read, after the log's first sample [s].

    Raises:
        RecordingError: the log cannot be read, or lacks what is needed.
        SettingsError: the joint map does not fit.
        MissingDependencyError: Parquet needs pyarrow.
    """
    path = Path(path)
    if not path.exists():
        raise RecordingError(f"the log {str(path)!r} does not exist")
    if path.suffix.lower() in tables.SUFFIXES and path.is_file():
        raw = tables.read_table(path)
    elif is_bag(path):
        raw = read_bag(path, robot, topics)
    else:
        known = ", ".join((*SUFFIXES, *tables.SUFFIXES))
        raise RecordingError(
            f"{str(path)!r} is no log that can be read: it must be the folder of a rosbag2 bag, or a file {known}"
        )
    return assemble(robot, raw, joint_map, span)
