"""Checks of a ROS 2 robot before the first command."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.drivers.checkup import CheckupFinding
from equipoise.robot.description import LEG_NAMES
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import nominal_stance
from equipoise.robot.statics import static_torques

REMEDY = "is the controller loaded and active ('ros2 control list_controllers'), is command_topic its name?"
_LIMP = (
    "is the position controller active? Hardware with kp and kd interfaces needs gains: "
    "stack=quadruped_ros2_control, or command_type=impedance. Hardware that measures no efforts should report none, not zeros"
)
_LIMP_TORQUE = 0.03  # of the largest torque that holds the robot up: limp joints give less


def subscribers(topics: Collection[str], unsubscribed: Sequence[str]) -> CheckupFinding:
    """Check that every command topic has a subscriber.

    Args:
        topics: command topics.
        unsubscribed: those without a subscriber.
    """
    if unsubscribed:
        value = f"no controller subscribes to {', '.join(unsubscribed)}; calibrate will fail"
        return CheckupFinding("controllers", value, False, REMEDY, serious=True)
    return CheckupFinding("controllers", f"all {len(topics)} command topics have subscribers", True)


def stiffness(robot: RobotModel, torque: FloatArray | None, limp_at_first: bool) -> list[CheckupFinding]:
    """Check that the joints hold: position controllers must, impedance hardware is limp until gains arrive.

    Args:
        torque: (nj,) joint torques [Nm], or None: not reported.
        limp_at_first: whether gains will be sent.
    """
    if torque is None:
        return []
    stance = nominal_stance(robot).joint_position
    largest, holding = np.abs(torque).max(), np.abs(static_torques(robot, stance, LEG_NAMES)).max()
    value = f"the joints give {largest:.1f} Nm at most"
    if largest > _LIMP_TORQUE * holding:
        return [CheckupFinding("stiffness", value, None)]
    if limp_at_first:
        return [CheckupFinding("stiffness", f"{value}: limp, until gains are sent", True)]
    value += ": limp, and only positions will be sent"
    return [CheckupFinding("stiffness", value, False, _LIMP, serious=True)]
