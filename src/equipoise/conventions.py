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
"""[m/s2], as in Pinocchio and MuJoCo."""

# Between what an accelerometer at rest reads [m/s2]. What is outside is in other units, or of no accelerometer.
ACCELERATION_AT_REST = (7.0, 13.0)
"""On average: whatever its errors are, a calibration or a log can be read with it."""
ACCELERATION_SAMPLE_AT_REST = (GRAVITY - 2.5, GRAVITY + 2.5)
"""In one sample, before a robot is moved."""
WELL_SCALED_ACCELERATION_AT_REST = (9.3, 10.3)
"""On average, of one that a check of the robot finds nothing to say about."""
AT_REST_IN_UNITS_OF_G = (0.7, 1.3)
"""Between what one reads at rest that is in units of g, not m/s2."""
