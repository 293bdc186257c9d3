"""Go2 and B2 messages as bytes, in the layout of the robot's memory, which the checksum covers, and of the wire.

On the wire (CDR), only single fields are aligned; in memory, a motor's record begins at a multiple of four. The two differ
only in the padding before the first motor's mode. Records are NumPy's: fields of all motors at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from equipoise.drivers.unitree.crc import crc32_words
from equipoise.drivers.unitree.definitions import LOW_LEVEL, layout_of

SERVO = 1  # mode of a motor that executes its command

_HEADER = b"\x00\x01\x00\x00"  # of the plain encoding, little endian
_BEGINS = (0xFE, 0xEF)
_LOW_LEVEL = 0xFF
_PAD = bytes(128)
LOW_CMD, LOW_STATE = (
    layout_of(LOW_LEVEL[f"unitree_go/{name}"], LOW_LEVEL, align=True) for name in ("LowCmd", "LowState")
)


@dataclass(frozen=True, eq=False)
class RecordLayout:
    """Layouts of one message.

    Attributes:
        memory: structured type of the message in memory.
        motors: name of its field with one record per motor.
        first_motor: offset of that field in memory [bytes].
        first_mode: offset of the first motor's mode on the wire, after the header [bytes].
    """

    memory: np.dtype[Any]
    motors: str
    first_motor: int
    first_mode: int

    def blank(self) -> NDArray[Any]:
        """Return the fields of a message without values, to be reused."""
        record = np.zeros((), self.memory)
        record["head"], record["level_flag"], record[self.motors]["mode"] = _BEGINS, _LOW_LEVEL, SERVO
        return record

    def encoded(self, record: NDArray[Any]) -> bytes:
        """Encode fields for the wire, with their checksum."""
        covered = record.tobytes()[:-4]
        return self.to_wire(covered + crc32_words(covered).to_bytes(4, "little"))

    def to_wire(self, memory: bytes) -> bytes:
        """Encode a record's bytes for the wire."""
        end, begin = self.first_mode, self.first_motor
        return b"".join((_HEADER, memory[:end], memory[begin : begin + 1], _PAD[end + 1 : begin], memory[begin + 4 :]))

    def to_memory(self, wire: bytes) -> bytes | None:
        """Return the record's bytes; None for another type or another encoding."""
        if len(wire) != self.memory.itemsize or wire[:4] != _HEADER:  # the header is as long as the missing padding
            return None
        end, begin = self.first_mode, self.first_motor
        body = memoryview(wire)[4:]
        return b"".join((body[:end], _PAD[end:begin], body[end : end + 1], _PAD[:3], body[begin:]))


COMMAND = RecordLayout(LOW_CMD, "motor_cmd", first_motor=24, first_mode=22)
STATE = RecordLayout(LOW_STATE, "motor_state", first_motor=80, first_mode=77)


def read_message(layout: RecordLayout, data: bytes, check: bool = True) -> NDArray[Any] | None:
    """Decode a message to a record of its fields; return None if it is damaged.

    Args:
        data: bytes from the wire.
        check: whether a wrong checksum is damage; public simulators leave it zero.
    """
    memory = layout.to_memory(data)
    if memory is None:
        return None
    record = np.frombuffer(memory, layout.memory, 1).reshape(())
    if check and int(record["crc"]) != crc32_words(memory[:-4]):
        return None
    return record
