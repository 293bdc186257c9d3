"""Columns of a file: CSV, JSON lines, Parquet, NumPy's .npz and .npy, MATLAB's .mat.

An array of several columns is `q[0]`, `q[1]`...; a structure's field is `imu.gyro`. Arrays without numbers, or with another
number of rows than most, are skipped. Nothing is unpickled. Files may be compressed by gzip.
"""

from __future__ import annotations

import csv
import gzip
import importlib
import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO, Any, cast

import numpy as np
from numpy.typing import NDArray

from equipoise.conventions import FloatArray
from equipoise.errors import EquipoiseError, MissingDependencyError, RecordingError
from equipoise.logs.tables.by_name import two_part_stamps
from equipoise.logs.tables.column_names import leaves
from equipoise.user_file import json_value

_Named = list[tuple[str, NDArray[Any]]]
_WIDEST = 64  # columns of an array: images have more, and logs are longer
_EPOCH = np.datetime64(0, "ns")


@dataclass(frozen=True, eq=False)
class TableFile:
    """File of columns, or several that are joined; a column is converted to numbers when it is read.

    Attributes:
        title: name in messages, as "the table 'log.csv'".
        rows: number of rows.
        names: names of its columns, in their order.
        read: (n,) numbers of a column by its index; integers and time stamps keep their type.
        passed_over: other contents of the file, as "video (100, 3, 64)".
        texts: cells of the columns that hold texts, by name.
    """

    title: str
    rows: int
    names: tuple[str, ...]
    read: Callable[[int], NDArray[Any]]
    passed_over: tuple[str, ...] = ()
    texts: Mapping[str, Iterable[str]] = field(default_factory=dict[str, Iterable[str]])

    def column(self, name: str) -> FloatArray:
        """Return (n,) a column; cells without a number are NaN, and time stamps are seconds since 1970.

        Raises:
            RecordingError: a cell holds something else.
        """
        values = self.read(self.names.index(name))
        return _seconds(values, _EPOCH) if values.dtype.kind == "M" else np.asarray(values, dtype=float)

    def clock(self, name: str) -> FloatArray:
        """Return (n,) a column of times; integers are relative to the first, since floats round nanoseconds since 1970."""
        values = self.read(self.names.index(name))
        if values.dtype.kind == "M":
            return _seconds(values, min(values[~np.isnat(values)], default=_EPOCH))
        if values.dtype.kind not in "iu":
            return np.asarray(values, dtype=float)
        signed = values.astype(np.int64)  # a stamp may be less than the first
        return np.asarray(signed - signed[:1], dtype=float)

    def text(self, name: str) -> str | None:
        """Return the one text in a column's cells, or None if it holds none.

        Raises:
            RecordingError: there are several.
        """
        texts = sorted(set(filter(str.strip, self.texts.get(name, ()))))
        if len(texts) > 1:
            raise RecordingError(
                f"column {name!r} of {self.title} names {texts[0]!r} in some rows and {texts[1]!r} in others: a column must "
                "belong to one joint; split the log"
            )
        return texts[0] if texts else None


def suffix_of(path: Path) -> str:
    """Return the suffix of a path in lower case without the dot: the one before .gz if it is a table's."""
    suffix, inner = (Path(name).suffix.lower().removeprefix(".") for name in (path.name, path.stem))
    return inner if suffix == "gz" and inner in _OPEN else suffix


def open_table(path: Path) -> TableFile:
    """Return the columns of a file, with a clock where it has one in two columns.

    Raises:
        RecordingError: it cannot be read, or holds no columns of numbers.
        MissingDependencyError: Parquet needs pyarrow.
    """
    try:
        with path.open("rb") as file:
            stream = cast("IO[bytes]", gzip.GzipFile(fileobj=file)) if path.suffix.lower() == ".gz" else file
            return _with_clocks(_OPEN[suffix_of(path)](path, stream))
    except EquipoiseError:
        raise
    except Exception as error:  # damaged files fail in many ways in several libraries
        raise RecordingError(
            f"the log {str(path)!r} cannot be read: it is damaged, or not a .{suffix_of(path)} file ({_first_line(error)}); "
            "copy or save it again"
        ) from error


