"""Messages of an MCAP file, even while it is written or after its writer was killed."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator, Mapping
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, DataEnd, Footer, Schema
from mcap.stream_reader import get_chunk_data_stream

from equipoise.errors import RecordingError
from equipoise.user_file import refuse_unreadable

Message = tuple[str, str, int, bytes]
"""Topic, type, time [ns] and body of a message."""

_MAGIC = b"\x89MCAP0\r\n"  # `mcap.writer` has it too, and takes a twentieth of a second to import
_RECORD = struct.Struct("<BQ")  # opcode and length
_MESSAGE = struct.Struct("<H4xQ8x")  # channel, sequence number, two times
_NO_DATA = 64  # bytes: zeros at the end that a power cut left in place of data


class MessageReader:
    """Reader of a file up to its last whole chunk; each call of `chunks` continues where the last one ended.

    The library's own reader takes twice as long, and cannot continue in a file that grows.

    Attributes:
        path: path of the file.
        channels: metadata of each channel that was read, by topic.
        closed: whether the end of the file was read; otherwise its writer was killed, or still writes.
        position: number of bytes that were read.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.closed = path, False
        self.channels: dict[str, Mapping[str, str]] = {}
        self._types: dict[int, str] = {}
        self._topics: dict[int, tuple[str, str]] = {}
        self.position = 0

    def messages(self) -> list[Message]:
        """Return the messages that were written since the last call, in the order of the file; raises as `chunks` does."""
        return [message for chunk in self.chunks() for message in chunk]

    def chunks(self) -> Iterator[list[Message]]:
        """Yield the messages that were written since the last call, those of one chunk at a time.

        Raises:
            RecordingError: the file is missing, damaged, or of another format.
        """
        with opened(self.path) as file:
            try:
                yield from self._chunks(file)
            except RecordingError:
                raise
            except Exception as error:  # damaged files fail in many ways, in several libraries, not all of them typed
                raise RecordingError(f"the recording {str(self.path)!r} is damaged: {error or repr(error)}") from error

    def _chunks(self, file: BinaryIO) -> Iterator[list[Message]]:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(size - _NO_DATA, 0))
        end = file.read(min(size, _NO_DATA))  # what is written from now on is read the next time
        file.seek(self.position)
        if not self.position:
            magic = file.read(len(_MAGIC))
            if not _MAGIC.startswith(magic):
                raise RecordingError(f"the recording {str(self.path)!r} cannot be read: it is not an MCAP file")
            self.position = len(magic) if magic == _MAGIC else 0
        while self.position and self.position + _RECORD.size <= size:
            head = file.read(_RECORD.size)
            opcode, length = _RECORD.unpack(head)
            if self.position + len(head) + length > size:
                break
            try:
                records = _of_chunk(file.read(length)) if opcode == Opcode.CHUNK else head + file.read(length)
            except Exception:
                if end == bytes(_NO_DATA):
                    break
                raise
            self.position += len(head) + length
            yield self._of_records(records)
            if opcode == Opcode.FOOTER:
                self.closed = True
                break
        if not self.closed and self.position and size > len(_MAGIC) and end.endswith(_MAGIC):
            raise ValueError("it was closed, and lacks records of a complete file")

    def _of_records(self, records: bytes) -> list[Message]:
        """Return the messages among records; note their schemas and channels."""
        messages: list[Message] = []
        position, head = 0, _RECORD.size
        of_message = int(Opcode.MESSAGE)  # looked up once, not for each message
        while position + head <= len(records):
            opcode, length = _RECORD.unpack_from(records, position)
            begin, position = position + head, position + head + length
            if position > len(records):
                raise ValueError(f"a record of {length} bytes is longer than its chunk")
            if opcode == of_message:
                channel, time = _MESSAGE.unpack_from(records, begin)
                topic, kind = self._topics[channel]
                messages.append((topic, kind, time, records[begin + _MESSAGE.size : position]))
            elif opcode == Opcode.SCHEMA:
                schema = Schema.read(ReadDataStream(BytesIO(records[begin:position])))
                self._types[schema.id] = schema.name
            elif opcode == Opcode.CHANNEL:
                made = Channel.read(ReadDataStream(BytesIO(records[begin:position])))
                self._topics[made.id] = made.topic, self._types.get(made.schema_id, "")
                self.channels[made.topic] = made.metadata
        return messages


def finish(path: Path) -> None:
    """Write the end of a file whose writer was killed, after its last whole chunk: other programs require it.

    Raises:
        RecordingError: the file cannot be read.
        OSError: the file cannot be written.
    """
    reader = MessageReader(path)
    reader.messages()
    if reader.closed or not reader.channels:
        return
    builder = RecordBuilder()
    DataEnd(data_section_crc=0).write(builder)
    Footer(summary_start=0, summary_offset_start=0, summary_crc=0).write(builder)
    os.truncate(path, reader.position)
    with open(path, "ab") as file:
        file.write(builder.end() + _MAGIC)


def was_closed(path: Path) -> bool:
    """Return whether a file was closed; otherwise its writer was killed, or a copy is incomplete. Read its end only."""
    with opened(path) as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(size - len(_MAGIC), 0))
        return size > len(_MAGIC) and file.read() == _MAGIC


def opened(path: Path) -> BinaryIO:
    """Open a recording to read it; raises RecordingError if that is not possible."""
    try:
        refuse_unreadable(path)
        return open(path, "rb")
    except OSError as error:
        raise RecordingError(f"the recording {str(path)!r} cannot be read: {error.strerror}") from error


def _of_chunk(content: bytes) -> bytes:
    """Return the records in a chunk."""
    chunk = Chunk.read(ReadDataStream(BytesIO(content)))
    stream, size = get_chunk_data_stream(chunk, validate_crc=True)
    return stream.read(size)
