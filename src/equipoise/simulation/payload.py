"""A payload on the base of a simulated robot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from equipoise.errors import SettingsError
from equipoise.robot.inertial import InertialParameters


@dataclass(frozen=True, eq=False)
class Payload:
    """Something rigidly fixed to the base; simulation only.

    Attributes:
        parameters: mass, CoM in the base frame, inertia about its own CoM in base axes. A zero inertia is a point mass.
    """

    parameters: InertialParameters

    def __post_init__(self) -> None:
        if self.parameters.mass <= 0:
            raise SettingsError(f"a payload's mass must be positive, got {self.parameters.mass:g} kg")
        if self.parameters.inertia.any() and (defect := self.parameters.physical_defect()):
            raise SettingsError(f"no body can have this payload's inertia: {defect}")

    @classmethod
    def parse(cls, text: str) -> Payload:
        """From "MASS,X,Y,Z" or "MASS,X,Y,Z,IXX,IYY,IZZ": kg, m in the base frame, kg m2 about the payload's own CoM."""
        try:
            numbers = [float(word) for word in text.split(",")]
        except ValueError:
            numbers = []
        if len(numbers) not in (4, 7):
            raise SettingsError(
                f"payload {text!r} is not MASS,X,Y,Z or MASS,X,Y,Z,IXX,IYY,IZZ (kg, m, kg m2), as in 1.5,0.1,0,0.08"
            )
        return cls(InertialParameters(numbers[0], np.array(numbers[1:4]), np.diag(numbers[4:] or np.zeros(3))))
