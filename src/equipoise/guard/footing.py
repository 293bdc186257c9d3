"""Which feet commands mean to be on the floor, by where the joints put them."""

from __future__ import annotations

from equipoise.conventions import FloatArray
from equipoise.robot.floor import Vector, floor_normal_by_diagonals
from equipoise.robot.kinematics import foot_positions
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance

_LIFTED = 0.003  # [m] out of the plane of the others, on an A1; the lowest of its steps is 10 mm high


class Footing:
    """Where the feet are.

    Four feet on a floor lie in a plane, however the base is turned over them. No name of a phase says as much, and a
    feedback loop has none.
    """

    def __init__(self, robot: RobotModel, stance: Stance) -> None:
        self._robot = robot
        self._usual, _ = _diagonals(stance.feet_in_base)
        self._tolerance = _LIFTED * stance.scale.length

    def look(self, joint_position: FloatArray) -> tuple[bool, Vector]:
        """Whether joints at (nj,) [rad] hold feet above the floor that the others stand on, and its normal in the base."""
        apart, up = _diagonals(foot_positions(self._robot, joint_position))
        return abs(apart - self._usual) > self._tolerance, up

    def lifted(self, joint_position: FloatArray) -> bool:
        """The first half of `look`."""
        return self.look(joint_position)[0]


def _diagonals(feet: FloatArray) -> tuple[float, Vector]:
    """How far the middle of one diagonal is above that of the other [m], and the upward normal of both.

    Args:
        feet: (4, 3) FL FR RL RR.
    """
    up = floor_normal_by_diagonals(feet)
    dx, dy, dz = (feet[0] + feet[3] - feet[1] - feet[2]).tolist()
    return (up[0] * dx + up[1] * dy + up[2] * dz) / 2, up
