"""Checks of the base: upright before the first command, and then in the posture that the foot targets determine."""

from __future__ import annotations

import numpy as np

from equipoise.conventions import ACCELERATION_SAMPLE_AT_REST, GRAVITY
from equipoise.errors import FallError, MotionError
from equipoise.guard.check_context import Check, CheckContext
from equipoise.guard.footing import floor_on_three_feet, look_at_feet
from equipoise.guard.limits import Limits
from equipoise.platform.platform import JointCommand
from equipoise.robot.imu import upright_flag
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance, lies

_LEVEL = (0.0, 0.0, 1.0)
_COMING_DOWN = 1.0  # [s] after a lift during which the base may still lean as in the lift


class BaseChecks:
    """Checks of the base's lean against its limits.

    Attributes:
        at_rest: checks before the robot is moved; they raise MotionError and FallError.
        in_motion: checks of a sample; they raise FallError, and record the last command with all feet on the floor.
    """

    def __init__(self, limits: Limits, robot: RobotModel, stance: Stance) -> None:
        self._limits, self._robot, self._stance = limits, robot, stance
        self._lifted = -np.inf  # time of the last lift in which the robot may tip [s]
        self.at_rest: tuple[Check, ...] = (self._check_gravity, self._check_upright)
        self.in_motion: tuple[Check, ...] = (self._check_lean,)

    def _check_gravity(self, command: JointCommand, context: CheckContext) -> None:
        size = float(np.linalg.norm(context.state.acceleration_in_imu))
        if not ACCELERATION_SAMPLE_AT_REST[0] <= size <= ACCELERATION_SAMPLE_AT_REST[1]:
            raise MotionError(
                f"the accelerometer reads {size:.1f} m/s2 before the first command; gravity is {GRAVITY:.1f} m/s2. Check its "
                "units, and keep the robot still"
            )

    def _check_upright(self, command: JointCommand, context: CheckContext) -> None:
        if context.up.tilt > self._limits.lean:
            rotation = np.array(self._robot.imu_in_base.rotation)
            raise FallError(
                f"the base leans by {np.degrees(context.up.tilt):.0f} deg before the first command. If the robot has "
                "fallen, set it upright. If the IMU is rotated: "
                f"{upright_flag(rotation, context.state.acceleration_in_imu, _LEVEL)}"
            )

    def _check_lean(self, command: JointCommand, context: CheckContext) -> None:
        state = context.state
        if command.limp:  # the operator may lift and turn the robot
            return
        lifted, floor = look_at_feet(self._robot, self._stance, command.position)
        context.lifted = lifted
        if not lifted:
            context.standing = command
        elif lies(self._robot, self._stance, command.position):  # legs in the air do not determine the floor
            self._lifted, floor, context.lifted = state.time, _LEVEL, False
        elif on_three := floor_on_three_feet(
            self._robot, self._stance, command.position, context.standing.position
        ):  # on three feet the robot must not tip
            floor = on_three
        else:
            self._lifted = state.time
        coming_down = state.time - self._lifted < _COMING_DOWN
        lean = context.up.lean(floor)
        if lean > (self._limits.lean_in_lift if coming_down else self._limits.lean):
            raise FallError(
                f"the base leans by {np.degrees(lean):.0f} deg from its commanded posture: the robot is falling"
            )
