"""Nominal stance: four feet on the floor under the hips, by one recipe for every quadruped."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import ReachError, SettingsError
from equipoise.robot.kinematics import Kinematics, foot_positions, inverse_kinematics
from equipoise.robot.legs import Leg
from equipoise.robot.model import RobotModel
from equipoise.robot.scale import Scale
from equipoise.robot.tree import joint_axis

# Hip heights tried, as fractions of the leg length, the usual one first.
_HEIGHT_RATIOS = (0.75, 0.72, 0.78, 0.70, 0.80, 0.65, 0.85)
_GRID = 13  # seeds per joint of the search for a first posture
# Hip heights at which a robot may lie, as fractions of the leg length; the first that its joints allow is taken.
_LYING_RATIOS = (0.30, 0.35, 0.40, 0.45, 0.50, 0.55, 0.60)
BELLY_RATIO = 0.15
"""Height of the hips above the belly of a lying robot, as a fraction of the leg length."""
_LYING_SHARE = 0.65  # of the stance's hip height; below it a robot lies, or crouches as low
_LIMIT_MARGIN = 0.05  # [rad]; a stance must not touch a joint limit


@dataclass(frozen=True, eq=False)
class Stance:
    """Stance of four feet on the floor under a level base.

    Attributes:
        joint_position: (nj,) joint positions in the model's joint order [rad].
        feet_in_base: (4, 3) centres of the feet FL FR RL RR in the base frame [m].
        hip_height: mean height of the hip pitch axes above the floor [m].
        base_height: height of the base frame's origin above the floor [m].
        scale: scale of the robot at this stance.
    """

    joint_position: FloatArray
    feet_in_base: FloatArray
    hip_height: float
    base_height: float
    scale: Scale

    def __post_init__(self) -> None:
        self.joint_position.setflags(write=False)
        self.feet_in_base.setflags(write=False)


def lies(robot: RobotModel, stance: Stance, joint_position: FloatArray) -> bool:
    """Return whether a robot lies with its joints at (nj,) [rad]: its hips are much lower over its feet than standing."""
    raised = float(foot_positions(robot, joint_position)[:, 2].mean() - stance.feet_in_base[:, 2].mean())
    return stance.hip_height - raised < _LYING_SHARE * stance.hip_height


def lying_posture(robot: RobotModel, stance: Stance) -> tuple[FloatArray, float]:
    """Return joint positions of the robot lying over its stance's footholds, and the height of its base frame [m]."""
    for ratio in _LYING_RATIOS:
        drop = stance.hip_height - ratio * robot.leg_length
        if drop <= 0:
            break
        try:
            position = inverse_kinematics(robot, stance.feet_in_base + np.array([0, 0, drop]), stance.joint_position)
        except ReachError:
            continue
        return position, stance.base_height - drop
    return stance.joint_position, stance.base_height


@lru_cache(maxsize=16)  # many callers need the stance of the same robot
def nominal_stance(robot: RobotModel) -> Stance:
    """Return the reference stance of results: the described one, or feet under the hip pitch joints.

    Feet stand under the hip pitch joints, all at one height, at about three quarters of the leg length below them.
    Knees bend to the side that the joint limits allow; if both are allowed, front knees point backward and hind knees
    forward.

    Raises:
        ReachError: no such stance lies within the joint limits.
        SettingsError: the described stance names unknown joints, lacks some or breaks a limit.
    """
    if robot.description.stance:
        return stance_at(robot, _described_joint_position(robot))
    ratios = (robot.description.stance_height,) if robot.description.stance_height else _HEIGHT_RATIOS
    failure: ReachError | None = None
    for ratio in ratios:
        try:
            return _stance_at_ratio(robot, ratio)
        except ReachError as error:
            failure = failure or error
    raise ReachError(
        f"no stance of {robot.name!r} with the feet under the hips at {ratios[0]:.0%} of the leg length lies within "
        f"its joint limits ({failure}); give one under [stance] in a robot configuration"
    ) from failure


def stance_at(robot: RobotModel, joint_position: FloatArray) -> Stance:
    """Return the stance with given joint positions; the base is level."""
    feet = foot_positions(robot, joint_position)
    radii = np.array([leg.foot_radius for leg in robot.legs.values()])
    floor = float(np.mean(feet[:, 2] - radii))
    hip_height = float(_hip_pitch_origins(robot, joint_position)[:, 2].mean()) - floor
    return Stance(np.array(joint_position), feet, hip_height, -floor, Scale.of(robot.mass, hip_height))


def _described_joint_position(robot: RobotModel) -> FloatArray:
    position = robot.joint_vector(robot.description.stance, "stance")
    for index, name in enumerate(robot.joint_names):
        lower, upper = robot.lower_limit[index], robot.upper_limit[index]
        if not lower <= position[index] <= upper:
            raise SettingsError(
                f"stance puts joint {name!r} at {position[index]:.3f} rad, outside its limits {lower:.3f} to {upper:.3f}"
            )
    return position


