"""The columns of a file, whatever its kind: CSV, Parquet, NumPy's .npz and .npy, MATLAB's .mat.

An array of several columns is `q[0]`, `q[1]`...; a structure's field is `imu.gyro`. What holds no numbers, or has another
number of rows than most, is passed over. Nothing is unpickled.
"""

from __future__ import annotations

import csv
import importlib
import io
import zipfile
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from equipoise.conventions import FloatArray
from equipoise.errors import MissingDependencyError, RecordingError

_Named = list[tuple[str, NDArray[Any]]]
_WIDEST = 64  # columns of an array: pictures have more, and logs are longer


@dataclass(frozen=True, eq=False)
class TableFile:
    """A file of columns; a column becomes numbers when it is asked for.

    Attributes:
        path: path of the file.
        names: names of its columns, in their order.
        read: (n,) numbers of a column by its index; whole numbers stay so.
        passed_over: what else is in the file, as "video (100, 3, 64)".
    """

    path: Path
    names: tuple[str, ...]
    read: Callable[[int], NDArray[Any]]
    passed_over: tuple[str, ...] = ()

    def refuse_twins(self, names: Iterable[str]) -> None:
        """Raise RecordingError if two columns have one of some names."""
        for name in names:
            if self.names.count(name) > 1:
                raise RecordingError(f"the table {str(self.path)!r} has the column {name!r} twice")

    def column(self, name: str) -> FloatArray:
        """(n,) a column; cells without a number are NaN.

        Raises:
            RecordingError: a cell holds something else.
        """
        return np.asarray(self.read(self.names.index(name)), dtype=float)

    def clock(self, name: str) -> FloatArray:
        """(n,) a column of times; whole numbers are after their first: floats hold nanoseconds since 1970 to some 256."""
        values = self.read(self.names.index(name))
        if values.dtype.kind not in "iu":
            return np.asarray(values, dtype=float)
        signed = values.astype(np.int64)  # a stamp may be less than the first
        return np.asarray(signed - signed[:1], dtype=float)


def open_table(path: Path) -> TableFile:
    """The columns of a file.

    Raises:
        RecordingError: it cannot be read, or holds no columns of numbers.
        MissingDependencyError: Parquet needs pyarrow.
    """
    return _OPEN[path.suffix.lower()](path)


# --- CSV


def _open_csv(path: Path) -> TableFile:
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
    counted = [cell.strip() for cell in rows[0]] in (_count(rows[0], 0), _count(rows[0], 1))  # as pandas names columns
    nameless = all(map(_is_number, rows[0])) and not counted
    names = [f"[{index}]" if nameless else cell.strip() for index, cell in enumerate(rows[0])]
    for number, row in enumerate(rows, 1):
        if len(row) != len(names):
            raise RecordingError(
                f"line {number} of {str(path)!r} has {len(row)} cells; its first line {'has' if nameless else 'names'} "
                f"{len(names)}"
            )
    first = 0 if nameless else 1
    cells = list(zip(*rows[first:], strict=True))
    return TableFile(path, tuple(names), lambda index: _numbers(path, names[index], cells[index], first + 1))


def _count(cells: Sequence[str], first: int) -> list[str]:
    return [str(first + index) for index in range(len(cells))]


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _numbers(path: Path, name: str, cells: Sequence[str], first_line: int) -> FloatArray:
    """A column's numbers; empty cells are not numbers (NaN)."""
    try:
        return np.array([cell if cell.strip() else "nan" for cell in cells], dtype=float)
    except ValueError:
        wrong = ((line, cell) for line, cell in enumerate(cells, first_line) if not _is_number(cell.strip() or "nan"))
        line, cell = next(wrong)
        raise RecordingError(
            f"{cell!r} in column {name!r}, line {line} of {str(path)!r} is no number (decimal points, no units)"
        ) from None


# --- Parquet


def _open_parquet(path: Path) -> TableFile:
    try:
        pa: Any = importlib.import_module("pyarrow")
        pq: Any = importlib.import_module("pyarrow.parquet")
    except ModuleNotFoundError as error:
        raise MissingDependencyError(
            f"the Parquet log {str(path)!r} needs pyarrow: pip install 'equipoise[parquet]'"
        ) from error
    try:
        table: Any = pq.read_table(path)
    except (OSError, pa.ArrowException) as error:
        raise RecordingError(f"the log {str(path)!r} cannot be read as Parquet: {_told(error)}") from error
    names = tuple(table.column_names)

    def read(index: int) -> NDArray[Any]:
        column: Any = table.column(index)
        try:
            if pa.types.is_timestamp(column.type):
                return _seconds(column.cast(pa.timestamp("ns")).cast(pa.int64()))
            if pa.types.is_integer(column.type) and not column.null_count:
                return np.asarray(column.to_numpy())
            return np.asarray(column.cast(pa.float64(), safe=False).fill_null(np.nan).to_numpy(), dtype=float)
        except pa.ArrowException as error:
            what = f"column {names[index]!r} of {str(path)!r} holds no numbers"
            raise RecordingError(f"{what}: {_told(error)}") from error

    return TableFile(path, names, read)


def _seconds(stamps: Any) -> FloatArray:
    """Nanoseconds of Parquet's own time stamps, after the first [s]."""
    whole = np.asarray(stamps.fill_null(0).to_numpy(), dtype=np.int64)
    return np.where(stamps.is_null().to_numpy(), np.nan, (whole - whole[:1]) * 1e-9)


# --- arrays


