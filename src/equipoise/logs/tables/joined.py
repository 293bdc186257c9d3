"""Several tables of one run as one: joints in one file, the IMU in another, or a file for each quantity."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError, SettingsError
from equipoise.logs.tables.by_name import named
from equipoise.logs.tables.column_names import TIME, UNITS, Columns, unit_of_steps
from equipoise.logs.tables.files import TableFile, open_table


def open_tables(paths: Sequence[Path], columns: Columns) -> TableFile:
    """Return the table of one file, or of several joined by time.

    Files without names that begin with the same increasing numbers are joined by these. A name that is in several files, or
    in none but a number, follows the name of its file: `velocity.FL_hip_joint`.

    Args:
        columns: columns that the user names; those of time are joined by, and are one then.

    Raises:
        SettingsError: there is a rate, and a column of times.
        RecordingError: one of several files has no time, or files without a time differ in length.
    """
    files = [open_table(path) for path in paths]
    clocks = [None if columns.names.get(TIME) == "" else _clock(file, columns) for file in files]
    if not (columns.rate or any(clocks) or TIME in columns.names):
        clocks = _first_columns(files)
    if columns.rate and (clock := next(filter(None, clocks), None)):
        raise SettingsError(
            f"the rate is given, and {clock!r} is called like a time: leave out --rate, or write time = '' into a file for "
            "--columns"
        )
    if len(files) == 1:
        return files[0]
    if columns.rate and len({file.rows for file in files}) > 1:
        lengths = " and ".join(f"{file.rows} rows in {file.title}" for file in files)
        raise RecordingError(f"there are {lengths}: files without a time must have a row each for every sample")
    return _joined(paths, files, clocks, columns)


def _clock(file: TableFile, columns: Columns) -> str | None:
    """Return the column of a file's time: the user's, ours, or the first that is called like one; None if there is none."""
    called = (name for name in file.names if (what := named(name)) is not None and what.kind == TIME)
    return next((name for name in (columns.names.get(TIME), TIME, *called) if name in file.names), None)


def _first_columns(files: Sequence[TableFile]) -> list[str | None]:
    """Return the names of the first columns of files without names if these are the same increasing numbers, else None."""
    names = [file.names[0] for file in files]
    if len(files) > 1 and set(names) == {"[0]"} and len({file.rows for file in files}) == 1:
        first = [file.column(name) for file, name in zip(files, names, strict=True)]
        if (np.diff(first[0]) > 0).all() and all((other == first[0]).all() for other in first):
            return [*names]
    return [None] * len(files)


def _seconds(file: TableFile, clock: str | None, columns: Columns) -> FloatArray:
    """(n,) times of a file's rows, from the origin of its clock [s]."""
    if columns.rate:
        return np.arange(file.rows) / columns.rate
    if clock is None:
        raise RecordingError(
            f"{file.title} has no time by which to join it with the others: name its column in a file for --columns, as "
            'time = "...", or give --rate if all files have a row for every sample'
        )
    values, what = file.column(clock), named(clock)
    unit = columns.units.get(TIME) or (what and what.unit) or unit_of_steps(values)
    return values * UNITS[TIME][unit]


def _joined(
    paths: Sequence[Path], files: Sequence[TableFile], clocks: Sequence[str | None], given: Columns
) -> TableFile:
    times = [_seconds(file, clock, given) for file, clock in zip(files, clocks, strict=True)]
    microseconds, rows = np.unique(np.round(np.concatenate(times) * 1e6), return_inverse=True)
    time = microseconds * 1e-6 / given.factor(TIME)
    parts = np.split(rows, np.cumsum(list(map(len, times)))[:-1])
    count = Counter([TIME, *(name for file in files for name in file.names)])
    columns: dict[str, tuple[TableFile, str, NDArray[np.intp]]] = {}
    for path, file, clock, part in zip(paths, files, clocks, parts, strict=True):
        names = [name for name in file.names if name != clock]
        columns |= {_own_name(path, name, count[name]): (file, name, part) for name in names}

    def read(index: int) -> FloatArray:
        if not index:
            return time
        file, name, part = [*columns.values()][index - 1]
        column = np.full(len(time), np.nan)
        column[part] = file.column(name)
        return column

    title = f"the table of {' and '.join(repr(str(path)) for path in paths)}"
    texts = {own: file.texts[name] for own, (file, name, _) in columns.items() if name in file.texts}
    passed_over = tuple(other for file in files for other in file.passed_over)
    return TableFile(title, len(time), (given.names.get(TIME) or TIME, *columns), read, passed_over, texts)


def _own_name(path: Path, name: str, count: int) -> str:
    stem = path.name.split(".")[0]
    if name.startswith("["):
        return f"{stem}{name}"
    return f"{stem}.{name}" if count > 1 else name
