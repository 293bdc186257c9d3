"""Tables with documented columns, or with others that a `Columns` names.

time                                   [s], increasing; or Parquet's own time stamps
position.JOINT                         encoders [rad]
velocity.JOINT, torque.JOINT           [rad/s], [Nm]; if the robot measures them
gyro.x gyro.y gyro.z                   [rad/s], in the IMU's frame
accelerometer.x .y .z                  [m/s2], +9.81 upward at rest
orientation.w .x .y .z                 unit quaternion from the IMU's axes to level ones; or .roll .pitch .yaw [rad]
base_position.x .y .z                  [m] of the base link, z up, in place of an accelerometer; the orientation is the link's
command.JOINT                          position targets [rad]; optional
foot_force.FL .FR .RL .RR              readings of the foot force sensors, in any unit; optional

Cells may be empty: streams of different rates share a table by rows with only joints, or only the IMU.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError
from equipoise.logs.base_pose import imu_of_poses
from equipoise.logs.finding import LogFinding
from equipoise.logs.orientation import quaternions_of
from equipoise.logs.raw_log import RawImu, RawJoints, RawLog
from equipoise.logs.tables.column_names import (
    ACCELEROMETER,
    ANGLES,
    BASE_POSITION,
    FOOT_FORCES,
    GYROSCOPE,
    QUATERNION,
    TIME,
    ColumnProposal,
    Columns,
    unit_of_steps,
)
from equipoise.logs.tables.files import TableFile, suffix_of
from equipoise.logs.tables.joined import open_tables
from equipoise.logs.tables.proposal import check_names_in_cells, is_exchanged, propose
from equipoise.logs.topics import Topics
from equipoise.robot.model import RobotModel


def read_table(
    path: Path,
    robot: RobotModel,
    topics: Topics,
    columns: Columns | None = None,
    tables: Sequence[Path] = (),
    standing: bool = False,
) -> RawLog:
    """Return the streams of a table: a `LogReader`.

    Args:
        columns: the user's map of columns without documented names.
        tables: further tables of the same run, which are joined with it by their time.
        standing: True for a log of a standing robot, which needs no IMU, and no time.

    Raises:
        RecordingError: columns are missing; it proposes a map.
        RecordingError: it cannot be read, or cells are not numbers.
        SettingsError: the user's columns are not in the table.
        MissingDependencyError: Parquet needs pyarrow.
    """
    given = columns or Columns()
    file = open_tables((path, *tables), given)
    given.check(file.names, file.title)
    known = given.of_table(file.names)
    if twin := next((name for name in known.names.values() if file.names.count(name) > 1), None):
        raise RecordingError(f"{file.title} has the column {twin!r} twice")
    if standing and not known.has([TIME]):
        known = replace(known, rate=known.rate or 1.0)
    if missing := known.missing(standing):
        raise _missing_columns(file, missing, *propose(robot, file, known, standing))
    check_names_in_cells(robot, file, known)
    time = np.arange(file.rows) / known.rate if known.rate else file.clock(known.names[TIME]) * known.factor(TIME)
    findings: list[LogFinding] = []
    joints = _joints(file, known, time, findings)
    if standing:  # a pose differs little from the plane of the feet
        imu = _imu(file, known, time) if known.has((*ACCELEROMETER, *GYROSCOPE)) else None
    else:
        imu = _imu_of_poses(robot, file, known, time, findings) if known.has_pose() else _imu(file, known, time)
        for name, stream in (("joint", joints), ("IMU", imu)) if not known.rate else ():
            _check_seconds(file, name, stream.time)
    about = {"format": f"{suffix_of(path)} table, {len(time)} rows"}
    return RawLog(joints, imu, _commands(file, known, time), about, tuple(findings))


def _joints(file: TableFile, columns: Columns, time: FloatArray, findings: list[LogFinding]) -> RawJoints:
    """Return the rows with a position of any joint."""
    names = columns.joints("position")
    position = _stacked(file, columns, [f"position.{name}" for name in names])
    rows = ~np.isnan(position).all(axis=1)

    def other(quantity: str) -> FloatArray | None:
        if not columns.joints(quantity):
            return None
        table = _stacked(file, columns, [f"{quantity}.{name}" for name in names])
        valid = np.isfinite(table.sum(axis=1))
        if np.count_nonzero(valid) < 2 or 2 * np.count_nonzero(valid & rows) > np.count_nonzero(rows):
            return table[rows]
        message = f"{quantity} has times of its own: it is interpolated at those of the positions"
        findings.append(LogFinding("joints", message))
        return _interpolated(time[rows], time[valid], table[valid])

    force = _stacked(file, columns, FOOT_FORCES)[rows] if columns.has(FOOT_FORCES) else None
    return RawJoints(time[rows], tuple(names), position[rows], other("velocity"), other("torque"), force)


def _commands(file: TableFile, columns: Columns, time: FloatArray) -> RawJoints | None:
    """Return the rows with a target of any joint."""
    names = columns.joints("command")
    if not names:
        return None
    position = _stacked(file, columns, [f"command.{name}" for name in names])
    rows = ~np.isnan(position).all(axis=1)
    return RawJoints(time[rows], tuple(names), position[rows])


def _imu(file: TableFile, columns: Columns, time: FloatArray) -> RawImu:
    """Return the rows with any value of the IMU."""
    gyroscope = _stacked(file, columns, GYROSCOPE) if columns.has(GYROSCOPE) else None
    acceleration = _stacked(file, columns, ACCELEROMETER)
    parts = [gyroscope, acceleration, _orientation(file, columns)]
    rows = ~np.isnan(np.hstack([part for part in parts if part is not None])).all(axis=1)
    if gyroscope is not None and is_exchanged(gyroscope, acceleration):
        turns, pushes = (", ".join(columns.names[name] for name in of) for of in (GYROSCOPE, ACCELEROMETER))
        raise RecordingError(
            f"{turns} of {file.title} are read as the gyroscope, {pushes} as the accelerometer, and gravity is in the "
            "gyroscope's: they seem to be exchanged. Name both in a file for --columns"
        )
    return RawImu(time[rows], *(None if part is None else part[rows] for part in parts))


def _imu_of_poses(
    robot: RobotModel, file: TableFile, columns: Columns, time: FloatArray, findings: list[LogFinding]
) -> RawImu:
    """Return IMU samples that are derived from the base's pose, at the times of a gyroscope if there is one."""
    quaternions = _orientation(file, columns)
    turning = _stacked(file, columns, GYROSCOPE) if columns.has(GYROSCOPE) else None
    assert quaternions is not None  # as `Columns.missing` requires
    imu, message = imu_of_poses(robot, time, _stacked(file, columns, BASE_POSITION), quaternions, turning)
    findings.append(LogFinding("IMU", message))
    return imu


