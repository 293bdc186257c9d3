"""Checks of the base: upright before anything moves, and then in the posture that the targets of the feet determine."""

from __future__ import annotations

import numpy as np

from equipoise.conventions import ACCELERATION_SAMPLE_AT_REST, GRAVITY
from equipoise.errors import FallError, SensorError
from equipoise.guard.footing import floor_on_three_feet, look_at_feet
from equipoise.guard.known import Check, Known
from equipoise.guard.limits import Limits
from equipoise.platform.platform import JointCommand
from equipoise.robot.imu import upright_flag
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance, lies

_LEVEL = (0.0, 0.0, 1.0)
_COMING_DOWN = 1.0  # [s] after feet were up in which the base may still lean as in a lift


class BaseChecks:
    """Hold the lean of the base against its limits.

    Attributes:
        at_rest: checks before a robot is moved; they raise SensorError and FallError.
        in_motion: checks of a sample; they raise FallError, and note which commands mean to plant all feet.
    """

    def __init__(self, limits: Limits, robot: RobotModel, stance: Stance) -> None:
        self._limits, self._robot, self._stance = limits, robot, stance
        self._lifted = -np.inf  # when feet were up last on which a robot may tip [s]
        self.at_rest: tuple[Check, ...] = (self._check_gravity, self._check_upright)
        self.in_motion: tuple[Check, ...] = (self._check_lean,)

    def _check_gravity(self, command: JointCommand, known: Known) -> None:
        size = float(np.linalg.norm(known.state.acceleration_in_imu))
        if not ACCELERATION_SAMPLE_AT_REST[0] <= size <= ACCELERATION_SAMPLE_AT_REST[1]:
            raise SensorError(
                f"the accelerometer reads {size:.1f} m/s2 before anything has moved; {GRAVITY:.1f} is gravity. Is it in other "
                "units, is the robot being moved?"
            )

    def _check_upright(self, command: JointCommand, known: Known) -> None:
        if known.up.tilt > self._limits.lean:
            rotation = np.array(self._robot.imu_in_base.rotation)
            raise FallError(
                f"the base leans by {np.degrees(known.up.tilt):.0f} deg before anything has moved: the robot has fallen, or "
                f"the IMU is mounted turned: {upright_flag(rotation, known.state.acceleration_in_imu, _LEVEL)}"
            )

    def _check_lean(self, command: JointCommand, known: Known) -> None:
        state = known.state
        if command.limp:  # somebody may lift and turn the robot
            return
        lifted, floor = look_at_feet(self._robot, self._stance, command.position)
        known.lifted = lifted
        if not lifted:
            known.standing = command
        elif lies(self._robot, self._stance, command.position):  # legs in the air say nothing of the floor
            self._lifted, floor, known.lifted = state.time, _LEVEL, False
        elif on_three := floor_on_three_feet(
            self._robot, self._stance, command.position, known.standing.position
        ):  # who stands on three feet is not meant to tip
            floor = on_three
        else:
            self._lifted = state.time
        coming_down = state.time - self._lifted < _COMING_DOWN
        lean = known.up.lean(floor)
        if lean > (self._limits.lean_in_lift if coming_down else self._limits.lean):
            raise FallError(
                f"the base leans by {np.degrees(lean):.0f} deg from the posture that it was sent to take: the robot is falling"
            )
