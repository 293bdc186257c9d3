"""The order of a Unitree quadruped's motors, the same in all its messages and packets."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from equipoise.errors import SettingsError
from equipoise.robot.model import RobotModel

MOTORS = 12  # of the 20 that a message has room for
MOTOR_LEGS = ("FR", "FL", "RR", "RL")  # each hip, thigh, calf


def joints_of_motors(robot: RobotModel, who: str) -> NDArray[np.intp]:
    """(12,) which of the model's joints each motor moves.

    Args:
        who: name of what has the motors, for the message.

    Raises:
        SettingsError: the robot has not three joints a leg.
    """
    if len(robot.joint_names) != MOTORS or robot.leg_joints.shape[1] != 3:
        raise SettingsError(f"{who} has {MOTORS} joints, three a leg; {robot.name!r} has {len(robot.joint_names)}")
    return np.concatenate([robot.legs[leg].joints for leg in MOTOR_LEGS]).astype(np.intp)
