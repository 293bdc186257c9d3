"""Prediction of the first command to a ROS 2 robot, before one is sent."""

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
    "a position controller that is active holds: is it? Hardware with kp and kd interfaces needs gains: "
    "stack=quadruped_ros2_control, or command_type=impedance. Hardware that measures no efforts should report none, not zeros"
)
_NOTHING = 0.03  # of the largest torque that holds the robot up: less is what a sensor of a limp joint says


def listeners(topics: Collection[str], unheard: Sequence[str]) -> CheckupFinding:
    """Check that every topic of commands has a reader.

    Args:
        topics: topics of commands.
        unheard: those without a reader.
    """
    if unheard:
        value = f"nobody listens to {', '.join(unheard)}; calibrate will refuse"
        return CheckupFinding("controllers", value, False, REMEDY, serious=True)
    return CheckupFinding("controllers", f"all topics of commands are listened to ({len(topics)})", True)


def stiffness(robot: RobotModel, torque: FloatArray | None, limp_at_first: bool) -> list[CheckupFinding]:
    """Check that the joints hold: an active position controller does, hardware that takes gains is limp until they come.

    Args:
        torque: (nj,) joint torques [Nm], or None, where nothing can be said.
        limp_at_first: whether gains will be sent.
    """
    if torque is None:
        return []
    stance = nominal_stance(robot).joint_position
    largest, holding = np.abs(torque).max(), np.abs(static_torques(robot, stance, LEG_NAMES)).max()
    value = f"the joints give {largest:.1f} Nm at most"
    if largest > _NOTHING * holding:
        return [CheckupFinding("stiffness", value, None)]
    if limp_at_first:
        return [CheckupFinding("stiffness", f"{value}: limp, until gains are sent", True)]
    value += ": limp, and positions alone are to move it"
    return [CheckupFinding("stiffness", value, False, _LIMP, serious=True)]
