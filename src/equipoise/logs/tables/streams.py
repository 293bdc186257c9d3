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
    file.refuse_twins(known.names.values())
    if standing and not known.has([TIME]):
        known = replace(known, rate=known.rate or 1.0)
    if missing := known.missing(standing):
        raise _missing_columns(file, missing, *propose(robot, file, known, standing))
    check_names_in_cells(robot, file, known)
    return _Streams(file, known, robot).raw_log(suffix_of(path), standing)


class _Streams:
    """Conversion of a file's columns to streams."""

    def __init__(self, file: TableFile, columns: Columns, robot: RobotModel) -> None:
        self.file, self.columns, self.robot, rate = file, columns, robot, columns.rate
        self.time = np.arange(file.rows) / rate if rate else file.clock(columns.names[TIME]) * columns.factor(TIME)

    def raw_log(self, kind: str, standing: bool) -> RawLog:
        """Return all streams.

        Args:
            kind: name of the kind of file.
            standing: see `read_table`.
        """
        findings: list[LogFinding] = []
        joints = self._joints("position", findings)
        if standing:  # a pose differs little from the plane of the feet
            imu = self._imu() if self.columns.has((*ACCELEROMETER, *GYROSCOPE)) else None
        else:
            imu = self._imu_of_poses(findings) if self.columns.has_pose() else self._imu()
        stamped = [] if standing or self.columns.rate else [("joint", joints), ("IMU", imu)]
        for name, stream in stamped:
            _check_seconds(self.file, name, stream.time if stream is not None else np.empty(0))
        commands = self._joints("command", findings) if self.columns.joints("command") else None
        about = {"format": f"{kind} table, {len(self.time)} rows"}
        return RawLog(joints, imu, commands, about, tuple(findings))

    def _joints(self, kind: str, findings: list[LogFinding]) -> RawJoints:
        """Return the rows with a position of any joint."""
        names = self.columns.joints(kind)
        position = self._stacked([f"{kind}.{name}" for name in names])
        rows = ~np.isnan(position).all(axis=1)

        def other(quantity: str) -> FloatArray | None:
            if kind != "position" or not self.columns.joints(quantity):
                return None
            table = self._stacked([f"{quantity}.{name}" for name in names])
            valid = np.isfinite(table.sum(axis=1))
            if np.count_nonzero(valid) < 2 or 2 * np.count_nonzero(valid & rows) > np.count_nonzero(rows):
                return table[rows]
            message = f"{quantity} has times of its own: it is interpolated at those of the positions"
            findings.append(LogFinding("joints", message))
            return _interpolated(self.time[rows], self.time[valid], table[valid])

        force = None
        if kind == "position" and self.columns.has(FOOT_FORCES):
            force = self._stacked(FOOT_FORCES)[rows]
        return RawJoints(self.time[rows], tuple(names), position[rows], other("velocity"), other("torque"), force)

    def _imu(self) -> RawImu:
        """Return the rows with any value of the IMU."""
        gyroscope = self._stacked(GYROSCOPE) if self.columns.has(GYROSCOPE) else None
        acceleration, orientation = self._stacked(ACCELEROMETER), self._orientation()
        parts = [part for part in (gyroscope, acceleration, orientation) if part is not None]
        rows = ~np.isnan(np.hstack(parts)).all(axis=1)
        self._check_exchanged(gyroscope, acceleration)
        return RawImu(
            self.time[rows],
            None if gyroscope is None else gyroscope[rows],
            acceleration[rows],
            None if orientation is None else orientation[rows],
        )

    def _imu_of_poses(self, findings: list[LogFinding]) -> RawImu:
        """Return IMU samples that are derived from the base's pose, at the times of a gyroscope if there is one."""
        quaternions, turning = self._orientation(), self._stacked(GYROSCOPE) if self.columns.has(GYROSCOPE) else None
        assert quaternions is not None  # as `Columns.missing` requires
        imu, message = imu_of_poses(self.robot, self.time, self._stacked(BASE_POSITION), quaternions, turning)
        findings.append(LogFinding("IMU", message))
        return imu

    def _check_exchanged(self, gyroscope: FloatArray | None, acceleration: FloatArray) -> None:
        """Raise RecordingError if the gyroscope's columns carry gravity, and the accelerometer's do not."""
        if gyroscope is not None and is_exchanged(gyroscope, acceleration):
            turns, pushes = (", ".join(self.columns.names[name] for name in of) for of in (GYROSCOPE, ACCELEROMETER))
            raise RecordingError(
                f"{turns} of {self.file.title} are read as the gyroscope, {pushes} as the accelerometer, and gravity is in "
                "the gyroscope's: they seem to be exchanged. Name both in a file for --columns"
            )

    def _orientation(self) -> FloatArray | None:
        """Return (n, 4) quaternions, w first."""
        if self.columns.has(QUATERNION):
            return self._stacked(QUATERNION, factor=1.0)
        if not self.columns.has(ANGLES):
            return None
        angles = self._stacked(ANGLES)
        valid = np.isfinite(angles).all(axis=1)
        quaternions = np.full((len(angles), 4), np.nan)
        quaternions[valid] = quaternions_of(angles[valid])
        return quaternions

    def _stacked(self, names: Sequence[str], factor: float | None = None) -> FloatArray:
        """Return (n, k) columns in the documented unit, or times a factor; NaN where the table has none."""
        missing = np.full(len(self.time), np.nan)
        factor = self.columns.factor(names[0].split(".")[0]) if factor is None else factor
        columns = [self.columns.names.get(name) for name in names]
        table = np.column_stack([self.file.column(theirs) if theirs else missing for theirs in columns])
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