def _with_clocks(file: TableFile) -> TableFile:
    """Return a table with a column of time stamps before the others for each clock that is in two columns."""
    clocks = two_part_stamps(file.names)

    def read(index: int) -> NDArray[Any]:
        if index >= len(clocks):
            return file.read(index - len(clocks))
        seconds, rest, unit = [*clocks.values()][index]
        whole, remainder = file.column(seconds), np.round(1e9 * unit * file.column(rest))
        if (largest := np.nan_to_num(remainder).max(initial=0)) >= 1e9:
            raise RecordingError(
                f"{rest!r} of {file.title} reaches {1e-9 * largest:g} s, and next to {seconds!r} it should be below a "
                f"second: if it is the whole time, write time = {rest!r} into a file for --columns"
            )
        valid = np.isfinite(whole + remainder)
        stamps = np.where(valid, whole, 0).astype(np.int64) * 10**9 + np.where(valid, remainder, 0).astype(np.int64)
        return np.where(valid, stamps.astype("datetime64[ns]"), np.datetime64("NaT"))

    return replace(file, names=(*clocks, *file.names), read=read) if clocks else file


def _seconds(stamps: NDArray[Any], start: np.datetime64) -> FloatArray:
    return np.asarray((stamps - start) / np.timedelta64(1, "s"), dtype=float)


# --- texts and JSON lines


def _open_text(path: Path, stream: IO[bytes]) -> TableFile:
    """Read lines of cells between commas, semicolons, tabs or spaces; a comment before them may name the columns."""
    lines = stream.read().decode("utf-8-sig").splitlines()
    first = next((at for at, line in enumerate(lines) if line.strip() and line.lstrip()[0] not in "#%"), len(lines))
    head = "".join(lines[first : first + 1])
    delimiter = max(",;\t", key=head.count) if any(map(head.count, ",;\t")) else " "
    remarks = [line.lstrip("# ").removeprefix("% ") for line in lines[:first]]
    body = ["" if line.startswith("#") else line for line in lines[first:]]
    names = [row for _, row in _cells(remarks, delimiter)][-1:]
    rows = [(first + number, row) for number, row in _cells(body, delimiter)]
    return _of_cells(path, *_with_names(names, rows))


