"""Rows of trials on disk, in Parquet parts that are readable after an interruption.

study.json       definition of the study
trials/*.parquet rows; Pandas, Polars, DuckDB and Arrow read the folder as one table
failures/        recordings of failed calibrations
"""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false, reportUnknownArgumentType=false
# pyright: reportMissingTypeStubs=false
# PyArrow comes without types.

from __future__ import annotations

import json
import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import pyarrow as arrow
from pyarrow import parquet

from equipoise.errors import OutputError, RecordingError, SettingsError
from equipoise.lab.study.rows import COLUMNS, Table, in_order
from equipoise.lab.study.study import Study
from equipoise.user_file import json_value, read_text, write_file

SCHEMA = "equipoise.study/1"
_HEADER, _TRIALS, FAILURES = "study.json", "trials", "failures"
_FLUSH_INTERVAL = 5.0  # [s] of trials that a kill may lose


class TrialStore:
    """Folder with the rows of a study, new or to resume.

    Attributes:
        folder: folder of the rows.
        done: numbers of finished trials, including those not yet written.
    """

    def __init__(self, folder: str | Path, study: Study) -> None:
        """Create or open the folder.

        Raises:
            SettingsError: it contains another study.
            OutputError: it contains other files, or cannot be written.
            RecordingError: a file of the study is damaged.
        """
        self.folder = Path(folder)
        try:
            self._claim(study)
            (self.folder / _TRIALS).mkdir(exist_ok=True)
        except OSError as error:
            raise OutputError(f"cannot write into {str(self.folder)!r}: {error.strerror or error}") from error
        self.done: set[int] = set(self.rows(("trial", "method"))["trial"].to_pylist())
        self._waiting: list[Table] = []
        self._written = time.monotonic()

    def add(self, rows: Table) -> None:
        """Add all rows of one trial, which are written together."""
        self._waiting.append(rows)
        self.done.update(rows["trial"].to_pylist())

    def flush_if_due(self) -> None:
        """Write waiting rows if the flush interval has passed. Call this often."""
        if time.monotonic() - self._written > _FLUSH_INTERVAL:
            self.flush()

    def flush(self) -> None:
        """Write waiting rows; raises OutputError if that fails, and keeps the rows."""
        if self._waiting:
            rows = arrow.concat_tables(self._waiting)
            # First trial, process and time make the name unique.
            name = f"part-{rows['trial'][0].as_py():08d}-{os.getpid()}-{time.time_ns():x}.parquet"
            path, unfinished = self.folder / _TRIALS / name, self.folder / f".{name}"
            try:
                parquet.write_table(rows, unfinished)
                os.replace(unfinished, path)
            except OSError as error:
                raise OutputError(f"cannot write {str(path)!r}: {error.strerror or error}") from error
            self._waiting = []
        self._written = time.monotonic()

    def rows(self, columns: Sequence[str] | None = None) -> Table:
        """Return the rows on disk in the order of the trials, each trial and method once."""
        return read_rows(self.folder, columns)

    def _claim(self, study: Study) -> None:
        header = self.folder / _HEADER
        if header.exists():
            table = _read_header(self.folder)
            if table.get("fingerprint") != study.fingerprint:
                theirs = table.get("study", {})
                differing = [key for key, value in study.to_dict().items() if theirs.get(key) != value]
                raise SettingsError(
                    f"{str(self.folder)!r} contains another study (it differs in "
                    f"{', '.join(differing) or 'the model file, or the version of equipoise'}); "
                    "pass the same flags to resume it, or another --out"
                )
            return
        if self.folder.is_dir() and any(self.folder.iterdir()):
            raise OutputError(f"the output folder {str(self.folder)!r} contains other files; name a new one with --out")
        self.folder.mkdir(parents=True, exist_ok=True)
        table = {"schema": SCHEMA, "fingerprint": study.fingerprint, "study": study.to_dict()}
        write_file(header, json.dumps(table, indent=2) + "\n")


def read_rows(folder: str | Path, columns: Sequence[str] | None = None) -> Table:
    """Read the rows of a study's folder in the order of the trials, each trial and method once.

    Args:
        folder: folder of the study.
        columns: names of the columns to read, including "trial" and "method"; None: all.

    Raises:
        RecordingError: the folder is not a study, or a part of it cannot be read.
    """
    folder = Path(folder)
    _read_header(folder)
    schema = COLUMNS if columns is None else arrow.schema([COLUMNS.field(name) for name in columns])
    tables = [schema.empty_table()]
    for path in sorted((folder / _TRIALS).glob("part-*.parquet")):
        try:
            tables.append(parquet.read_table(path, columns=None if columns is None else list(columns)))
        except (OSError, ValueError) as error:  # ArrowInvalid is a ValueError
            raise RecordingError(f"{str(path)!r} is damaged ({error}); remove it to repeat its trials") from error
    return in_order(tables)


def _read_header(folder: Path) -> dict[str, Any]:
    try:
        table = json_value(read_text(folder / _HEADER))
    except OSError as error:
        raise RecordingError(f"{str(folder)!r} is not a Monte Carlo study: {error.strerror}") from error
    except ValueError as error:
        raise RecordingError(f"{_HEADER} in {str(folder)!r} is not JSON: {error}") from error
    if not isinstance(table, dict) or cast("dict[str, Any]", table).get("schema") != SCHEMA:
        raise RecordingError(f"{_HEADER} in {str(folder)!r} does not have the schema {SCHEMA!r}")
    return cast("dict[str, Any]", table)
