"""Arrow tables of trials, with a row per trial and method."""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false, reportUnknownArgumentType=false
# pyright: reportMissingTypeStubs=false, reportAttributeAccessIssue=false
# PyArrow comes without types.

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np

from equipoise.conventions import AXES, FloatArray
from equipoise.errors import MissingDependencyError
from equipoise.lab.study.study import SOURCES
from equipoise.robot.inertial import COMPONENTS

try:
    import pyarrow as arrow
    from pyarrow import compute
except ModuleNotFoundError as error:
    raise MissingDependencyError(
        "Monte Carlo studies are kept as Parquet: pip install 'equipoise[monte-carlo]'"
    ) from error

Table: TypeAlias = Any
"""`pyarrow.Table`, which comes without types."""

Row = dict[str, Any]
"""Values by column, complete or not."""

SUCCEEDED = "ok"
_INTEGERS = ("trial", "lifts", "worker")
_TEXTS = ("method", "status", "message", "log")
_NUMBERS = (
    *("robot_mass", "leg_length", "hip_height", "payload_mass", "payload_x", "payload_y", "payload_z"),
    *(f"size_{name}" for name in SOURCES),
    *("joint_zero_rms", "foot_error_rms", "imu_tilt_size"),
    *(f"{kind}_{name}" for kind in ("true", "estimated", "std") for name in COMPONENTS),
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
"""SI units; angles in rad. `true_`, `estimated_`, `std_` (posterior standard deviation) are of the whole robot."""


def table_of(rows: Sequence[Row]) -> Table:
    """Return rows as a table, with null for missing values."""
    return arrow.Table.from_pylist([{name: row.get(name) for name in COLUMNS.names} for row in rows], COLUMNS)


def column(rows: Table, name: str) -> FloatArray:
    """Return the (n,) values of a column, nan if missing."""
    if name not in rows.column_names:
        return np.full(rows.num_rows, np.nan)
    return np.asarray(rows[name].cast(arrow.float64()).to_numpy(), dtype=float)


def texts(rows: Table, name: str) -> list[str]:
    """Return the texts of a column without missing values."""
    return rows[name].to_pylist()


def having(rows: Table, name: str, text: str) -> Table:
    """Return the rows with a text in a column."""
    return rows.filter(compute.equal(rows[name], text))


def failed(rows: Table) -> int:
    """Return the number of failed calibrations."""
    return rows.num_rows - having(rows, "status", SUCCEEDED).num_rows


def in_order(tables: Sequence[Table]) -> Table:
    """Return the rows of all tables sorted by trial and method, with the first row of each trial and method."""
    rows = arrow.concat_tables(tables, promote_options="default")
    rows = rows.take(compute.sort_indices(rows, [("trial", "ascending"), ("method", "ascending")]))  # stable
    trial, method = rows["trial"].to_numpy(), np.array(texts(rows, "method"), dtype=object)
    first = np.ones(rows.num_rows, dtype=bool)
    first[1:] = (trial[1:] != trial[:-1]) | (method[1:] != method[:-1])
    return rows.filter(arrow.array(first))
