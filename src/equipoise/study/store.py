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

from equipoise.conventions import AXES
from equipoise.errors import MissingDependencyError, OutputError, RecordingError, SettingsError
from equipoise.robot.inertial import COMPONENTS
from equipoise.study.study import SOURCES, Study
from equipoise.study.trial import Row
from equipoise.user_file import write_file

try:
    import pyarrow as arrow
    from pyarrow import parquet
except ModuleNotFoundError as error:
    raise MissingDependencyError(
        "Monte Carlo studies are kept as Parquet: pip install 'equipoise[monte-carlo]'"
    ) from error

SCHEMA = "equipoise.study/1"
_HEADER, _TRIALS, FAILURES = "study.json", "trials", "failures"
_FLUSH_INTERVAL = 5.0  # [s] that a kill may cost
_INTEGERS = ("trial", "lifts", "worker")
_TEXTS = ("method", "status", "message", "log")
_NUMBERS = (
    *("robot_mass", "leg_length", "hip_height", "payload_mass", "payload_x", "payload_y", "payload_z"),
    *(f"size_{name}" for name in SOURCES),
    *("joint_zero_rms", "foot_error_rms", "imu_tilt_size"),
    *(f"{kind}_{name}" for kind in ("true", "estimated", "deviation") for name in COMPONENTS),
    *(f"{kind}_{axis}" for kind in ("true_stance_effective", "moment") for axis in AXES),
    *("timestep", "simulated_time", "robot_time", "wall_time", "cpu_time", "estimation_time"),
)
_LISTS = ("iteration_x", "iteration_y")
COLUMNS = arrow.schema(
    [
        *((name, arrow.int64()) for name in _INTEGERS),
        *((name, arrow.string()) for name in _TEXTS),
        ("trustworthy", arrow.bool_()),
        *((name, arrow.float64()) for name in _NUMBERS),
        *((name, arrow.list_(arrow.float64())) for name in _LISTS),
    ]
)
"""SI units; angles in rad. `true_`, `estimated_`, `deviation_` (posterior standard deviation) are of the whole robot."""


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
        self.done = {int(row["trial"]) for row in self.rows(("trial", "method"))}
        self._waiting: list[Row] = []
        self._written = time.monotonic()

    def add(self, rows: Sequence[Row]) -> None:
        """All rows of one trial; they reach the disk together."""
        self._waiting += rows
        self.done.update(row["trial"] for row in rows)

    def flush_if_due(self) -> None:
        """Write what waits, if the last time is seconds ago. Call it often."""
        if time.monotonic() - self._written > _FLUSH_INTERVAL:
            self.flush()

    def flush(self) -> None:
        """Write what waits; raises OutputError if that fails, and keeps the rows."""
        if self._waiting:
            complete = [{name: row.get(name) for name in COLUMNS.names} for row in self._waiting]
            # Its first trial, the process and the moment make a name that no other part has.
            name = f"part-{self._waiting[0]['trial']:08d}-{os.getpid()}-{time.time_ns():x}.parquet"
            path, unfinished = self.folder / _TRIALS / name, self.folder / f".{name}"
            try:
                parquet.write_table(arrow.Table.from_pylist(complete, COLUMNS), unfinished)
                os.replace(unfinished, path)
            except OSError as error:
                raise OutputError(f"cannot write {str(path)!r}: {error.strerror or error}") from error
            self._waiting = []
        self._written = time.monotonic()

    def rows(self, columns: Sequence[str] | None = None) -> list[Row]:
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


def read_rows(folder: str | Path, columns: Sequence[str] | None = None) -> list[Row]:
    """Rows of a study's folder, in the order of the trials; each trial and method once.

    Raises:
        RecordingError: the folder is no study, or a part of it cannot be read.
    """
    folder = Path(folder)
    _read_header(folder)
    rows: dict[tuple[int, str], Row] = {}
    for path in sorted((folder / _TRIALS).glob("part-*.parquet")):
        try:
            table = parquet.read_table(path, columns=None if columns is None else list(columns))
        except (OSError, ValueError) as error:  # ArrowInvalid is a ValueError
            raise RecordingError(f"{str(path)!r} is damaged ({error}); remove it and its trials run again") from error
        for row in cast("list[Row]", table.to_pylist()):
            rows.setdefault((row["trial"], row["method"]), row)
    return [rows[key] for key in sorted(rows)]


def _read_header(folder: Path) -> dict[str, Any]:
    try:
        table = json.loads((folder / _HEADER).read_text(encoding="utf-8"))
    except OSError as error:
        raise RecordingError(f"{str(folder)!r} is no Monte Carlo study: {error.strerror}") from error
    except ValueError as error:
        raise RecordingError(f"{_HEADER} in {str(folder)!r} is not JSON: {error}") from error
    if not isinstance(table, dict) or cast("dict[str, Any]", table).get("schema") != SCHEMA:
        raise RecordingError(f"{_HEADER} in {str(folder)!r} is no {SCHEMA!r}")
    return cast("dict[str, Any]", table)