def _stance_at_ratio(robot: RobotModel, ratio: float) -> Stance:
    start = np.clip(np.zeros(len(robot.joint_names)), robot.lower_limit, robot.upper_limit)
    for leg in robot.legs.values():
        if len(leg.joints) == 3:
            start[leg.joints[0]] = _upright_abduction(robot, leg, start)
    hips = _hip_pitch_origins(robot, start)
    lateral = foot_positions(robot, start)[:, 1]  # the leg's plane is upright: hip pitch and knee do not change it
    floor = float(hips[:, 2].mean()) - ratio * robot.leg_length
    targets = np.column_stack([hips[:, 0], lateral, np.full(4, floor)])
    seeds = _seeds(robot, start, targets)
    failure: ReachError | None = None
    for seed in seeds:
        try:
            position = inverse_kinematics(robot, targets, seed)
        except ReachError as error:
            failure = failure or error
            continue
        margins = np.minimum(position - robot.lower_limit, robot.upper_limit - position)
        if margins.min() >= _LIMIT_MARGIN:
            return stance_at(robot, position)
        joint = robot.joint_names[int(np.argmin(margins))]
        failure = failure or ReachError(f"{joint} is {margins.min():.3f} rad from its limit")
    raise failure or ReachError("no seed posture")


def _upright_abduction(robot: RobotModel, leg: Leg, start: FloatArray) -> float:
    """Return the abduction angle nearest to zero at which the hip pitch axis is level, so that the leg's plane is upright."""
    abduction = leg.joints[0]
    candidates = np.linspace(float(robot.lower_limit[abduction]), float(robot.upper_limit[abduction]), 721)
    candidates = np.concatenate([[start[abduction]], candidates[np.argsort(np.abs(candidates), kind="stable")]])
    kinematics, hip_pitch = Kinematics(robot), leg.joint_ids[-2]
    axis = joint_axis(robot.pinocchio, hip_pitch)
    tilts: list[float] = []
    for angle in candidates:
        position = start.copy()
        position[abduction] = angle
        tilt = abs(float((kinematics.joint_poses(position)[hip_pitch].rotation @ axis)[2]))
        if tilt < 1e-6:
            return float(angle)
        tilts.append(tilt)
    return float(candidates[int(np.argmin(tilts))])


def _seeds(robot: RobotModel, start: FloatArray, targets: FloatArray) -> list[FloatArray]:
    """Return start postures for the inverse kinematics, the preferred bend of the knees first.

    Each leg's hip pitch and knee are taken from a grid over their limits: of the points that bring the foot near its
    target, the nearest with the knee behind the hip and the nearest with it in front.
    """
    span = [
        np.linspace(max(float(low), -np.pi), min(float(high), np.pi), _GRID)
        for low, high in zip(robot.lower_limit, robot.upper_limit, strict=True)
    ]
    legs = list(robot.legs.values())
    best: dict[tuple[int, bool], tuple[float, float, float]] = {}
    kinematics = Kinematics(robot)
    for pitch_step in range(_GRID):
        for knee_step in range(_GRID):
            position = start.copy()
            for leg in legs:
                position[leg.joints[-2]] = span[leg.joints[-2]][pitch_step]
                position[leg.joints[-1]] = span[leg.joints[-1]][knee_step]
            misses = np.linalg.norm(kinematics.foot_positions(position) - targets, axis=1)
            poses = kinematics.joint_poses(position)
            for index, leg in enumerate(legs):
                hip, knee = (poses[joint].translation for joint in leg.joint_ids[-2:])
                key = (index, bool(knee[0] > hip[0]))
                if misses[index] < best.get(key, (np.inf, 0.0, 0.0))[0]:
                    best[key] = (float(misses[index]), position[leg.joints[-2]], position[leg.joints[-1]])
    near = 0.3 * robot.leg_length

    def seed(knee_in_front: dict[str, bool]) -> FloatArray:
        position = start.copy()
        for index, leg in enumerate(legs):
            wanted = best.get((index, knee_in_front[leg.name]), (np.inf, 0.0, 0.0))
            other = best.get((index, not knee_in_front[leg.name]), (np.inf, 0.0, 0.0))
            _, pitch, knee = wanted if wanted[0] < near or wanted[0] <= other[0] else other
            position[leg.joints[-2]], position[leg.joints[-1]] = pitch, knee
        return position

    front, rear = ("FL", "FR"), ("RL", "RR")
    bends = [{**dict.fromkeys(front, a), **dict.fromkeys(rear, b)} for a, b in ((0, 1), (0, 0), (1, 1), (1, 0))]
    return [seed({name: bool(in_front) for name, in_front in bend.items()}) for bend in bends]


def _hip_pitch_origins(robot: RobotModel, joint_position: FloatArray) -> FloatArray:
    poses = Kinematics(robot).joint_poses(joint_position)
    return np.array([poses[leg.joint_ids[-2]].translation for leg in robot.legs.values()])
