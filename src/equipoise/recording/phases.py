"""Names of the phases of motions in recordings."""

from __future__ import annotations

from typing import Final


class Phase:
    """Names of the phases of a motion, in a recording's phase events."""

    # up and down
    FOLD: Final = "fold"
    STAND: Final = "stand"
    RESUME: Final = "resume"
    ENDING: Final = "ending"
    # stance motions
    READY: Final = "ready"
    REPLANT: Final = "replant"
    BEFORE: Final = "before"
    """The rest before a move whose other end is `REST`."""
    MOVE: Final = "move"
    SETTLE: Final = "settle"
    REST: Final = "rest"
    # rotated by hand
    LIE: Final = "lie"
    TURN: Final = "turn"
    """The joints only resist being moved, and the operator turns the robot; a simulated one is turned."""
    # legs turned up by a robot that lies
    RAISE: Final = "raise"
    SWING: Final = "swing"
    """All joints swing at once, or those of one leg; the steady part."""
    # a lift
    UNLOAD: Final = "unload"
    LIFT: Final = "lift"
    WATCH: Final = "watch"
    LOWER: Final = "lower"
    # found in logs
    WALK: Final = "walk"
    """Feet are lifted and put down in turn."""
    # balancing
    BALANCE: Final = "balance"
    CATCH: Final = "catch"
    # an excitation
    RAMP: Final = "ramp"
    EXCITATION: Final = "excitation"
    """The steady part."""
    END: Final = "end"
