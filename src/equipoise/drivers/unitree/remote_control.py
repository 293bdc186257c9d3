"""Remote control of Unitree's robots in their samples: 40 bytes, of which bytes 2 and 3 are the keys.

The layout is the maker's: `xKeySwitchUnion` in `unitree_joystick.hpp` and `joystick.h`, the same for A1, Go1, Go2 and B2.
"""

from __future__ import annotations

KEYS = ("R1", "L1", "start", "select", "R2", "L2", "F1", "F2", "A", "B", "X", "Y", "up", "right", "down", "left")
"""Names of the keys, from the least significant bit of a little-endian 16-bit number on."""
KEYS_AT = slice(2, 4)
"""Position of that number in the remote control's bytes."""

_DAMP = frozenset({"L2", "B"})


def keys_of(names: str) -> int:
    """Return the 16-bit number of pressed keys, as "L2+B"."""
    return sum(1 << KEYS.index(name) for name in names.split("+") if name)


def request_of(keys: int) -> str:
    """Return the operator's request from the pressed keys, as `RobotState.request`."""
    if not keys:
        return ""
    down = {name for bit, name in enumerate(KEYS) if keys >> bit & 1}
    return "damp" if down >= _DAMP else "lie down"
