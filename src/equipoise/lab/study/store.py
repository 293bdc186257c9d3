"""Rows of trials on disk: Parquet parts, written as they come, that a killed study leaves readable.

study.json       what the study is
trials/*.parquet rows; the folder reads as one table in Pandas, Polars, DuckDB and Arrow
failures/        recordings of calibrations that failed
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
_FLUSH_INTERVAL = 5.0  # [s] that a kill may cost


class TrialStore:
    """The rows of a study, in a folder. Open it again to go on.

    Attributes:
        folder: folder of the rows.
        done: numbers of the trials whose rows are there, those not yet written included.
    """

    def __init__(self, folder: str | Path, study: Study) -> None:
        """Make the folder, or open it.

        Raises:
            SettingsError: it holds another study.
            OutputError: it holds something else, or cannot be written.
            RecordingError: what it holds is damaged.
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
        """All rows of one trial; they reach the disk together."""
        self._waiting.append(rows)
        self.done.update(rows["trial"].to_pylist())

    def flush_if_due(self) -> None:
        """Write what waits, if the last time is seconds ago. Call it often."""
        if time.monotonic() - self._written > _FLUSH_INTERVAL:
            self.flush()

    def flush(self) -> None:
        """Write what waits; raises OutputError if that fails, and keeps the rows."""
        if self._waiting:
            rows = arrow.concat_tables(self._waiting)
            # Its first trial, the process and the moment make a name that no other part has.
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
        """What is on disk, in the order of the trials; each trial and method once."""
        return read_rows(self.folder, columns)

    def _claim(self, study: Study) -> None:
        header = self.folder / _HEADER
        if header.exists():
            found = _read_header(self.folder)
            if found.get("fingerprint") != study.fingerprint:
                theirs = found.get("study", {})
                differing = [key for key, value in study.to_dict().items() if theirs.get(key) != value]
                raise SettingsError(
                    f"{str(self.folder)!r} holds another study (it differs in "
                    f"{', '.join(differing) or 'the model file, or the version of equipoise'}): "
                    "give the same flags to go on with it, or another --out"
                )
            return
        if self.folder.is_dir() and any(self.folder.iterdir()):
            raise OutputError(f"the output folder {str(self.folder)!r} holds other files; name a new one with --out")
        self.folder.mkdir(parents=True, exist_ok=True)
        table = {"schema": SCHEMA, "fingerprint": study.fingerprint, "study": study.to_dict()}
        write_file(header, json.dumps(table, indent=2) + "\n")


def read_rows(folder: str | Path, columns: Sequence[str] | None = None) -> Table:
    """Rows of a study's folder, in the order of the trials; each trial and method once.

    Args:
        folder: folder of the study.
        columns: names of the columns to read, "trial" and "method" among them; None: all.

    Raises:
        RecordingError: the folder is no study, or a part of it cannot be read.
    """
    folder = Path(folder)
    _read_header(folder)
    schema = COLUMNS if columns is None else arrow.schema([COLUMNS.field(name) for name in columns])
    tables = [schema.empty_table()]
    for path in sorted((folder / _TRIALS).glob("part-*.parquet")):
        try:
            tables.append(parquet.read_table(path, columns=None if columns is None else list(columns)))
        except (OSError, ValueError) as error:  # ArrowInvalid is a ValueError
            raise RecordingError(f"{str(path)!r} is damaged ({error}); remove it and its trials run again") from error
    return in_order(tables)


def _read_header(folder: Path) -> dict[str, Any]:
    try:
        table = json_value(read_text(folder / _HEADER))
    except OSError as error:
        raise RecordingError(f"{str(folder)!r} is no Monte Carlo study: {error.strerror}") from error
    except ValueError as error:
        raise RecordingError(f"{_HEADER} in {str(folder)!r} is not JSON: {error}") from error
    if not isinstance(table, dict) or cast("dict[str, Any]", table).get("schema") != SCHEMA:
        raise RecordingError(f"{_HEADER} in {str(folder)!r} is no {SCHEMA!r}")
    return cast("dict[str, Any]", table)
