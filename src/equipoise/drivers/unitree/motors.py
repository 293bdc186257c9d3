"""Order of a Unitree quadruped's motors, the same in all its messages and packets."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from equipoise.errors import SettingsError
from equipoise.robot.model import RobotModel

MOTORS = 12  # of the 20 that a message has room for
STOP_POSITION, STOP_VELOCITY = 2.146e9, 16000.0  # values that disable position and velocity control
MOTOR_LEGS = ("FR", "FL", "RR", "RL")  # each hip, thigh, calf


def joints_of_motors(robot: RobotModel, name: str) -> NDArray[np.intp]:
    """Return the (12,) indices of the model's joints in the order of the motors.

    Args:
        name: name of the platform, for the message.

    Raises:
        SettingsError: the robot does not have three joints per leg.
    """
    if len(robot.joint_names) != MOTORS or robot.leg_joints.shape[1] != 3:
        raise SettingsError(f"{name} has {MOTORS} joints, three per leg; {robot.name!r} has {len(robot.joint_names)}")
    return np.concatenate([robot.legs[leg].joints for leg in MOTOR_LEGS]).astype(np.intp)
