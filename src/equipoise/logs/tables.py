"""CSV and Parquet logs with documented columns.

time                                   [s], increasing; or Parquet's own time stamps
position.JOINT                         encoders [rad]
velocity.JOINT, torque.JOINT           [rad/s], [Nm]; if the robot measures them
gyro.x gyro.y gyro.z                   [rad/s], in the IMU's frame
accelerometer.x .y .z                  [m/s2], +9.81 upward at rest
command.JOINT                          position targets [rad]; optional

Cells may be empty: a row that has only joints, or only the IMU, is how streams of different rates share a table.
"""

from __future__ import annotations

import csv
import difflib
import importlib
import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import MissingDependencyError, RecordingError
from equipoise.logs.log import RawImu, RawJoints, RawLog
from equipoise.logs.topics import Topics
from equipoise.robot.model import RobotModel

_TIME = "time"
_IMU = tuple(f"{sensor}.{axis}" for sensor in ("gyro", "accelerometer") for axis in "xyz")
_KINDS = ("position", "velocity", "torque", "command")
_SECONDS = 0.5  # [s] between samples: more is another unit


def read_table(path: Path, robot: RobotModel, topics: Topics) -> RawLog:  # a `LogReader`
    """The streams of a CSV or Parquet file.

    Raises:
        RecordingError: it cannot be read, columns are missing, or cells are no numbers.
        MissingDependencyError: Parquet needs pyarrow.
    """
    columns, names = _read_parquet(path) if path.suffix.lower() == ".parquet" else _read_csv(path)
    _check_columns(path, names)
    time = columns[_TIME]
    joints = _joints(time, columns, "position")
    imu_values = np.column_stack([columns[name] for name in _IMU])
    rows = ~np.isnan(imu_values).all(axis=1)
    imu = RawImu(time[rows], imu_values[rows, :3], imu_values[rows, 3:])
    commands = _joints(time, columns, "command") if _named(columns, "command") else None
    for name, stamps in (("joint", joints.time), ("IMU", imu.time)):
        _check_seconds(path, name, stamps)
    return RawLog(joints, imu, commands, {"format": f"{path.suffix.lower()[1:]} table, {len(time)} rows"})


def _joints(time: FloatArray, columns: Mapping[str, FloatArray], kind: str) -> RawJoints:
    """The rows in which there is a position of any joint."""
    names = _named(columns, kind)
    position = np.column_stack([columns[f"{kind}.{name}"] for name in names])
    rows = ~np.isnan(position).all(axis=1)

    def other(quantity: str) -> FloatArray | None:
        if kind != "position" or not _named(columns, quantity):
            return None
        missing = np.full(len(time), np.nan)
        return np.column_stack([columns.get(f"{quantity}.{name}", missing) for name in names])[rows]

    return RawJoints(time[rows], tuple(names), position[rows], other("velocity"), other("torque"))


def _named(columns: Iterable[str], kind: str) -> list[str]:
    return [name.removeprefix(f"{kind}.") for name in columns if name.startswith(f"{kind}.")]


def _check_columns(path: Path, names: Sequence[str]) -> None:
    missing = [name for name in (_TIME, *_IMU) if name not in names]
    if not _named(names, "position"):
        missing.append("position.JOINT for each joint")
    if not missing:
        return
    near = {name: difflib.get_close_matches(name, names, 1, 0.5) for name in missing}
    hints = [f"{found[0]!r} for {name!r}" for name, found in near.items() if found]
    raise RecordingError(
        f"the table {str(path)!r} lacks {', '.join(missing)}. It has {', '.join(names) or 'no columns'}"
        f"{'; perhaps ' + ', '.join(hints) if hints else ''}. Columns are called {_TIME}, {', '.join(_IMU)}, "
        f"{', '.join(f'{kind}.JOINT' for kind in _KINDS)}"
    )


def _check_seconds(path: Path, name: str, time: FloatArray) -> None:
    if len(time) < 2:
        raise RecordingError(f"the table {str(path)!r} has {len(time)} rows with {name} samples")
    step = float(np.nanmedian(np.abs(np.diff(time))))
    if step > _SECONDS:
        unit = "nanoseconds" if step > 1e5 else "microseconds" if step > 100 else "milliseconds"
        raise RecordingError(
            f"{name} samples of the table {str(path)!r} are {step:g} apart in {_TIME!r}, which must be in seconds (are they "
            f"{unit}?)"
        )


