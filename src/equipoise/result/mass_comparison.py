"""Comparison of the given mass with the mass that the joint torques carry."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar


@dataclass(frozen=True)
class MassComparison:
    """Two values of the whole robot's mass.

    Attributes:
        given: mass from the user, measured with a scale [kg].
        from_torques: mass from the joint torques [kg].
        limit: largest acceptable difference, as a fraction of the carried mass.
        earlier: name of the earlier run that provides the torque constants; None: torques as reported.
    """

    COMPUTED: ClassVar = ("disagrees",)
    given: float
    from_torques: float
    limit: float
    earlier: str | None = None

    @property
    def difference(self) -> float:
        """Ratio of given to carried mass, minus one."""
        return self.given / self.from_torques - 1

    @property
    def disagrees(self) -> bool:
        """True if the difference exceeds the limit, or if the carried mass is not positive."""
        return not self.from_torques > 0 or abs(self.difference) > self.limit

    @property
    def message(self) -> str:
        """Both masses [kg] and their relative difference."""
        constants = f", with the torque constants of {self.earlier}" if self.earlier else ""
        masses = (
            f"the given mass is {self.given:g} kg, and the joint torques carry {self.from_torques:.2f} kg{constants}"
        )
        return f"{masses} ({self.difference:+.0%}, limit {self.limit:.0%})"
