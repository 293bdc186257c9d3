"""ROS messages of a fixed size as rows of a NumPy array, written or read many at once.

ROS 2 sends messages as CDR: four bytes for "little endian", then the fields in order, each aligned to its own size, counted
after those four bytes. Strings and sequences have a constant length for one robot, so that all messages of a stream differ
in a few numbers at fixed offsets.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from equipoise.errors import RecordingError

Part = tuple[str, NDArray[Any]]
"""Part of a message: name and zeros for numbers that differ between messages, no name and its value for a constant."""

_LITTLE_ENDIAN = b"\0\1\0\0"


@dataclass(frozen=True, eq=False)
class Layout:
    """Layout of messages that differ only in numbers at fixed offsets.

    Attributes:
        template: bytes of one message, its numbers zero.
        fields: structured type of the message's size, with a field for each of its numbers.
    """

    template: bytes
    fields: np.dtype[np.void]

    def stamped(self, time: NDArray[np.int64]) -> NDArray[Any]:
        """Return (n,) messages with the times of their headers [ns], their other numbers zero."""
        rows = np.frombuffer(bytearray(self.template * len(time)), self.fields)
        rows["sec"], rows["nanosec"] = np.divmod(time, 10**9)
        return rows

    def read(self, bodies: Sequence[bytes]) -> NDArray[Any]:
        """Return (n,) messages; raises RecordingError if one of them is of another layout."""
        size = len(self.template)
        for body in bodies:
            if len(body) != size:
                raise RecordingError(f"a message of {len(body)} bytes is among messages of {size}")
        data = b"".join(bodies)
        constant = np.frombuffer(bytearray(data), self.fields)
        for name in self.fields.names or ():
            constant[name] = 0
        if constant.tobytes() != self.template * len(bodies):
            raise RecordingError("messages of one stream name different joints, or are of different types")
        return np.frombuffer(data, self.fields)


def stamps(rows: NDArray[Any]) -> NDArray[np.int64]:
    """Return (n,) times of the headers [ns]."""
    return rows["sec"].astype(np.int64) * 10**9 + rows["nanosec"].astype(np.int64)


def bodies(rows: NDArray[Any]) -> list[bytes]:
    """Return the messages one by one."""
    data, size = rows.tobytes(), rows.dtype.itemsize
    return [data[begin : begin + size] for begin in range(0, len(data), size)]


def number(name: str, kind: str, count: int | None = None) -> Part:
    """Return the part of a number that differs between messages, or of an array of several."""
    return name, np.zeros(() if count is None else count, dtype=kind)


def constant(value: float | Sequence[float], kind: str) -> Part:
    """Return the part of a number, or an array of several, that is the same in all messages."""
    return "", np.array(value, dtype=kind)


def text(words: str) -> list[Part]:
    """Return the parts of a string that is the same in all messages."""
    encoded = words.encode() + b"\0"
    return [constant(len(encoded), "<u4"), ("", np.frombuffer(encoded, "u1"))]


def header(frame: str) -> list[Part]:
    """Return the parts of a std_msgs/Header."""
    return [number("sec", "<i4"), number("nanosec", "<u4"), *text(frame)]


def sequence(name: str, count: int) -> list[Part]:
    """Return the parts of a sequence of doubles that differ between messages; an empty one consists of its length."""
    return [constant(count, "<u4"), number(name, "<f8", count)]


def layout_of(parts: Iterable[Part]) -> Layout:
    """Return the layout of a message of some parts, in order."""
    template = bytearray(_LITTLE_ENDIAN)
    fields: dict[str, tuple[np.dtype[Any], int]] = {}
    for name, value in parts:
        template += bytes((len(_LITTLE_ENDIAN) - len(template)) % value.itemsize if value.size else 0)
        if name:
            fields[name] = np.dtype((value.dtype, value.shape)), len(template)
        template += value.tobytes()
    return Layout(bytes(template), record_type(fields, len(template)))


def record_type(fields: Mapping[str, tuple[Any, int]], size: int) -> np.dtype[np.void]:
    """Return the structured type of a size [bytes] with fields, given by their types and offsets."""
    formats, offsets = ([field[place] for field in fields.values()] for place in (0, 1))
    return np.dtype({"names": list(fields), "formats": formats, "offsets": offsets, "itemsize": size})