def _read_csv(path: Path) -> tuple[dict[str, FloatArray], list[str]]:
    """The columns that are wanted, and the names of all."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingError(f"the log {str(path)!r} cannot be read: {_told(error)}") from error
    header = text.split("\n", 1)[0]
    delimiter = max(",;\t", key=header.count)
    try:
        rows = [row for row in csv.reader(io.StringIO(text), delimiter=delimiter) if row]
    except csv.Error as error:
        raise RecordingError(f"the log {str(path)!r} is not CSV: {error}") from error
    if len(rows) < 2:
        raise RecordingError(
            f"the log {str(path)!r} holds no samples: it must have a line of column names and then numbers"
        )
    names = [name.strip() for name in rows[0]]
    _refuse_duplicates(path, names)
    for number, row in enumerate(rows[1:], 2):
        if len(row) != len(names):
            raise RecordingError(
                f"line {number} of {str(path)!r} has {len(row)} cells; its first line names {len(names)}"
            )
    cells = zip(*rows[1:], strict=True)
    return {n: _numbers(path, n, column) for n, column in zip(names, cells, strict=True) if _wanted(n)}, names


def _numbers(path: Path, name: str, cells: Sequence[str]) -> FloatArray:
    """A column's numbers; empty cells are not numbers (NaN)."""
    try:
        return np.array([cell if cell.strip() else "nan" for cell in cells], dtype=float)
    except ValueError:
        for number, cell in enumerate(cells, 2):
            try:
                float(cell.strip() or "nan")
            except ValueError:
                raise RecordingError(
                    f"{cell!r} in column {name!r}, line {number} of {str(path)!r} is no number (decimal points, no units)"
                ) from None
        raise


def _read_parquet(path: Path) -> tuple[dict[str, FloatArray], list[str]]:
    """As `_read_csv`."""
    try:
        pa: Any = importlib.import_module("pyarrow")
        pq: Any = importlib.import_module("pyarrow.parquet")
    except ModuleNotFoundError as error:
        raise MissingDependencyError(
            f"the Parquet log {str(path)!r} needs pyarrow: pip install 'equipoise[monte-carlo]'"
        ) from error
    try:
        table: Any = pq.read_table(path)
    except (OSError, pa.ArrowException) as error:
        raise RecordingError(f"the log {str(path)!r} cannot be read as Parquet: {_told(error)}") from error
    _refuse_duplicates(path, table.column_names)
    columns: dict[str, FloatArray] = {}
    for name in filter(_wanted, table.column_names):
        column: Any = table.column(name)
        if pa.types.is_timestamp(column.type):
            stamps = column.cast(pa.timestamp("ns")).cast(pa.int64())
            whole = np.asarray(stamps.fill_null(0).to_numpy(), dtype=np.int64)
            # The first is subtracted from whole numbers: floats hold nanoseconds since 1970 to some 256.
            columns[name] = np.where(column.is_null().to_numpy(), np.nan, (whole - whole[0]) * 1e-9)
            continue
        try:
            columns[name] = np.asarray(column.cast(pa.float64()).fill_null(np.nan).to_numpy(), dtype=float)
        except pa.ArrowException as error:
            raise RecordingError(f"column {name!r} of {str(path)!r} holds no numbers: {_told(error)}") from error
    return columns, list(table.column_names)


def _wanted(name: str) -> bool:
    return name == _TIME or name.split(".", 1)[0] in (*_KINDS, "gyro", "accelerometer")


def _refuse_duplicates(path: Path, names: Sequence[str]) -> None:
    twice = sorted({name for name in names if names.count(name) > 1 and _wanted(name)})
    if twice:
        raise RecordingError(f"the table {str(path)!r} has the column {twice[0]!r} twice")


def _told(error: Exception) -> str:
    return str(getattr(error, "strerror", None) or error).split("\n", maxsplit=1)[0]
