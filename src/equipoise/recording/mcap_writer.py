"""MCAP files written chunk by chunk: what was written stays readable if the process is killed.

The records are those of the `mcap` library. Its own writer takes message by message, which would cost a control loop a
millisecond or two whenever a quarter of a second of samples is written; here a chunk's messages are put together as arrays.
"""

from __future__ import annotations

import fcntl
import struct
import zlib
from collections.abc import Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Schema,
    Statistics,
    SummaryOffset,
)
from numpy.typing import NDArray

from equipoise._version import __version__
from equipoise.errors import OutputError
from equipoise.user_file import replaceable

IntArray = NDArray[np.int64]

MAGIC = b"\x89MCAP0\r\n"
"""What a file begins and ends with; `mcap.writer` has it too, and takes a twentieth of a second to import."""
_CHUNK_TIME = 10**9  # [ns] of messages in one chunk, at most
_MESSAGE = np.dtype(
    [
        ("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("sequence", "<u4"), ("log_time", "<u8"),
        ("publish_time", "<u8"),
    ]
)  # fmt: skip
"""A message record before its body."""
_FRAME = 9  # bytes: the opcode and the length that every record begins with


@dataclass(frozen=True)
class Topic:
    """What a channel carries.

    Attributes:
        name: name of the topic.
        type: type of its messages, as ROS 2 names it.
        definition: definition of the type, in ROS's own form.
        metadata: metadata of the channel.
    """

    name: str
    type: str
    definition: str
    metadata: Mapping[str, str]


@dataclass(frozen=True, eq=False)
class Batch:
    """Messages of one topic.

    Attributes:
        topic: name of the topic.
        time: (n,) increasing times [ns].
        bodies: (n) messages as CDR.
    """

    topic: str
    time: IntArray
    bodies: Sequence[bytes]


@dataclass(frozen=True, eq=False)
class Progress:
    """How far a file has been written: what somebody else has to know who goes on with it.

    Attributes:
        size: bytes of all whole writes.
        counts: messages written, by channel.
        chunks: index of the chunks behind the first `known` ones.
        known: number of chunks that are not in `chunks`.
    """

    size: int
    counts: Mapping[int, int]
    chunks: Sequence[ChunkIndex]
    known: int


class McapWriter:
    """Writes an MCAP file of the profile "ros2".

    After an error the next write begins where the last whole one ended. Two processes may write one file, by the same open
    descriptor and one at a time: who goes on tells itself how far the other came, by `progress` and `go_on_from`.

    Raises:
        OutputError: it cannot be written (no permission, disk full); also by the methods.
    """

    def __init__(self, path: Path, topics: Sequence[Topic]) -> None:
        self._describe(path, topics)
        with self._failures_told():
            replaceable(path, "the recording ")
            self._file = open(path, "wb", buffering=0)  # noqa: SIM115 - closed by `close`
            with suppress(OSError):  # file systems without locks do without
                fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        schemas, channels = self._descriptions()
        header = Header(profile="ros2", library=f"equipoise {__version__}")
        try:
            self._put(MAGIC + _encoded([header, *schemas, *channels]))
        except OutputError:
            self._file.close()
            raise

    @classmethod
    def of_descriptor(cls, descriptor: int, path: Path, topics: Sequence[Topic], progress: Progress) -> McapWriter:
        """A file that another process has opened and begun, to go on with."""
        writer = cls.__new__(cls)
        writer._describe(path, topics)
        writer._file = open(descriptor, "wb", buffering=0)  # noqa: SIM115 - closed by `close`; nothing is cut off
        writer.go_on_from(progress)
        return writer

    def _describe(self, path: Path, topics: Sequence[Topic]) -> None:
        self.path = path
        self.topics = tuple(topics)
        self._channels = {topic.name: number for number, topic in enumerate(topics, 1)}
        self._chunks: list[ChunkIndex] = []
        self._counts = dict.fromkeys(self._channels.values(), 0)
        self._size = 0

    @property
    def descriptor(self) -> int:
        """Descriptor of the open file."""
        return self._file.fileno()

    def progress(self, known: int = 0) -> Progress:
        """How far the file has been written, for somebody who knows the first chunks."""
        return Progress(self._size, dict(self._counts), self._chunks[known:], known)

    def go_on_from(self, progress: Progress) -> None:
        """Go on behind what another process has written; whatever is beyond that is cut off by the next write."""
        self._size, self._counts = progress.size, dict(progress.counts)
        self._chunks[progress.known :] = progress.chunks

    def abandon(self) -> None:
        """Close without an index: another process has written it."""
        self._file.close()

    @property
    def message_counts(self) -> dict[str, int]:
        """Messages written, by topic."""
        return {topic: self._counts[channel] for topic, channel in self._channels.items()}

    @property
    def time_range(self) -> tuple[int, int]:
        """Of the messages written [ns]; zeros if there is none."""
        starts, ends = [c.message_start_time for c in self._chunks], [c.message_end_time for c in self._chunks]
        return min(starts, default=0), max(ends, default=0)

    def write(self, batches: Sequence[Batch]) -> None:
        """Write messages in order of time, and among those of one time in the order given."""
        time = np.maximum(np.concatenate([batch.time for batch in batches]), 0)  # the format has no earlier ones
        channel = np.repeat([self._channels[batch.topic] for batch in batches], [len(batch.time) for batch in batches])
        bodies = [body for batch in batches for body in batch.bodies]
        order = np.argsort(time, kind="stable")
        time, channel = time[order], channel[order]
        begin = 0
        while begin < len(order):
            end = int(np.searchsorted(time, int(time[begin]) + _CHUNK_TIME))
            self._write_chunk(time[begin:end], channel[begin:end], [bodies[index] for index in order[begin:end]])
            begin = end

    def move_to(self, path: Path) -> None:
        """Give the file another name, in place of one that has it; writing goes on."""
        with self._failures_told():
            replaceable(path, "the recording ")
            self.path.replace(path.resolve())  # a link stays one
        self.path = path

    def close(self) -> None:
        """Write the index that readers look for at the end, and close. May be called twice."""
        if self._file.closed:
            return
        data_end = _encoded([DataEnd(data_section_crc=0)])
        groups = (*self._descriptions(), self._chunks, [self._statistics()])
        try:
            self._put(data_end + _summary(self._size + len(data_end), groups) + MAGIC)
        finally:
            self._file.close()

    def _write_chunk(self, time: IntArray, channel: IntArray, bodies: list[bytes]) -> None:
        messages = _messages(time, channel, bodies)
        data = b"".join(messages)
        offset = np.cumsum([0] + [len(message) for message in messages])[:-1]
        compressed = zstandard.ZstdCompressor(level=1).compress(data)
        start, end = int(time[0]), int(time[-1])
        chunk = Chunk("zstd", compressed, end, start, zlib.crc32(data), len(data))
        written = _encoded([chunk])
        index = ChunkIndex(
            len(written), self._size, chunk.compression, len(compressed), end, 0, {}, start, chunk.uncompressed_size
        )
        channels, counts = np.unique(channel, return_counts=True)
        for number in channels.tolist():
            index.message_index_offsets[number] = self._size + len(written)
            written += _message_index(number, time[channel == number], offset[channel == number])
        self._put(written)
        self._chunks.append(replace(index, message_index_length=len(written) - index.chunk_length))
        for number, count in zip(channels.tolist(), counts.tolist(), strict=True):
            self._counts[number] += count

    def _put(self, data: bytes) -> None:
        if self._file.closed:
            raise OutputError(f"cannot write the recording {str(self.path)!r}: it is closed")
        with self._failures_told():
            if self._file.tell() != self._size:  # the last write was cut short, by a full disk or by Ctrl-C
                self._file.truncate(self._size)
                self._file.seek(self._size)
            rest = memoryview(data)
            while rest:
                rest = rest[self._file.write(rest) :]
        self._size += len(data)

    @contextmanager
    def _failures_told(self) -> Generator[None]:
        try:
            yield
        except OutputError:
            raise
        except OSError as error:
            raise OutputError(
                f"cannot write the recording {str(self.path)!r}: {error.strerror}; is there such a folder, may you write "
                "there, is there room?"
            ) from error

    def _descriptions(self) -> tuple[list[McapRecord], list[McapRecord]]:
        """Schemas and channels."""
        definitions = {topic.type: topic.definition.encode() for topic in self.topics}
        numbers = {kind: number for number, kind in enumerate(definitions, 1)}
        return (
            [Schema(numbers[kind], definition, "ros2msg", kind) for kind, definition in definitions.items()],
            [
                Channel(self._channels[topic.name], topic.name, "cdr", dict(topic.metadata), numbers[topic.type])
                for topic in self.topics
            ],
        )

    def _statistics(self) -> Statistics:
        start, end = self.time_range
        return Statistics(
            attachment_count=0, channel_count=len(self.topics), channel_message_counts=self._counts,
            chunk_count=len(self._chunks), message_count=sum(self._counts.values()), message_end_time=end,
            message_start_time=start, metadata_count=0, schema_count=len({topic.type for topic in self.topics}),
        )  # fmt: skip


def _encoded(records: Iterable[McapRecord]) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return builder.end()


def _messages(time: IntArray, channel: IntArray, bodies: Sequence[bytes]) -> list[bytes]:
    """Message records."""
    heads = np.zeros(len(bodies), _MESSAGE)
    heads["opcode"], heads["channel"] = Opcode.MESSAGE, channel
    heads["length"] = [_MESSAGE.itemsize - _FRAME + len(body) for body in bodies]
    heads["log_time"] = heads["publish_time"] = time
    data, size = heads.tobytes(), _MESSAGE.itemsize
    return [data[size * index : size * (index + 1)] + body for index, body in enumerate(bodies)]


def _message_index(channel: int, time: IntArray, offset: IntArray) -> bytes:
    """The record that says where in a chunk's data the messages of a channel are."""
    pairs = np.column_stack([time, offset]).astype("<u8").tobytes()
    return struct.pack("<BQHI", Opcode.MESSAGE_INDEX, 6 + len(pairs), channel, len(pairs)) + pairs


def _summary(start: int, groups: Sequence[Sequence[McapRecord]]) -> bytes:
    """The summary, which begins at a place of the file, and the footer: groups of records, and where each begins."""
    summary = b""
    offsets: list[McapRecord] = []
    for group in groups:
        encoded = _encoded(group)
        if encoded:
            offsets.append(SummaryOffset(encoded[0], start + len(summary), len(encoded)))
        summary += encoded
    offset_start = start + len(summary)
    summary += _encoded(offsets)
    footer = _encoded([Footer(start, offset_start, 0)])[:-4]  # the checksum covers all but itself
    return summary + footer + struct.pack("<I", zlib.crc32(summary + footer))
