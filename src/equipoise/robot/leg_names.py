"""Words in the names of joints, and the leg that they name: descriptions, drivers and firmware have their own."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence

_WORDS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
_NOISE = {"joint", "j", "motor", "actuator", "link"}
_SIDES = {"left": "L", "l": "L", "right": "R", "r": "R"}
_ENDS = {"front": "F", "fore": "F", "f": "F", "rear": "R", "hind": "R", "back": "R", "h": "R", "b": "R"}
_LEGS = {
    **dict.fromkeys(("fl", "lf"), "FL"),
    **dict.fromkeys(("fr", "rf"), "FR"),
    **dict.fromkeys(("rl", "lr", "hl", "lh", "bl", "lb"), "RL"),
    **dict.fromkeys(("rr", "hr", "rh", "br", "rb"), "RR"),
}


def words_of(name: str) -> list[str]:
    """Lower-case words of a name, without its namespace and what every joint's name has."""
    own = re.split(r"/|::", name)[-1]
    return [word for word in (match.lower() for match in _WORDS.findall(own)) if word not in _NOISE]


def leg_of(words: Sequence[str]) -> str | None:
    """The one leg that a name's words name, or None."""
    legs = {_LEGS[word] for word in words if word in _LEGS}
    for one, other in itertools.pairwise(words):
        for end, side in ((one, other), (other, one)):
            if end in _ENDS and side in _SIDES:
                legs.add(_ENDS[end] + _SIDES[side])
    return legs.pop() if len(legs) == 1 else None
