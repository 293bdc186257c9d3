"""The mass from a scale: refused where no such robot has it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from equipoise.errors import SettingsError
from equipoise.robot.scale import HEAVIEST

if TYPE_CHECKING:
    from equipoise.robot.model import RobotModel

_LIGHTEST = 0.05  # [kg]
_OTHER_ROBOT = 10.0  # times the model file's mass, or a tenth of it: no load and no CAD file is so far off


def check_mass(mass: float, std: float | None = None) -> None:
    """Refuse a mass [kg] that no legged robot has, and a standard deviation [kg] as large as the mass.

    Raises:
        SettingsError: the mass is too large, most likely in grams, or too small, or its standard deviation too large.
    """
    if mass > HEAVIEST:
        grams = f"; if it is in grams, give {mass / 1000:g}" if math.isfinite(mass) else ""
        raise SettingsError(f"a scale's mass of {mass:g} kg is more than any legged robot's{grams}")
    if not mass >= _LIGHTEST:
        raise SettingsError(f"a scale's mass is {mass:g} kg; it must be {_LIGHTEST:g} kg or more")
    if std is not None and std >= mass:
        raise SettingsError(
            f"the scale's mass is {mass:g} kg and its standard deviation {std:g} kg: a standard deviation as large as "
            "the mass determines nothing; give that of the scale, or leave both out"
        )


def check_mass_of(robot: RobotModel, mass: float) -> None:
    """Refuse a mass [kg] of another robot than the model file's.

    Raises:
        SettingsError: it is ten times the file's, or a tenth.
    """

    def fits(mass: float) -> bool:
        return 1 / _OTHER_ROBOT < mass / robot.mass < _OTHER_ROBOT

    if not fits(mass):
        like = f"; if it is in grams, give {mass / 1000:g}" if fits(mass / 1000) else ""
        raise SettingsError(
            f"a scale's mass of {mass:g} kg is another robot's: the model file of {robot.name!r} has {robot.mass:.4g} kg{like}"
        )
