"""Conventions of all modules: array types, axes, gravity, and the readings of an accelerometer at rest."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

Axis = Literal["roll", "pitch", "yaw"]
AXES: tuple[Axis, ...] = ("roll", "pitch", "yaw")
Swing = Literal["ahead", "aside"]
SWINGS: tuple[Swing, ...] = ("ahead", "aside")

GRAVITY = 9.81
"""Gravity [m/s2], as in Pinocchio and MuJoCo."""

# Limits of an accelerometer's reading at rest [m/s2]. Values outside are in other units, or not of an accelerometer.
ACCELERATION_AT_REST = (7.0, 13.0)
"""Limits of the mean, for calibrations and logs."""
ACCELERATION_SAMPLE_AT_REST = (GRAVITY - 2.5, GRAVITY + 2.5)
"""Limits of one sample, before a robot is moved."""
WELL_SCALED_ACCELERATION_AT_REST = (9.3, 10.3)
"""Limits of the mean, beyond which a check of the robot warns."""
AT_REST_IN_UNITS_OF_G = (0.7, 1.3)
"""Limits of readings at rest in units of g, not m/s2."""