def _cells(lines: Iterable[str], delimiter: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the cells of lines that are not empty, with the numbers of the lines."""
    stripped = (line.strip(" ") if delimiter == " " else line for line in lines)
    reader = csv.reader(stripped, delimiter=delimiter, skipinitialspace=True)
    return ((reader.line_num, row) for row in reader if row)


def _with_names(
    remark: list[list[str]], rows: list[tuple[int, list[str]]]
) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Return the names of columns and the rows of numbers.

    Args:
        remark: cells of the last remark before the rows, if there is one.
    """
    head = rows[0][1] if rows else []
    if remark and head and len(remark[0]) == len(head) and _is_number(head[0]):
        return remark[0], rows
    counted = head in ([*map(str, range(first, first + len(head)))] for first in (0, 1))  # as pandas names columns
    if all(map(_is_number, head)) and not counted:
        return [f"[{index}]" for index in range(len(head))], rows
    return [cell.strip() for cell in head], rows[1:]


def _open_json_lines(path: Path, stream: IO[bytes]) -> TableFile:
    """Read one object per line; nested values are named by their path, as `imu.gyro[0]`."""
    found: list[tuple[int, dict[str, Any]]] = []
    for number, line in enumerate(stream, 1):
        try:
            found += [(number, dict(leaves("", json_value(line.decode()))))] if line.strip() else []
        except ValueError as error:
            raise RecordingError(f"line {number} of {str(path)!r} is not JSON: {error}") from error
    names = [*dict.fromkeys(itertools.chain.from_iterable(of for _, of in found))]
    rows = [(number, ["" if of.get(name) is None else str(of[name]) for name in names]) for number, of in found]
    return _of_cells(path, names, rows)


def _of_cells(path: Path, names: Sequence[str], rows: Sequence[tuple[int, Sequence[str]]]) -> TableFile:
    """Return the table of rows of cells, which come with the numbers of their lines."""
    if not rows or not names:
        raise RecordingError(
            f"the log {str(path)!r} holds no samples: it must have a line of column names and then numbers"
        )
    for number, row in rows:
        if len(row) != len(names):
            raise RecordingError(
                f"line {number} of {str(path)!r} has {len(row)} cells; its first line names {len(names)} columns"
            )
    lines, cells = [number for number, _ in rows], list(zip(*(row for _, row in rows), strict=True))
    texts = {
        name: of for name, of in zip(names, cells, strict=True) if not _is_number(next(filter(str.strip, of), "0"))
    }
    return TableFile(
        f"the table {str(path)!r}", len(rows), tuple(names), lambda index: _numbers(path, names[index], cells[index], lines),
        texts=texts,
    )  # fmt: skip


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _numbers(path: Path, name: str, cells: Sequence[str], lines: Sequence[int]) -> FloatArray:
    """Return a column's numbers; empty cells are NaN."""
    try:
        return np.array([cell if cell.strip() else "nan" for cell in cells], dtype=float)
    except ValueError:
        wrong = ((line, cell) for line, cell in zip(lines, cells, strict=True) if not _is_number(cell.strip() or "nan"))
        line, cell = next(wrong)
        raise RecordingError(
            f"{cell!r} in column {name!r}, line {line} of {str(path)!r} is not a number (decimal points, no units)"
        ) from None


# --- Parquet


def _open_parquet(path: Path, stream: IO[bytes]) -> TableFile:
    try:
        pa: Any = importlib.import_module("pyarrow")
        pq: Any = importlib.import_module("pyarrow.parquet")
    except ModuleNotFoundError as error:
        raise MissingDependencyError(
            f"the Parquet log {str(path)!r} needs pyarrow: pip install 'equipoise[parquet]'"
        ) from error
    table: Any = pq.read_table(stream)
    names = tuple(table.column_names)

    def read(index: int) -> NDArray[Any]:
        column: Any = table.column(index)
        try:
            if pa.types.is_timestamp(column.type):
                return np.asarray(column.cast(pa.timestamp("ns")).to_numpy())
            if pa.types.is_integer(column.type) and not column.null_count:
                return np.asarray(column.to_numpy())
            return np.asarray(column.cast(pa.float64(), safe=False).fill_null(np.nan).to_numpy(), dtype=float)
        except pa.ArrowException as error:
            what = f"column {names[index]!r} of {str(path)!r} holds no numbers"
            raise RecordingError(f"{what}: {_first_line(error)}") from error

    texts = {
        name: [cell or "" for cell in table.column(index).unique().to_pylist()]
        for index, name in enumerate(names)
        if pa.types.is_string(table.column(index).type)
    }
    return TableFile(f"the table {str(path)!r}", table.num_rows, names, read, texts=texts)


# --- arrays


def _open_numpy(path: Path, stream: IO[bytes]) -> TableFile:
    try:
        arrays, pickled = _numpy_arrays(stream)
    except ValueError as error:
        if _of_objects(error) or path.read_bytes()[:1] == b"\x80":  # with which pickles begin
            raise RecordingError(pickle_refused(path)) from error
        # NumPy takes an unknown format for a pickle, and its message explains how to load one.
        raise ValueError("it holds no arrays") from error
    return _of_arrays(path, arrays, pickled)


def _numpy_arrays(stream: IO[bytes]) -> tuple[_Named, list[str]]:
    """Return the arrays of a file of either kind, and the names of the arrays of objects."""
    arrays: _Named = []
    pickled: list[str] = []
    loaded: Any = np.load(stream, allow_pickle=False)
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


def _open_mat(path: Path, stream: IO[bytes]) -> TableFile:
    loadmat: Any = importlib.import_module("scipy.io").loadmat
    try:
        held: dict[str, Any] = loadmat(stream, simplify_cells=True)
    except NotImplementedError as error:
        raise RecordingError(
            f"the log {str(path)!r} is MATLAB's version 7.3, which is not read: save it again with "
            "save(file, '-struct', 'log', '-v7')"
        ) from error
    arrays = [(name, np.asarray(value)) for name, value in leaves("", held) if not name.startswith("__")]
    return _of_arrays(path, arrays, [])


def _of_arrays(path: Path, arrays: _Named, passed_over: list[str]) -> TableFile:
    """Return the table of the arrays of numbers, along the axis that most of them share."""
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
    values = list(columns.values())
    words = [(name, array.ravel()) for name, array in fields if array.size <= _WIDEST and _of_texts(array)]
    texts = {f"{name}[{k}]": [str(word).strip()] for name, array in words for k, word in enumerate(array)}
    title, names = f"the table {str(path)!r}", tuple(columns)
    return TableFile(title, rows, names, lambda index: values[index], (*others, *passed_over), texts)


def _of_texts(array: NDArray[Any]) -> bool:
    return all(isinstance(one, str) for one in array.flat)


def _samples(path: Path, arrays: _Named) -> int:
    """Return the length that most arrays have along their longest axis; short ones are gains or limits."""
    by_length: dict[int, list[str]] = {}
    for name, array in arrays:
        if array.ndim:
            by_length.setdefault(max(array.shape), []).append(name)
    rows = max(by_length, key=lambda length: (length > _WIDEST, len(by_length[length]), length), default=0)
    rivals = [length for length, names in by_length.items() if len(names) == len(by_length[rows]) and length > _WIDEST]
    if len(rivals) > 1:
        lengths = " and ".join(f"{length} samples ({', '.join(by_length[length])})" for length in rivals)
        raise RecordingError(
            f"the log {str(path)!r} has arrays of {lengths}, and a table has one length: save those of each length "
            "in a separate file with their time, and name all files"
        )
    return rows


def _fields(name: str, array: NDArray[Any]) -> _Named:
    """Return a structured array's fields by their names."""
    if array.dtype.names is None:
        return [(name, array)]
    return [(f"{name}.{field}".lstrip("."), array[field]) for field in array.dtype.names]


def pickle_refused(path: Path) -> str:
    """Return why a file of Python objects is not opened, and what to do instead."""
    load = {".pt": "torch.load(FILE)", ".pth": "torch.load(FILE)", ".npy": "numpy.load(FILE, allow_pickle=True).item()"}
    loaded = load.get(path.suffix.lower(), "pickle.load(open(FILE, 'rb'))")
    return (
        f"the log {str(path)!r} holds Python objects, which can run code when they are loaded: it is not read. If its "
        f"source is reliable, convert it: log = {loaded.replace('FILE', repr(path.name))}; "
        f"numpy.savez({path.with_suffix('.npz').name!r}, time=..., q=..., "
        "dq=..., tau=..., gyro=..., acc=...), each an array of numbers with one row per sample"
    )


def _first_line(error: Exception) -> str:
    return str(getattr(error, "strerror", None) or error).split("\n", maxsplit=1)[0]


_OPEN: dict[str, Callable[[Path, IO[bytes]], TableFile]] = {
    **dict.fromkeys(("csv", "tsv", "dat", "txt"), _open_text),
    **dict.fromkeys(("jsonl", "ndjson"), _open_json_lines),
    "parquet": _open_parquet,
    **dict.fromkeys(("npz", "npy"), _open_numpy),
    "mat": _open_mat,
}
SUFFIXES = tuple(f".{suffix}" for suffix in _OPEN)
PICKLES = (".pkl", ".pickle", ".p", ".pt", ".pth", ".joblib")
"""Suffixes of files that hold Python objects, which can run code when they are loaded."""
