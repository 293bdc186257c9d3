"""What columns of numbers may be by what is in them, and in what unit.

Time increases evenly. An accelerometer's three have a norm of 9.81 (or of one, in g) while the robot does not jump, a
quaternion's four one of 1. Joint positions are within the limits of the model's joints, and what they make of the floor is
as level as the accelerometer says. Velocities are derivatives of positions, angular velocity is how the accelerometer's
idea of up turns, and torques carry the robot.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from equipoise.conventions import GRAVITY, FloatArray
from equipoise.estimator.measurements.leg_motion import LegChains
from equipoise.logs.orientation import angle_from_up, quaternions_of
from equipoise.logs.tables.columns import UNITS
from equipoise.robot.floor import floor_normals_by_fit
from equipoise.robot.model import RobotModel
from equipoise.robot.statics import PLAUSIBLE_LOAD, carried_mass

_EVEN, _JITTER = 0.9, 0.5  # of the steps are so near to the median, relative
_RATES = (15.0, 5000.0)  # [Hz]
_GRAVITY = 0.15  # by which the median norm may be off, relative: robots walk
_BLOCK, _TURN = 0.25, 1.0  # [s] that means are taken over; of up, long enough for what pushes to average out
_BENT, _MOST_BENT = 0.1, 0.3  # [rad] of a joint that is bent, and of joints that must be: robots stand on bent legs
_ENOUGH = 2000  # samples to see within what limits they are
_STILL = 0.02  # [rad] by which joints may move within a block
_BEYOND = 0.3  # [rad] out of a joint's limits: encoders' zeros
_LEVEL = 0.25  # [rad] between the feet's floor and the accelerometer's
_CLEARLY = 0.7  # of the floor's disagreement: another order is better, and not by chance
_ALIKE = 0.5  # correlation that is no chance
_NEAR = 0.35  # by which a factor may be off and still be a unit's, relative

# Orders of legs that are in use; the model's own comes first.
_LEG_ORDERS = (("FL", "FR", "RL", "RR"), ("FR", "FL", "RR", "RL"), ("FL", "RL", "FR", "RR"))


def unit_of_time(values: FloatArray) -> str | None:
    """The unit of a column that increases evenly, at a rate that logs have; None if it does not."""
    steps = np.diff(values[np.isfinite(values)])
    if len(steps) < 10 or (steps > 0).mean() < 0.99:
        return None
    step = float(np.median(steps))
    if (np.abs(steps - step) < _JITTER * step).mean() < _EVEN:
        return None
    return next((unit for unit, factor in UNITS["time"].items() if _RATES[0] < 1 / (factor * step) < _RATES[1]), None)


def unit_of_gravity(vectors: FloatArray) -> tuple[str, float] | None:
    """The unit of (n, 3) numbers whose norm is that of gravity, and how far it spreads, relative; None if it is not."""
    norm = np.linalg.norm(_known(vectors), axis=1)
    if len(norm) < 10:
        return None
    low, size, high = (float(value) for value in np.quantile(norm, (0.25, 0.5, 0.75)))
    for unit, factor in UNITS["accelerometer"].items():
        if abs(size * factor / GRAVITY - 1) < _GRAVITY:
            return unit, (high - low) / size
    return None


def quaternion_order(numbers: FloatArray) -> str | None:
    """Order of (n, 4) numbers, "wxyz" or "xyzw", if they are quaternions of a body that does not lie on its side."""
    known = _known(numbers)
    if len(known) < 10 or np.abs(np.linalg.norm(known, axis=1) - 1).max() > 0.01:
        return None
    tilt = np.median(np.abs(known), axis=0)
    return "wxyz" if max(tilt[1], tilt[2]) <= max(tilt[0], tilt[1]) else "xyzw"


def unit_of_angles(robot: RobotModel, position: FloatArray) -> str | None:
    """The unit in which (n, nj) joint positions are within the limits, and legs bent; None if they are in none."""
    return _unit_within_limits(robot, _levels(position))


def _unit_within_limits(robot: RobotModel, levels: FloatArray) -> str | None:
    for unit, factor in UNITS["position"].items():
        bent = np.abs(factor * levels[1]) > _BENT
        beyond = np.maximum(robot.lower_limit - factor * levels, factor * levels - robot.upper_limit)
        if beyond.max() < _BEYOND and bent.mean() > _MOST_BENT:
            return unit
    return None


def unit_of_attitude(angles: FloatArray, acceleration: FloatArray) -> str | None:
    """The unit of (n, 3) roll, pitch, yaw in which up is clearly that of (n, 3) specific force; None if neither is."""
    known = np.isfinite(angles).all(axis=1) & np.isfinite(acceleration).all(axis=1)
    if not known.any():
        return None
    off = {
        unit: angle_from_up(quaternions_of(factor * angles[known]), acceleration[known])
        for unit, factor in UNITS["orientation"].items()
    }
    unit, other = sorted(off, key=off.__getitem__)
    return unit if off[unit] < min(_LEVEL, _CLEARLY * off[other]) else None


def unit_of_derivative(time: FloatArray, position: FloatArray, velocity: FloatArray) -> str | None:
    """The unit in which (n, k) numbers are derivatives of (n, k) joint positions [rad]; None if they are in none."""
    rows = np.isfinite(np.hstack([time[:, None], position, velocity])).all(axis=1)
    if rows.sum() < 10:
        return None
    derivative = np.gradient(position[rows], time[rows], axis=0)
    found = _unit_of_slope("velocity", velocity[rows], derivative)
    return None if found is None else found[0]


def unit_of_turning(time: FloatArray, acceleration: FloatArray, gyroscope: FloatArray) -> tuple[str, float] | None:
    """The unit in which (n, 3) numbers say how up turns in a body's axes, and how well; None if they do not.

    du/dt = u x omega.
    """
    mean, _ = _blocks(time, np.hstack([acceleration, gyroscope]), _TURN)
    if len(mean) < 10:
        return None
    up = mean[:, :3] / np.linalg.norm(mean[:, :3], axis=1)[:, None]
    between, turning = (up[1:] + up[:-1]) / 2, (mean[1:, 3:] + mean[:-1, 3:]) / 2
    return _unit_of_slope("gyro", np.cross(between, turning) * _TURN, np.diff(up, axis=0))


def carries(robot: RobotModel, position: FloatArray, torque: FloatArray) -> bool:
    """Whether (n, nj) torques carry such a robot at (n, nj) joint positions [rad]."""
    rows = np.isfinite(position).all(axis=1) & np.isfinite(torque).all(axis=1)
    if not rows.any():
        return False
    try:
        carried = carried_mass(robot, np.median(position[rows], axis=0), np.median(torque[rows], axis=0))
    except np.linalg.LinAlgError:  # legs that are stretched carry anything
        return False
    return PLAUSIBLE_LOAD[0] * robot.mass < abs(carried) < PLAUSIBLE_LOAD[1] * robot.mass


@dataclass(frozen=True)
class JointOrder:
    """An order in which a log may have the joints.

    Attributes:
        words: order in words.
        joints: names of the robot's joints, in the order of the columns.
        unit: unit of the columns.
        off: angle between the floor that the feet then make and the accelerometer's, rms [rad].
        sure: whether the floor says so clearly; else it is the one that is most usual.
    """

    words: str
    joints: tuple[str, ...]
    unit: str
    off: float
    sure: bool

    @property
    def level(self) -> bool:
        """Whether the floor is one."""
        return self.off < _LEVEL


def joint_order(
    robot: RobotModel, time: FloatArray | None, columns: FloatArray, acceleration: FloatArray | None
) -> JointOrder | None:
    """The order of (n, nj) columns, if they are joint positions in some order.

    Args:
        time: (n,) times [s], or None.
        acceleration: (n, 3) specific force, in any unit, or None.
    """
    fitting: list[tuple[float, str, tuple[str, ...], str]] = []
    levels = _levels(columns)
    for words, joints in _orders(robot).items():
        places = [joints.index(joint) for joint in robot.joint_names]
        unit = _unit_within_limits(robot, levels[:, places])
        if unit is not None:
            position = columns[:, places] * UNITS["position"][unit]
            off = 0.0
            if time is not None and acceleration is not None:
                off = _off_level(robot, time, position, acceleration)
            fitting.append((off, words, joints, unit))
    if not fitting:
        return None
    usual, best = fitting[0], min(fitting)
    off, words, joints, unit = best if best[0] < _CLEARLY * usual[0] else usual
    others = [one[0] for one in fitting if one[2] != joints]
    sure = off < min(_LEVEL, _CLEARLY * min(others, default=np.inf))
    return JointOrder(words, joints, unit, off, sure)


def _orders(robot: RobotModel) -> dict[str, tuple[str, ...]]:
    found = {"the model's order": robot.joint_names}
    for legs in _LEG_ORDERS:
        by_leg = [robot.legs[leg].joint_names for leg in legs]
        found[f"{' '.join(legs)}, leg by leg"] = tuple(joint for leg in by_leg for joint in leg)
        if len({len(leg) for leg in by_leg}) == 1:
            by_kind = zip(*by_leg, strict=True)
            found[f"{' '.join(legs)}, hips first"] = tuple(joint for kind in by_kind for joint in kind)
    return {words: joints for words, joints in found.items() if len(joints) == len(robot.joint_names)}


def _off_level(robot: RobotModel, time: FloatArray, position: FloatArray, acceleration: FloatArray) -> float:
    """Rms angle between the feet's plane and the accelerometer's, where the robot stands still [rad]."""
    mean, moved = _blocks(time, np.hstack([position, acceleration]))
    still = moved[:, : position.shape[1]].max(axis=1, initial=0.0) < _STILL
    mean = mean[still] if still.sum() > 3 else mean
    if not len(mean):
        return 0.0
    up = mean[:, position.shape[1] :] @ np.array(robot.imu_in_base.rotation).T
    normal, uneven = floor_normals_by_fit(LegChains(robot).feet(np.ascontiguousarray(mean[:, : position.shape[1]])))
    cosine = np.einsum("ni,ni->n", normal, up / np.linalg.norm(up, axis=1)[:, None])
    return float(np.sqrt(np.median(np.arccos(np.clip(cosine, -1, 1)) ** 2 + uneven**2)))


def _unit_of_slope(kind: str, numbers: FloatArray, reference: FloatArray) -> tuple[str, float] | None:
    """The unit whose factor makes numbers the reference, and their correlation, if they vary together."""
    numbers, reference = numbers - numbers.mean(axis=0), reference - reference.mean(axis=0)
    size, both = float((numbers**2).sum()), float((numbers * reference).sum())
    alike = both / max(np.sqrt(size * float((reference**2).sum())), 1e-30)
    if alike < _ALIKE:
        return None
    for unit, factor in UNITS[kind].items():
        if abs(np.log(both / size / factor)) < _NEAR:
            return unit, alike
    return None


def _blocks(time: FloatArray, values: FloatArray, block: float = _BLOCK) -> tuple[FloatArray, FloatArray]:
    """Means of (n, k) values over blocks of time, and by how much they vary within each."""
    rows = np.isfinite(values).all(axis=1) & np.isfinite(time)
    time, values = time[rows], values[rows]
    if len(time) < 2:
        return np.empty((0, values.shape[1])), np.empty((0, values.shape[1]))
    edges = np.unique(np.searchsorted(time, np.arange(time[0], time[-1], block)))
    if len(edges) < 2:
        return np.empty((0, values.shape[1])), np.empty((0, values.shape[1]))
    starts, values = edges[:-1], values[: edges[-1]]
    means = np.add.reduceat(values, starts) / np.diff(edges)[:, None]
    return means, np.maximum.reduceat(values, starts) - np.minimum.reduceat(values, starts)


def _levels(values: FloatArray) -> FloatArray:
    """(3, k) low, middle and high numbers of (n, k), glitches left aside."""
    every = max(1, len(values) // _ENOUGH)
    return np.asarray(np.nanquantile(values[::every], (0.02, 0.5, 0.98), axis=0), dtype=float)


def _known(values: FloatArray) -> FloatArray:
    return values[np.isfinite(values).all(axis=1)]