def _orientation(file: TableFile, columns: Columns) -> FloatArray | None:
    """Return (n, 4) quaternions, w first."""
    if columns.has(QUATERNION):
        return np.column_stack([file.column(columns.names[name]) for name in QUATERNION])
    if not columns.has(ANGLES):
        return None
    angles = _stacked(file, columns, ANGLES)
    valid = np.isfinite(angles).all(axis=1)
    quaternions = np.full((len(angles), 4), np.nan)
    quaternions[valid] = quaternions_of(angles[valid])
    return quaternions


def _stacked(file: TableFile, columns: Columns, names: Sequence[str]) -> FloatArray:
    """Return (n, k) columns of one kind in the documented unit; NaN where the table has none."""
    missing = np.full(file.rows, np.nan)
    factor = columns.factor(names[0].split(".")[0])
    found = [columns.names.get(name) for name in names]
    table = np.column_stack([file.column(theirs) if theirs else missing for theirs in found])
    return table if factor == 1.0 else table * factor


def _interpolated(at: FloatArray, time: FloatArray, table: FloatArray) -> FloatArray:
    columns: list[FloatArray] = [np.interp(at, time, column, np.nan, np.nan) for column in table.T]
    return np.column_stack(columns)


def _missing_columns(file: TableFile, missing: Sequence[str], nameless: Sequence[str], proposal: str) -> RecordingError:
    return ColumnProposal(
        f"{file.title} has no {', '.join(missing)}. The names of its columns suggest the mapping below"
        + (f", but nothing for {', '.join(nameless)}: complete these lines and remove '# missing:'" if nameless else "")
        + ("; --rate HERTZ stands in for a time where samples are evenly spaced" if TIME in nameless else ""),
        proposal,
        file.names,
    ).error()


def _check_seconds(file: TableFile, name: str, time: FloatArray) -> None:
    if len(time) < 2:
        raise RecordingError(f"{file.title} has {len(time)} rows with {name} samples")
    unit = unit_of_steps(time)
    if unit != "s":
        step = float(np.nanmedian(np.abs(np.diff(time))))
        long = {"ns": "nanoseconds", "us": "microseconds", "ms": "milliseconds"}[unit]
        raise RecordingError(
            f"{name} samples of {file.title} are {step:g} apart in {TIME!r}, which must be in seconds (are they "
            f'{long}? Then write units.time = "{unit}" into a file for --columns)'
        )
