"""The equations of the estimate."""

from __future__ import annotations

from typing import Any

from equipoise.estimator.equations.equation import Equation
from equipoise.estimator.equations.imu_position import ImuPosition
from equipoise.estimator.equations.leg_swing import LegSwings
from equipoise.estimator.equations.level import LevelFloor
from equipoise.estimator.equations.planted_moves import PlantedMoves
from equipoise.estimator.equations.tilt import TiltEquation
from equipoise.estimator.equations.torque_balance import TorqueBalance

EQUATIONS: tuple[type[Equation[Any]], ...] = (
    TiltEquation,
    LevelFloor,
    PlantedMoves,
    TorqueBalance,
    LegSwings,
    ImuPosition,
)
"""All of them; a motion's samples are in this order."""

USUAL = tuple(equation for equation in EQUATIONS if equation is not ImuPosition)
"""Those of most estimates: the sway's position of the IMU is used where the tilts contradict it, or the legs are trusted."""
