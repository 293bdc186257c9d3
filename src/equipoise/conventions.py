"""What all modules agree on: array types, axes, and how strongly the earth pulls."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

Axis = Literal["roll", "pitch", "yaw"]
AXES: tuple[Axis, ...] = ("roll", "pitch", "yaw")

GRAVITY = 9.81
"""[m/s2], as in Pinocchio and MuJoCo."""
