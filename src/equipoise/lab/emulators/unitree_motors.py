"""Motor boards of Unitree's robots."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from equipoise.conventions import FloatArray
from equipoise.drivers.unitree.motors import STOP_POSITION, STOP_VELOCITY
from equipoise.platform.platform import JointCommand


def of_motor_boards(table: FloatArray, here: FloatArray, on: NDArray[np.bool_]) -> JointCommand:
    """Return the command that Unitree's motor boards execute: no control of stop values, and no torque of motors that are off.

    Args:
        table: (5, nj) command of the joints' motors, as `JointCommand.table`.
        here: (nj,) joint positions [rad].
        on: (nj,) True for motors that are on.
    """
    position, velocity, torque, kp, kd = table
    holds, brakes = on & (np.abs(position) < STOP_POSITION / 2), on & (np.abs(velocity) < STOP_VELOCITY / 2)
    position, torque, kp = np.where(holds, position, here), np.where(on, torque, 0.0), np.where(holds, kp, 0.0)
    return JointCommand(position, np.where(brakes, velocity, 0.0), torque, kp, np.where(brakes, kd, 0.0))
