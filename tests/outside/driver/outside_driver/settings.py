"""Settings of the driver."""

from dataclasses import dataclass


@dataclass(frozen=True)
class BusSettings:
    """Settings of the connection to the robot.

    Attributes:
        node: of the robot on the bus.
        diary: file in which the bus notes who connects; empty: none.
    """

    node: int = 1
    diary: str = ""
