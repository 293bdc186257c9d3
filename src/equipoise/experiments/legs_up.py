"""Postures of a robot lying on its belly with its legs up, in which all legs can swing without contact."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise, product

import numpy as np

from equipoise.clearance.clearance import Clearance
from equipoise.clearance.in_the_air import LegsInTheAir
from equipoise.conventions import FloatArray
from equipoise.errors import ReachError
from equipoise.robot.kinematics import Kinematics
from equipoise.robot.model import LEG_NAMES, RobotModel
from equipoise.robot.stance import Stance, lying_posture

SWING = (0.22, 0.4, 0.45)
"""Largest commanded swing angles to either side of a hip, a thigh and a calf [rad]."""
SHARES = (1.0, 0.85, 0.7, 0.6, 0.5)
"""Fractions of these angles, tried in order until the legs have room."""
OVERSHOOT = 1.15
"""Ratio of the largest angle of soft joints to the commanded one."""
_GRID = (5, 21, 9)  # numbers of angles tried of a hip, a thigh and a calf
_HIP_RANGE = 0.6  # [rad] from the angle of the lying robot
_LIMIT_MARGIN = 0.08  # [rad] from a joint's limit
_CLEAR = 0.01  # [m] on an A1, all through the motion
_WAY = 25  # number of postures checked on the way up
_STEPS = 250  # number of postures checked for contact: spaced about as a platform's commands
_DEEPER = 0.04  # of the leg length: largest height by which a foot may push the lying body up
_ORDERS = ((LEG_NAMES,), (("RL", "RR"), ("FL", "FR")), (("FL", "FR"), ("RL", "RR")))
"""Groups of legs that turn up one after another; all at once unless front and hind legs would touch."""
_CALVES_LAST = (True, False)
"""True to turn calves up after thighs: together, the feet press on the floor and jam on the way back."""
_FOLDED = 0.9  # smallest distance from hip to foot, as a fraction of that of the lying robot


@dataclass(frozen=True, eq=False)
class LegsUp:
    """Posture in which all legs may swing at once.

    Attributes:
        folded: (nj,) initial joint positions of the robot lying over its feet [rad].
        joint_position: (nj,) joint positions with all legs up [rad].
        swing: (nj,) largest commanded swing angles to either side [rad].
        way: (nj,) waypoints from `folded`; the last is `joint_position` [rad].
    """

    folded: FloatArray
    joint_position: FloatArray
    swing: FloatArray
    way: tuple[FloatArray, ...]

    @property
    def way_back(self) -> tuple[FloatArray, ...]:
        """Waypoints from `joint_position` to `folded`."""
        return (*self.way[-2::-1], self.folded)


@lru_cache(maxsize=16)
def legs_up(robot: RobotModel, stance: Stance) -> LegsUp:
    """Return the posture nearest to the lying one in which every leg can swing without touching floor, trunk or leg.

    Raises:
        ReachError: a leg cannot be turned up far enough.
    """
    folded, _ = lying_posture(robot, stance)
    for share in SHARES:
        position: FloatArray | None = np.array(folded)
        of_leg = share * np.array(SWING[-robot.leg_joints.shape[1] :])
        for leg in LEG_NAMES:
            position = None if position is None else _with_leg_up(robot, stance, leg, position, OVERSHOOT * of_leg)
        if position is not None:
            swing = np.empty_like(position)
            swing[robot.leg_joints] = of_leg
            if (way := _free_way(robot, folded, position)) is not None:
                return LegsUp(folded, position, swing, way)
    raise ReachError(
        f"{robot.name!r} cannot turn its legs up and swing them lying on its belly: within the joint limits they would "
        "touch the floor, the trunk or each other, according to the shapes of the model file. Omit motors"
    )


def _free_way(robot: RobotModel, folded: FloatArray, up: FloatArray) -> tuple[FloatArray, ...] | None:
    """Return waypoints without contact between links; None if links touch in every order of the legs."""
    for calves_last, order in product(_CALVES_LAST, _ORDERS):
        way = _in_order(robot, folded, up, order, calves_last)
        if Clearance(robot, folded).first_contact(_steps(folded, way)) is None:
            return way
    return None


def _in_order(
    robot: RobotModel, folded: FloatArray, up: FloatArray, order: tuple[tuple[str, ...], ...], calves_last: bool
) -> tuple[FloatArray, ...]:
    way, here = list[FloatArray](), np.array(folded)
    for legs in order:
        joints = np.array([robot.legs[leg].joints for leg in legs])
        for moved in (joints[:, :-1], joints[:, -1:]) if calves_last else (joints,):
            here[moved] = up[moved]
            way.append(here.copy())
    return tuple(way)


def _steps(start: FloatArray, way: tuple[FloatArray, ...]) -> FloatArray:
    """Return (n, nj) finely spaced postures along waypoints [rad]."""
    share = np.linspace(0.0, 1.0, _STEPS)[:, None]
    return np.concatenate([before + share * (after - before) for before, after in pairwise((start, *way))])


def _with_leg_up(
    robot: RobotModel, stance: Stance, leg: str, before: FloatArray, swing: FloatArray
) -> FloatArray | None:
    """Return the joint positions with one more leg up; None if it has no room."""
    joints = list(robot.legs[leg].joints)
    clearance = LegsInTheAir(robot, stance, _CLEAR * stance.scale.length, (leg,))
    for postures in postures_to_swing(robot, joints, before, swing):
        if all(map(clearance.kept, postures)) and _way_is_free(robot, leg, before, postures):
            return postures[0]
    return None


def postures_to_swing(
    robot: RobotModel, joints: list[int], start: FloatArray, swing: FloatArray
) -> Iterator[FloatArray]:
    """Yield (n, nj) joint positions with one leg moved and at the corners of its swing, the nearest to `start` first [rad]."""
    corners = np.array([(0.0,) * len(joints), *product((-1.0, 1.0), repeat=len(joints))]) * swing
    for angles in _nearest_first(robot, joints, start[joints], swing):
        postures = np.repeat(start[None], len(corners), axis=0)
        postures[:, joints] = angles + corners
        yield postures


def _nearest_first(robot: RobotModel, joints: list[int], start: FloatArray, swing: FloatArray) -> list[FloatArray]:
    """Return grid postures of one leg within its limits, by their largest joint displacement from `start`."""
    reach = np.array([_HIP_RANGE, np.pi, np.pi])[-len(joints) :]
    lower = np.maximum(robot.lower_limit[joints] + _LIMIT_MARGIN + swing, start - reach)
    upper = np.minimum(robot.upper_limit[joints] - _LIMIT_MARGIN - swing, start + reach)
    if (upper < lower).any():
        return []
    axes: list[FloatArray] = [
        np.linspace(low, high, n) for low, high, n in zip(lower, upper, _GRID[-len(joints) :], strict=True)
    ]
    grid: FloatArray = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(joints))
    turned = np.abs(grid - start)
    return list(grid[np.lexsort((turned.sum(axis=1), turned.max(axis=1).round(6)))])


def _way_is_free(robot: RobotModel, leg: str, start: FloatArray, postures: FloatArray) -> bool:
    """Return True if a leg can turn up without pushing the body up or folding into itself.

    Args:
        start: (nj,) joint positions of the lying robot [rad].
        postures: (n, nj) joint positions with the leg up, then at the corners of its swing [rad].
    """
    kinematics, index, hip = Kinematics(robot), LEG_NAMES.index(leg), robot.legs[leg].joint_ids[-2]

    def foot_and_length(position: FloatArray) -> tuple[float, float]:
        foot, at_hip = kinematics.foot_positions(position)[index], kinematics.joint_poses(position)[hip].translation
        return foot[2], float(np.linalg.norm(foot - at_hip))

    way = start + np.linspace(0.0, 1.0, _WAY)[:, None] * (postures[0] - start)
    depth, length = np.array([foot_and_length(position) for position in way]).T
    least = min(length[0], *(foot_and_length(position)[1] for position in postures), length.min())
    return depth.min() > depth[0] - _DEEPER * robot.leg_length and least > _FOLDED * length[0]
