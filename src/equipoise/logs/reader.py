"""Reading of external logs: each kind of file has its reader, selected by suffix."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Protocol, cast, runtime_checkable

from equipoise.errors import EquipoiseError, MissingDependencyError, RecordingError, SettingsError
from equipoise.logs import bag_files
from equipoise.logs.bag_files import is_bag
from equipoise.logs.raw_log import Log, RawLog, assemble
from equipoise.logs.tables import files
from equipoise.logs.tables.column_names import Columns
from equipoise.logs.tables.files import suffix_of
from equipoise.logs.topics import Topics
from equipoise.plugins import Table
from equipoise.robot.model import RobotModel
from equipoise.user_file import refuse_unreadable


@runtime_checkable
class LogReader(Protocol):
    """Function that reads one kind of file."""

    def __call__(self, path: Path, robot: RobotModel, topics: Topics) -> RawLog:
        """Return the streams of a log.

        Args:
            path: path of an existing file.
            robot: model of the robot that was logged, for formats without joint names.
            topics: topics that the user names, for formats that have topics.

        Raises:
            RecordingError: it cannot be read, or lacks what is needed; any other exception becomes one.
            MissingDependencyError: it needs a package that is not installed.
        """
        ...


_TABLES, _BAGS = "equipoise.logs.tables.streams:read_table", "equipoise.logs.rosbag:read_bag"
_OURS = dict.fromkeys(bag_files.SUFFIXES, _BAGS) | dict.fromkeys(files.SUFFIXES, _TABLES)
READERS: Table[LogReader] = Table(
    "log reader", "equipoise.readers", LogReader, {suffix.removeprefix("."): reader for suffix, reader in _OURS.items()}
)
"""Readers by suffix, without the dot."""


def is_log(path: Path) -> bool:
    """Return whether a path looks like a log of a kind that can be read."""
    return is_bag(path) or (path.is_file() and suffix_of(path) in READERS)


def read_log(
    path: str | Path,
    robot: RobotModel,
    topics: Topics | None = None,
    joint_map: Mapping[str, str | int] | None = None,
    span: tuple[float | None, float | None] = (None, None),
    columns: Columns | None = None,
    tables: Sequence[Path] = (),
    standing: bool = False,
) -> Log:
    """Read an external log as a recording of the robot.

    Args:
        path: folder of a rosbag2 bag, a file of a kind in `READERS`, or one for which a package provides a reader.
        robot: model of the robot that was logged.
        topics: topics of a bag, where their types are ambiguous.
        joint_map: log's joint name or column, by the robot's name, where names are ambiguous.
        span: start and end of what is read, after the log's first sample [s].
        columns: columns of a table without the documented names, and its rate if it has no time.
        tables: further tables of the same run, as of the IMU; they are joined by time.
        standing: True for a log of a standing robot, which may be one sample, in a table without an IMU.

    Raises:
        RecordingError: a table lacks documented column names; it carries a proposal.
        RecordingError: the log cannot be read, or lacks what is needed.
        SettingsError: the joint map or the columns do not fit.
        MissingDependencyError: a bag needs rosbags, Parquet needs pyarrow, or the package of the reader cannot be used.
    """
    paths = [Path(one) for one in (path, *tables)]
    for one in paths:
        _refuse(one)
    reader = READERS["mcap" if paths[0].is_dir() else suffix_of(paths[0])]
    if columns is not None or tables:
        for one in paths:
            _refuse_unless_table(one)
    if not paths[0].is_dir() and f".{suffix_of(paths[0])}" in files.SUFFIXES:
        if topics not in (None, Topics()):
            raise SettingsError(
                f"--joint-topic, --imu-topic and --command-topic are for bags, and {str(path)!r} is a table: name its columns "
                "with --columns"
            )
        reader = partial(reader, columns=columns, tables=paths[1:], standing=standing)  # pyright: ignore[reportCallIssue]
    return assemble(robot, _read(reader, paths[0], robot, topics or Topics()), joint_map, span, standing)


def _refuse(path: Path) -> None:
    """Raise RecordingError for a path that is not a readable log."""
    if not path.exists():
        raise RecordingError(f"the log {str(path)!r} does not exist")
    try:
        refuse_unreadable(path)
    except OSError as error:
        raise RecordingError(f"the log {str(path)!r} cannot be read: {error.strerror}") from error
    if is_log(path):
        return
    if path.suffix.lower() in files.PICKLES:
        raise RecordingError(files.pickle_refused(path))
    kinds = ", ".join(f".{suffix}" for suffix in READERS)
    raise RecordingError(
        f"{str(path)!r} is not a log that can be read: it must be the folder of a rosbag2 bag, or a file {kinds}; tables may "
        "be compressed, as .csv.gz"
    )


def _refuse_unless_table(path: Path) -> None:
    if path.is_dir() or f".{suffix_of(path)}" not in files.SUFFIXES:
        raise SettingsError(
            f"--columns, --rate and several files are for tables ({', '.join(files.SUFFIXES)}), and {str(path)!r} is not one: "
            "name joints of other logs with --joint-map, topics with --joint-topic and --imu-topic"
        )


def _read(reader: LogReader, path: Path, robot: RobotModel, topics: Topics) -> RawLog:
    """Return a reader's log; any exception of the reader becomes an EquipoiseError."""
    try:
        raw = cast("object", reader(path, robot, topics))
    except EquipoiseError:
        raise
    except Exception as error:
        raise RecordingError(f"the log {str(path)!r} cannot be read: {type(error).__name__}: {error}") from error
    if not isinstance(raw, RawLog):
        raise MissingDependencyError(
            f"the reader of .{suffix_of(path)} logs returns a {type(raw).__name__}; it must return a RawLog"
        )
    return raw
