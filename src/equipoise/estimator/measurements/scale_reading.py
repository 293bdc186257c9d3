"""Plausibility checks of a mass from a scale."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from equipoise.errors import SettingsError
from equipoise.robot.scale import HEAVIEST

if TYPE_CHECKING:
    from equipoise.robot.model import RobotModel

_LIGHTEST = 0.05  # [kg]
_OTHER_ROBOT = 10.0  # times the model file's mass, or a tenth of it: beyond any payload or CAD error


def check_mass(mass: float, std: float | None = None) -> None:
    """Check that a mass [kg] is that of a legged robot, and that its standard deviation [kg] is smaller than the mass.

    Raises:
        SettingsError: the mass is too large, most likely in grams, or too small, or its standard deviation is too large.
    """
    if mass > HEAVIEST:
        grams = f"; if it is in grams, pass {mass / 1000:g}" if math.isfinite(mass) else ""
        raise SettingsError(f"a mass of {mass:g} kg exceeds that of any legged robot{grams}")
    if not mass >= _LIGHTEST:
        raise SettingsError(f"a mass of {mass:g} kg is too small; pass at least {_LIGHTEST:g} kg")
    if std is not None and std >= mass:
        raise SettingsError(
            f"the mass is {mass:g} kg and its standard deviation {std:g} kg, which is not smaller; "
            "pass the scale's standard deviation, or omit both"
        )


def check_mass_of(robot: RobotModel, mass: float) -> None:
    """Check that a mass [kg] can be that of the model file's robot.

    Raises:
        SettingsError: it is at least ten times the model file's mass, or at most a tenth of it.
    """

    def fits(mass: float) -> bool:
        return 1 / _OTHER_ROBOT < mass / robot.mass < _OTHER_ROBOT

    if not fits(mass):
        grams = f"; if it is in grams, pass {mass / 1000:g}" if fits(mass / 1000) else ""
        raise SettingsError(
            f"a mass of {mass:g} kg does not match the model file of {robot.name!r}, which has {robot.mass:.4g} kg{grams}"
        )
