"""What can be set."""

from dataclasses import dataclass


@dataclass(frozen=True)
class BusSettings:
    """How the robot is reached.

    Attributes:
        node: of the robot on the bus.
        diary: file in which the bus notes who connects; empty: none.
    """

    node: int = 1
    diary: str = ""
