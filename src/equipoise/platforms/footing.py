"""Which feet commands mean to be on the floor, by where the joints put them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from equipoise.robot.kinematics import foot_positions
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance

FloatArray = NDArray[np.float64]

_LIFTED = 0.003  # [m] out of the plane of the others, on an A1; the lowest of its steps is 10 mm high


class Footing:
    """Where the feet are.

    Four feet on a floor lie in a plane, however the base is turned over them. No name of a phase says as much, and a
    feedback loop has none.
    """

    def __init__(self, robot: RobotModel, stance: Stance) -> None:
        self._robot = robot
        self._usual = _out_of_plane(stance.feet_in_base)
        self._tolerance = _LIFTED * stance.size

    def lifted(self, joint_position: FloatArray) -> bool:
        """Whether joints at (nj,) [rad] hold feet above the floor that the others stand on."""
        feet = foot_positions(self._robot, joint_position)
        return abs(_out_of_plane(feet) - self._usual) > self._tolerance


def _out_of_plane(feet: FloatArray) -> float:
    """How far the middle of one diagonal is above that of the other, across both [m]; (4, 3) feet FL FR RL RR."""
    (ax, ay, az), (bx, by, bz) = (feet[0] - feet[3]).tolist(), (feet[1] - feet[2]).tolist()
    x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    dx, dy, dz = (feet[0] + feet[3] - feet[1] - feet[2]).tolist()
    return (x * dx + y * dy + z * dz) / 2 / max((x * x + y * y + z * z) ** 0.5, 1e-9)