def _open_numpy(path: Path) -> TableFile:
    try:
        arrays, pickled = _numpy_arrays(path)
    except (ValueError, OSError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        if _of_objects(error) or path.read_bytes()[:1] == b"\x80":  # with which pickles begin
            raise RecordingError(pickle_refused(path)) from error
        # NumPy takes what begins as no format of its own to be a pickle, and tells how to run what is in it.
        why = "" if "allow_pickle" in str(error) else f" ({_told(error)})"
        raise RecordingError(
            f"the log {str(path)!r} cannot be read: it is damaged, or no {path.suffix.lower()} file{why}; "
            "copy or save it again"
        ) from error
    return _of_arrays(path, arrays, pickled)


def _numpy_arrays(path: Path) -> tuple[_Named, list[str]]:
    """The arrays of a file, whichever of its two kinds it is, and the names of those of objects."""
    arrays: _Named = []
    pickled: list[str] = []
    with path.open("rb") as file:
        loaded: Any = np.load(file, allow_pickle=False)
        if isinstance(loaded, np.ndarray):
            return [("", loaded)], []
        for name in loaded.files:
            try:
                arrays.append((name, loaded[name]))
            except ValueError as error:
                if not _of_objects(error):
                    raise
                pickled.append(name)
    return arrays, pickled


def _of_objects(error: Exception) -> bool:
    return "Object arrays cannot be loaded" in str(error)


def _open_mat(path: Path) -> TableFile:
    loadmat: Any = importlib.import_module("scipy.io").loadmat
    try:
        held: dict[str, Any] = loadmat(path, simplify_cells=True)
    except NotImplementedError as error:
        raise RecordingError(
            f"the log {str(path)!r} is MATLAB's version 7.3, which is not read: save it again with "
            "save(file, '-struct', 'log', '-v7')"
        ) from error
    arrays: _Named = []
    for name, value in held.items():
        if not name.startswith("__"):
            _flatten(name, value, arrays)
    return _of_arrays(path, arrays, [])


def _flatten(name: str, value: Any, into: _Named) -> None:
    """A structure's fields as arrays."""
    if isinstance(value, Mapping):
        for key, part in value.items():  # pyright: ignore[reportUnknownVariableType]
            _flatten(f"{name}.{key}", part, into)
    else:
        into.append((name, np.asarray(value)))


def _of_arrays(path: Path, arrays: _Named, passed_over: list[str]) -> TableFile:
    """Those of numbers, along the axis that most of them share."""
    fields = [part for name, array in arrays for part in _fields(name, array)]
    usable = [(name, np.squeeze(array)) for name, array in fields if array.dtype.kind in "fiu"]
    rows = _samples(path, usable)
    columns: dict[str, NDArray[Any]] = {}
    sampled = [(name, array) for name, array in usable if rows in array.shape]
    for name, array in sampled:
        if array.size > _WIDEST * rows and len(sampled) > 1:
            continue
        table = np.moveaxis(array, array.shape.index(rows), 0).reshape(rows, -1)
        many = array.ndim > 1
        columns |= {f"{name}[{k}]" if many else name: table[:, k] for k in range(table.shape[1])}
    kept = {name.split("[")[0] for name in columns}
    others = [f"{name} {array.shape}" for name, array in fields if name not in kept and array.ndim]
    if not columns:
        held = ", ".join([*others, *passed_over]) or "nothing at all"
        raise RecordingError(f"the log {str(path)!r} holds no arrays of numbers; it holds {held}")
    names, values = tuple(columns), list(columns.values())
    return TableFile(path, names, lambda index: values[index], (*others, *passed_over))


def _samples(path: Path, arrays: _Named) -> int:
    """The length that most arrays have along their longest axis; short ones are gains or limits."""
    by_length: dict[int, list[str]] = {}
    for name, array in arrays:
        if array.ndim:
            by_length.setdefault(max(array.shape), []).append(name)
    rows = max(by_length, key=lambda length: (length > _WIDEST, len(by_length[length]), length), default=0)
    rivals = [length for length, names in by_length.items() if len(names) == len(by_length[rows]) and length > _WIDEST]
    if len(rivals) > 1:
        told = " and ".join(f"{length} samples ({', '.join(by_length[length])})" for length in rivals)
        raise RecordingError(
            f"the log {str(path)!r} has arrays of {told}, and a table has one length: interpolate them at one clock, or write "
            "a CSV in which a row of one leaves the cells of the other empty"
        )
    return rows


def _fields(name: str, array: NDArray[Any]) -> _Named:
    """A structured array's fields by their names."""
    if array.dtype.names is None:
        return [(name, array)]
    return [(f"{name}.{field}".lstrip("."), array[field]) for field in array.dtype.names]


def pickle_refused(path: Path) -> str:
    """Return why a file of Python objects is not opened, and what to do instead."""
    load = {".pt": "torch.load(FILE)", ".pth": "torch.load(FILE)", ".npy": "numpy.load(FILE, allow_pickle=True).item()"}
    loaded = load.get(path.suffix.lower(), "pickle.load(open(FILE, 'rb'))")
    return (
        f"the log {str(path)!r} holds Python objects, and whoever opens it runs what is in them: it is not read. If you trust "
        f"it, convert it: log = {loaded.replace('FILE', repr(path.name))}; numpy.savez({path.with_suffix('.npz').name!r}, "
        "time=..., q=..., dq=..., tau=..., gyro=..., acc=...), each an array of numbers with a row a sample"
    )


def _told(error: Exception) -> str:
    return str(getattr(error, "strerror", None) or error).split("\n", maxsplit=1)[0]


_OPEN: dict[str, Callable[[Path], TableFile]] = {
    ".csv": _open_csv,
    ".parquet": _open_parquet,
    ".npz": _open_numpy,
    ".npy": _open_numpy,
    ".mat": _open_mat,
}
SUFFIXES = tuple(_OPEN)
PICKLES = (".pkl", ".pickle", ".p", ".pt", ".pth", ".joblib")
"""Files that hold Python objects, and code with them."""
