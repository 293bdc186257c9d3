"""A payload on the base of a simulated robot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from equipoise.errors import SettingsError

if TYPE_CHECKING:
    from equipoise.robot.inertial import InertialParameters
    from equipoise.robot.model import RobotModel

_HEAVIEST = 2.0  # times the robot's mass: no quadruped's motors carry more
_FARTHEST = 5.0  # times the leg's length


@dataclass(frozen=True, eq=False)
class Payload:
    """Load rigidly fixed to the base; simulation only.

    Attributes:
        parameters: mass, CoM in the base frame, inertia about its own CoM in base axes. A zero inertia is a point mass.
    """

    parameters: InertialParameters

    def __post_init__(self) -> None:
        if self.parameters.mass <= 0:
            raise SettingsError(f"a payload's mass must be positive, got {self.parameters.mass:g} kg")
        if self.parameters.inertia.any() and (defect := self.parameters.physical_defect()):
            raise SettingsError(f"the payload's inertia is not physical: {defect}")

    def check(self, robot: RobotModel) -> None:
        """Reject masses and positions that are implausible for the robot's size, as in grams or millimetres.

        Raises:
            SettingsError: it is too heavy or too far away.
        """
        mass, distance = self.parameters.mass, float(np.linalg.norm(self.parameters.com))
        if mass > _HEAVIEST * robot.mass:
            raise SettingsError(
                f"a payload of {mass:g} kg is {mass / robot.mass:.0f} times the mass of {robot.name!r} ({robot.mass:.1f} kg); "
                f"give at most {_HEAVIEST:g} times, in kg"
            )
        if distance > _FARTHEST * robot.leg_length:
            raise SettingsError(
                f"a payload {distance:.3g} m from the base's origin is not on {robot.name!r}, whose legs are "
                f"{robot.leg_length:.2f} m long; positions are in metres"
            )

    @classmethod
    def parse(cls, text: str) -> Payload:
        """Parse "MASS,X,Y,Z" or "MASS,X,Y,Z,IXX,IYY,IZZ": kg, m in the base frame, kg m2 about the payload's own CoM."""
        try:
            numbers = [float(word) for word in text.split(",")]
        except ValueError:
            numbers = []
        if len(numbers) not in (4, 7):
            raise SettingsError(
                f"payload {text!r} is not MASS,X,Y,Z or MASS,X,Y,Z,IXX,IYY,IZZ (kg, m, kg m2), for example 1.5,0.1,0,0.08"
            )
        from equipoise.robot.inertial import InertialParameters  # noqa: PLC0415 - invalid text is rejected without Pinocchio

        return cls(InertialParameters(numbers[0], np.array(numbers[1:4]), np.diag(numbers[4:] or np.zeros(3))))
