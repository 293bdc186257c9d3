"""ROS messages of a fixed size as rows of a NumPy array, written or read many at once.

ROS 2 sends messages as CDR: four bytes for "little endian", then the fields in order, each aligned to its own size, counted
after those four bytes. Strings and sequences have a constant length for one robot, so that all messages of a stream differ
in a few numbers at fixed offsets.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from equipoise.errors import RecordingError

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


class LayoutBuilder:
    """Builder of a layout, field by field."""

    def __init__(self) -> None:
        self._template = bytearray(_LITTLE_ENDIAN)
        self._numbers: dict[str, tuple[Any, int]] = {}

    def number(self, name: str, kind: str, count: int | None = None) -> LayoutBuilder:
        """Add a number that differs between messages, or an array of several."""
        of_one = np.dtype(kind)
        field = of_one if count is None else np.dtype((kind, (count,)))
        self._align(of_one.itemsize if field.itemsize else 1)
        self._numbers[name] = (field, len(self._template))
        self._template += bytes(field.itemsize)
        return self

    def constant(self, value: float | Sequence[float], kind: str) -> LayoutBuilder:
        """Add a number, or an array of several, that is the same in all messages."""
        self._align(np.dtype(kind).itemsize)
        self._template += np.array(value, dtype=kind).tobytes()
        return self

    def text(self, text: str) -> LayoutBuilder:
        """Add a string that is the same in all messages."""
        encoded = text.encode() + b"\0"
        self.constant(len(encoded), "<u4")
        self._template += encoded
        return self

    def header(self, frame: str) -> LayoutBuilder:
        """Add a std_msgs/Header."""
        return self.number("sec", "<i4").number("nanosec", "<u4").text(frame)

    def sequence(self, name: str, count: int) -> LayoutBuilder:
        """Add a sequence of doubles that differ between messages; an empty one consists of its length."""
        return self.constant(count, "<u4").number(name, "<f8", count)

    def build(self) -> Layout:
        """Return the layout."""
        fields = np.dtype(
            {
                "names": list(self._numbers),
                "formats": [kind for kind, _ in self._numbers.values()],
                "offsets": [offset for _, offset in self._numbers.values()],
                "itemsize": len(self._template),
            }
        )
        return Layout(bytes(self._template), fields)

    def _align(self, size: int) -> None:
        self._template += bytes((len(_LITTLE_ENDIAN) - len(self._template)) % size)
