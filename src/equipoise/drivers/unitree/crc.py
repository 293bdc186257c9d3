"""Checksum of Unitree's packets: CRC-32 over 32-bit words, most significant bit first."""

from __future__ import annotations

import zlib

_REVERSED_BITS = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
_WORD = 4  # [bytes]


def crc32_words(data: bytes | bytearray | memoryview) -> int:
    """Return the CRC-32 (polynomial 0x04C11DB7, initially 0xFFFFFFFF, no final inversion) of little-endian 32-bit words.

    zlib's CRC-32 has the same polynomial but processes bytes in order, least significant bit first. The bytes of each word
    are therefore swapped, and the bits of each byte and of the result reversed.

    Args:
        data: bytes, a whole number of words.
    """
    swapped = bytearray(len(data))
    for byte in range(_WORD):
        swapped[byte::_WORD] = data[_WORD - 1 - byte :: _WORD]
    value = zlib.crc32(swapped.translate(_REVERSED_BITS)) ^ 0xFFFFFFFF
    return int.from_bytes(value.to_bytes(_WORD, "little").translate(_REVERSED_BITS), "big")
