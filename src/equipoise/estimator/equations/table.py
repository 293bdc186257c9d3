"""The equations of the estimate."""

from __future__ import annotations

from typing import Any

from equipoise.estimator.equations.equation import Equation
from equipoise.estimator.equations.imu_position import ImuPosition
from equipoise.estimator.equations.leg_swing import LegSwings
from equipoise.estimator.equations.level import LevelFloor
from equipoise.estimator.equations.stance_motion import StanceMotions
from equipoise.estimator.equations.tilt import TiltEquation
from equipoise.estimator.equations.torque_balance import TorqueBalance

EQUATIONS: tuple[type[Equation[Any]], ...] = (
    TiltEquation,
    LevelFloor,
    StanceMotions,
    TorqueBalance,
    LegSwings,
    ImuPosition,
)
"""All equations; the samples of a motion are in this order."""

USUAL = tuple(equation for equation in EQUATIONS if equation is not ImuPosition)
"""Equations of most estimates; `ImuPosition` is added if the lifts contradict it or `leg_prior` is narrow."""
