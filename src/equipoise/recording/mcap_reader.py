"""Messages out of an MCAP file, also of one that a killed process left behind."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Schema
from mcap.stream_reader import get_chunk_data_stream
from numpy.typing import NDArray

from equipoise.errors import RecordingError
from equipoise.recording.mcap_writer import MAGIC
from equipoise.user_file import read_bytes, refuse_unreadable

_MESSAGE_HEAD = 22  # bytes: channel, sequence number and two times
_FRAME = 9  # bytes: the opcode and the length that every record begins with
_KIND = _FRAME + 2  # bytes: opcode, length and channel, which messages of one kind and length share
_RECEIVED = _KIND + 4  # bytes before a message's time of receipt: a sequence number too
_LONGEST_TURN = 64  # messages
_RUN = 1 << 20  # bytes
_NO_DATA = 64  # bytes: so many zeros at the end are what a power cut left in place of data


@dataclass(frozen=True)
class McapContent:
    """What is in a file.

    Attributes:
        channels: metadata of each channel, by topic.
        messages: topics and bodies, in the order in which they were written.
        closed: whether the file was closed; else it ends where the process that wrote it was killed.
    """

    channels: Mapping[str, Mapping[str, str]]
    messages: list[tuple[str, bytes]]
    closed: bool


def read_mcap(path: Path) -> McapContent:
    """Read a file. One that was cut anywhere is read as far as its last whole chunk.

    Raises:
        RecordingError: it is missing, damaged, or no MCAP file.
    """
    try:
        data = read_bytes(path)
    except OSError as error:
        raise RecordingError(f"the recording {str(path)!r} cannot be read: {error.strerror}") from error
    if not data.startswith(MAGIC[: len(data)]):
        raise RecordingError(f"the recording {str(path)!r} cannot be read: it is no MCAP file")
    try:
        return _read(data)
    except Exception as error:  # damaged files fail in many ways, in several libraries, not all of them typed
        raise RecordingError(f"the recording {str(path)!r} is damaged: {error or repr(error)}") from error


def was_closed(path: Path) -> bool:
    """Whether a file was closed; else its writer was killed, or a copy of it broke off. Looks at its end alone."""
    try:
        refuse_unreadable(path)
        with open(path, "rb") as file:
            size = file.seek(0, os.SEEK_END)
            file.seek(max(size - len(MAGIC), 0))
            return size > len(MAGIC) and file.read() == MAGIC
    except OSError as error:
        raise RecordingError(f"the recording {str(path)!r} cannot be read: {error.strerror}") from error


def _read(data: bytes) -> McapContent:
    topics: dict[int, str] = {}
    channels: dict[str, Mapping[str, str]] = {}
    messages: list[tuple[str, bytes]] = []
    closed = False
    for opcode, content in _unpacked(_whole_records(data)):
        if opcode == Opcode.MESSAGE:
            messages.append((topics[int.from_bytes(content[:2], "little")], content[_MESSAGE_HEAD:]))
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(ReadDataStream(BytesIO(content)))
            topics[channel.id], channels[channel.topic] = channel.topic, channel.metadata
        elif opcode == Opcode.FOOTER:
            closed = True
            break
    if not closed and len(data) > len(MAGIC) and data.endswith(MAGIC):
        raise RecordingError("it was closed, and lacks records that it must have had")
    return McapContent(channels, messages, closed)


@dataclass(frozen=True, eq=False)
class Run:
    """Messages of a topic that follow each other and are equally long.

    Attributes:
        topic, type: topic of the messages, and their type.
        received: (n,) times of receipt [ns].
        bodies: (n, length) bytes of each.
    """

    topic: str
    type: str
    received: NDArray[np.int64]
    bodies: NDArray[np.uint8]


def message_runs(path: Path) -> Iterator[Run]:
    """The messages of a file that was closed, each topic's in the order in which they were written.

    No more than a chunk of the file is in memory, and nothing is made of a message but its bytes. Recorders write the same few
    topics by turns: the lengths of one turn are walked, and all turns like it are taken as rows of one array.
    """
    types: dict[int, str] = {}
    channels: dict[int, tuple[str, str]] = {}
    with open(path, "rb") as file:
        file.seek(len(MAGIC))
        for records in _runs(file):
            yield from _message_runs(records, types, channels)


def _message_runs(records: bytes, types: dict[int, str], channels: dict[int, tuple[str, str]]) -> Iterator[Run]:
    """The messages among records; what their schemas and channels are is noted."""
    data, position = np.frombuffer(records, dtype=np.uint8), 0
    while position + _FRAME <= len(records):
        turn = _turn(records, position)
        if turn:
            begin, position, heads = position, turn[-1][1], [at - position for at, _ in turn]
            count = _turns(data[begin:], position - begin, heads)
            rows = data[begin : begin + count * (position - begin)].reshape(count, -1)
            of_channel: dict[int, list[slice]] = {}
            for (start, end), head in zip(turn, heads, strict=True):
                channel = int.from_bytes(records[start + _FRAME : start + _KIND], "little")
                of_channel.setdefault(channel, []).append(slice(head, end - begin))
            for channel, parts in of_channel.items():
                # Copies, turn by turn: in the order in which they were written, and not the whole chunk with them.
                whole = np.stack([rows[:, part] for part in parts], axis=1).reshape(count * len(parts), -1)
                received = np.ascontiguousarray(whole[:, _RECEIVED : _RECEIVED + 8]).view("<i8")[:, 0]
                yield Run(*channels[channel], received, whole[:, _FRAME + _MESSAGE_HEAD :])
            position = begin + count * (position - begin)
            continue
        opcode, length = struct.unpack_from("<BQ", records, position)
        content = records[position + _FRAME : position + _FRAME + length]
        position += _FRAME + length
        _check_within(position, length, records)
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(ReadDataStream(BytesIO(content)))
            types[schema.id] = schema.name
        elif opcode == Opcode.CHANNEL:
            made = Channel.read(ReadDataStream(BytesIO(content)))
            channels[made.id] = made.topic, types.get(made.schema_id, "")


def _turn(records: bytes, position: int) -> list[tuple[int, int]]:
    """Begin and end of consecutive messages from a place on, until one is of the first one's kind and length again.

    All of a channel in it are equally long: of others the order would be lost.
    """
    turn: list[tuple[int, int]] = []
    kinds: dict[bytes, bytes] = {}
    first = records[position : position + _KIND]
    while len(turn) < _LONGEST_TURN and len(records) >= position + _FRAME + _MESSAGE_HEAD:
        kind = records[position : position + _KIND]
        if kind[0] != Opcode.MESSAGE or (turn and kind == first) or kinds.setdefault(kind[_FRAME:], kind) != kind:
            break
        length = int.from_bytes(kind[1:_FRAME], "little")
        _check_within(position + _FRAME + length, length, records)
        turn.append((position, position + _FRAME + length))
        position += _FRAME + length
    return turn


def _turns(data: NDArray[np.uint8], length: int, heads: Sequence[int]) -> int:
    """Number of turns of that length with the same kinds of messages, at the beginning of data."""
    rows = data[: len(data) // length * length].reshape(-1, length)
    same = np.ones(len(rows), dtype=bool)
    for head in heads:
        kinds = rows[:, head : head + _KIND]
        same &= (kinds == kinds[0]).all(axis=1)
    return len(rows) if same.all() else int(np.argmin(same))


def _check_within(end: int, length: int, records: bytes) -> None:
    if end > len(records):
        raise RecordingError(f"a record of {length} bytes is longer than what holds it")


def _runs(file: BinaryIO) -> Iterator[bytes]:
    """Whole records in runs: those of a chunk, or those between two chunks."""
    outside = bytearray()
    while len(head := file.read(_FRAME)) == _FRAME:
        opcode, length = struct.unpack("<BQ", head)
        if opcode == Opcode.FOOTER:
            break
        content = file.read(length)
        if opcode != Opcode.CHUNK:
            outside += head + content
        if outside and (opcode == Opcode.CHUNK or len(outside) > _RUN):
            yield bytes(outside)
            outside.clear()
        if opcode == Opcode.CHUNK:
            yield _of_chunk(content)
    yield bytes(outside)


class McapTail:
    """Reads a file while another process writes it.

    Attributes:
        channels: metadata of each channel, by topic, as far as they were read.
        closed: whether the end of the file was read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.channels: dict[str, Mapping[str, str]] = {}
        self.closed = False
        self._topics: dict[int, str] = {}
        self._position = 0
        self._file_number: int | None = None

    @property
    def replaced(self) -> bool:
        """Whether another file has taken the place of the one that is read, as when a run is gone on with."""
        try:
            return self._file_number is not None and self.path.stat().st_ino != self._file_number
        except OSError:
            return False

    def read(self) -> list[tuple[str, bytes]]:
        """Topic and body of the messages written since the last call; none if there is no file yet.

        Raises:
            RecordingError: it is damaged, or no MCAP file.
        """
        try:
            refuse_unreadable(self.path)
            with open(self.path, "rb") as file:
                self._file_number = os.fstat(file.fileno()).st_ino
                file.seek(self._position)
                data = file.read()
        except FileNotFoundError:
            return []
        except OSError as error:
            raise RecordingError(f"the recording {str(self.path)!r} cannot be read: {error.strerror}") from error
        if self._position == 0:
            if not data.startswith(MAGIC[: len(data)]):
                raise RecordingError(f"the recording {str(self.path)!r} cannot be read: it is no MCAP file")
            if len(data) < len(MAGIC):
                return []
            self._position, data = len(MAGIC), data[len(MAGIC) :]
        try:
            return self._take(data)
        except Exception as error:  # see `read_mcap`
            raise RecordingError(f"the recording {str(self.path)!r} is damaged: {error or repr(error)}") from error

    def _take(self, data: bytes) -> list[tuple[str, bytes]]:
        records = list(_records(data, 0))
        self._position += sum(_FRAME + len(content) for _, content in records)
        messages: list[tuple[str, bytes]] = []
        for opcode, content in _unpacked(iter(records)):
            if opcode == Opcode.MESSAGE:
                messages.append((self._topics[int.from_bytes(content[:2], "little")], content[_MESSAGE_HEAD:]))
            elif opcode == Opcode.CHANNEL:
                channel = Channel.read(ReadDataStream(BytesIO(content)))
                self._topics[channel.id], self.channels[channel.topic] = channel.topic, channel.metadata
            self.closed = self.closed or opcode == Opcode.FOOTER
        return messages


def _whole_records(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Opcode and content of each whole record."""
    if data.endswith(bytes(_NO_DATA)):
        data = data.rstrip(b"\0")
    return _records(data, len(MAGIC))


def _records(data: bytes, position: int) -> Iterator[tuple[int, bytes]]:
    while position + _FRAME <= len(data):
        opcode, length = struct.unpack_from("<BQ", data, position)
        position += _FRAME + length
        if position > len(data):
            return
        yield opcode, data[position - length : position]


def _unpacked(records: Iterator[tuple[int, bytes]]) -> Iterator[tuple[int, bytes]]:
    """Records, and in place of a chunk those inside."""
    for opcode, content in records:
        if opcode == Opcode.CHUNK:
            yield from _records(_of_chunk(content), 0)
        else:
            yield opcode, content


def _of_chunk(content: bytes) -> bytes:
    """The records in a chunk."""
    chunk = Chunk.read(ReadDataStream(BytesIO(content)))
    stream, size = get_chunk_data_stream(chunk, validate_crc=True)
    return stream.read(size)
