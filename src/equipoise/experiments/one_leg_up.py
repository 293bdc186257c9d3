"""Postures of a robot on three feet in which the fourth leg can swing without contact."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from equipoise.clearance.in_the_air import LegsInTheAir
from equipoise.conventions import FloatArray
from equipoise.errors import ReachError
from equipoise.experiments.legs_up import OVERSHOOT, SHARES, SWING, postures_to_swing
from equipoise.experiments.posture import check_posture
from equipoise.robot.floor import margin_inside, over_three_feet
from equipoise.robot.kinematics import Kinematics, foot_positions
from equipoise.robot.model import LEG_NAMES, RobotModel
from equipoise.robot.stance import Stance

SOFTER = 0.25
"""Gains while joints swing, as a fraction of the platform's: low gains let the leg dynamics affect the motion."""
ORDER = ("FL", "FR", "RR", "RL")
"""Order in which legs swing, so that the body moves around and never across."""
_OVER = (1.0, 0.85, 0.7)  # fractions of the way from the middle of four feet to that of three, tried in order
# Smallest distance [m] on an A1 from the CoM to the edge of the three feet: model errors and oscillation of the body.
_MARGIN = 0.03
_ROOM = 0.02  # [m] on an A1 between the leg and other bodies: soft feet and oscillation of the body
_TORQUE_SHARE = 0.9  # of the torque limit: largest control torque on a joint that lags by its whole swing


@dataclass(frozen=True, eq=False)
class OneLegUp:
    """Posture on three feet in which the fourth leg may swing.

    Attributes:
        leg: name of the leg that swings.
        feet: (4, 3) foot positions in the base frame, all on the floor, with the CoM over the three that will stand [m].
        raised: (4, 3) foot positions in the base frame with one foot up [m].
        joint_position: (nj,) joint positions with that foot up [rad].
        swing: (nj,) largest commanded swing angles to either side; zero for standing legs [rad].
        margin: smallest distance of the CoM from the edges of the three feet while the leg swings [m].
    """

    leg: str
    feet: FloatArray
    raised: FloatArray
    joint_position: FloatArray
    swing: FloatArray
    margin: float

    @property
    def standing(self) -> tuple[str, ...]:
        """Names of the legs that stand."""
        return tuple(leg for leg in LEG_NAMES if leg != self.leg)


@lru_cache(maxsize=16)
def legs_in_turn(robot: RobotModel, stance: Stance) -> tuple[OneLegUp, ...]:
    """Return a posture for each leg, in the order in which they swing.

    Args:
        robot: model that determines the CoM: that of the file, or the one estimated in the run.

    Raises:
        ReachError: the robot cannot stand on three feet and swing a leg.
    """
    return tuple(_one_leg_up(robot, stance, leg) for leg in ORDER)


def _one_leg_up(robot: RobotModel, stance: Stance, leg: str) -> OneLegUp:
    refused: ReachError | None = None
    for share in _OVER:
        try:
            return _over_three(robot, stance, leg, share)
        except ReachError as error:
            refused = refused or error
    raise ReachError(
        f"{robot.name!r} cannot stand on three feet and swing its {leg} leg: {refused}. Omit motors, or give another "
        "stance in a robot configuration"
    ) from refused


def _over_three(robot: RobotModel, stance: Stance, leg: str, share: float) -> OneLegUp:
    index, home = LEG_NAMES.index(leg), stance.feet_in_base
    com = Kinematics(robot).com(stance.joint_position)
    feet = home.copy()
    feet[:, :2] -= over_three_feet(home[:, :2], index, share) - com[:2]
    posture = check_posture(robot, stance, feet, tuple(name for name in LEG_NAMES if name != leg))
    position, swing = _with_room(robot, stance, leg, posture)
    raised = feet.copy()
    raised[index] = foot_positions(robot, position)[index]
    standing, kinematics = np.delete(feet[:, :2], index, axis=0), Kinematics(robot)
    ends = [position + OVERSHOOT * side * swing for side in (-1.0, 0.0, 1.0)]
    margin = min(margin_inside(standing, kinematics.com(end)[:2]) for end in (posture, *ends))
    if margin < (least := _MARGIN * stance.scale.length):
        raise ReachError(
            f"the centre of mass would be {1000 * margin:.0f} mm inside the edge of the other three feet; "
            f"{1000 * least:.0f} mm are required"
        )
    return OneLegUp(leg, feet, raised, position, swing, margin)


def _with_room(robot: RobotModel, stance: Stance, leg: str, standing: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the (nj,) joint positions nearest to `standing` in which a leg has room, and its (nj,) swing angles [rad]."""
    joints = list(robot.legs[leg].joints)
    clearance = LegsInTheAir(robot, stance, _ROOM * stance.scale.length, (leg,), -stance.base_height)
    stiffness = SOFTER * robot.gains(stance.hip_height)[0]
    most = np.minimum(SWING[-len(joints) :], _TORQUE_SHARE * robot.effort_limit[joints] / stiffness)
    for share in SHARES:
        swing = OVERSHOOT * share * most
        for postures in postures_to_swing(robot, joints, standing, swing):
            if all(map(clearance.kept, postures)):
                of_all = np.zeros_like(standing)
                of_all[joints] = share * most
                return postures[0], of_all
    raise ReachError("within the joint limits it would touch the floor, the trunk or another leg")
