"""The gyroscope held against the legs: over planted feet the encoders alone say how the base turns.

What both feel of one motion tells by how much their clocks differ, before anything else is read from a log; and whether the
gyroscope is in other units or axes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError
from equipoise.logs.track import Integral, Track
from equipoise.precise.measurements.leg_motion import LegChains, cross, cross_matrix
from equipoise.precise.screening import GYROSCOPE_MISTAKES
from equipoise.recording.recording import Recording
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance

Unexplained = Callable[[float, FloatArray], float]

_FARTHEST = 0.5  # [s] that clocks may differ by: more is no delay, and rests and motions no longer meet
_COARSE, _FINE = 0.01, 0.0025  # [s]
_SLIP = 0.02  # [m/s] on an A1, rms over the feet: planted feet that roll stay below
_SLOWEST = 0.05  # [rad/s]: slower motion tells nothing
_ENOUGH = 1.0  # [s] of such motion
_AT_ONCE = 4096  # [steps]
# Steps that are looked at at once, that are enough of such motion, and too few.
_PIECE, _PLENTY, _FEWEST = 30_000, 12_000, 8
_WRONG = 0.4  # of the variance unexplained: 0.03 to 0.07 where nothing is wrong
_CURED = 0.25


@dataclass(frozen=True)
class GyroscopeComparison:
    """The gyroscope against the legs.

    Attributes:
        offset: time to be added to the IMU's stamps so that it agrees with the joints [s].
        unexplained: fraction of the base's angular velocity by the legs that the gyroscope leaves unexplained.
        agrees: whether that fraction is small enough to believe the offset.
        time: duration of the motion that was compared [s].
    """

    offset: float
    unexplained: float
    agrees: bool
    time: float


def compare_gyroscope(robot: RobotModel, stance: Stance, recording: Recording) -> GyroscopeComparison | None:
    """By how much the IMU's clock differs; None if there is too little motion over planted feet to tell.

    Raises:
        RecordingError: the gyroscope turns as the legs do only in other units or with another sign.
    """
    moving = _moving_part(LegChains(robot), stance, Track.of(robot, recording, stance.scale.time))
    if moving is None:
        return None
    steps, angular_velocity_in_base = moving
    gyroscope = recording.imu.angular_velocity_in_imu @ np.array(robot.imu_in_base.rotation).T
    angle = Integral(recording.imu.time, gyroscope)

    def unexplained(offset: float, factor: FloatArray) -> float:
        edges = steps - offset
        inside = (edges[0] >= recording.imu.time[0]) & (edges[1] <= recording.imu.time[-1])
        felt = factor * angle.means_between(*edges)
        difference, reference = (felt - angular_velocity_in_base)[inside], angular_velocity_in_base[inside]
        spread = ((reference - reference.mean(axis=0)) ** 2).sum()
        return float(((difference - difference.mean(axis=0)) ** 2).sum() / max(spread, 1e-12))

    offset, left = _best_offset(unexplained, np.ones(3))
    if left > _WRONG:
        _name_mistake(unexplained)
    return GyroscopeComparison(offset, left, left <= _WRONG, float(np.diff(steps, axis=0).sum()))


def _moving_part(legs: LegChains, stance: Stance, track: Track) -> tuple[FloatArray, FloatArray] | None:
    """(2, n) begin and end of steps in which the base turns over planted feet, and its (n, 3) angular velocity by the legs.

    Some minutes of motion tell all that there is to tell; a long log is looked at a piece at a time until there are as many.
    None if there is too little.
    """
    steps: list[FloatArray] = []
    turning: list[FloatArray] = []
    for first in range(0, max(len(track.time) - _FEWEST, 0), _PIECE):
        last = first + _PIECE
        part = track.part(slice(first, last if len(track.time) - last > _FEWEST else None))
        angular_velocity_in_base, planted = angular_velocity_by_legs(legs, stance, part)
        middle = part.time[planted]
        steps.append(np.array([middle - track.step / 2, middle + track.step / 2]))
        turning.append(angular_velocity_in_base[planted])
        if sum(map(len, turning)) > _PLENTY:
            break
    if sum(map(len, turning)) * track.step < _ENOUGH * stance.scale.time:
        return None
    return np.hstack(steps), np.concatenate(turning)


def angular_velocity_by_legs(legs: LegChains, stance: Stance, track: Track) -> tuple[FloatArray, NDArray[np.bool_]]:
    """(n, 3) angular velocity of the base by the encoders, in base axes, and where it can be believed.

    A planted foot's velocity in the base frame is J dq = rolling - v - omega x p: least squares over the four feet. Where
    that leaves much, a foot moves over the floor.
    """
    velocity = np.gradient(track.joint_position, track.time, axis=0)
    up = np.median(track.acceleration_in_base, axis=0)
    up = up / np.linalg.norm(up)
    parts = [slice(first, first + _AT_ONCE) for first in range(0, len(velocity), _AT_ONCE)]
    found = [_turning(legs, track.joint_position[part], velocity[part], up) for part in parts]
    angular_velocity_in_base, slip = (np.concatenate(values) for values in zip(*found, strict=True))
    return angular_velocity_in_base, (slip < _SLIP * stance.scale.length / stance.scale.time) & (
        np.linalg.norm(angular_velocity_in_base, axis=1) > _SLOWEST
    )


def _turning(
    legs: LegChains, position: FloatArray, velocity: FloatArray, up: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(n, 3) angular velocity of the base by the encoders, in base axes, and (n,) speed that it leaves to the feet [m/s]."""
    motion = legs.motion(position, velocity, np.zeros((len(position), 3)))
    # A foot that rolls moves its centre by its angular velocity x radius: omega's part is in the design, the legs' here.
    radius = legs.foot_radius[:, None] * up
    moved = cross(motion.foot_angular_velocity, np.broadcast_to(radius, motion.foot.shape)) - motion.foot_velocity
    arm = cross_matrix(radius - motion.foot)  # omega x (p - r) = -(p - r) x omega
    design = np.concatenate([np.broadcast_to(np.eye(3), arm.shape), arm], axis=-1).reshape(len(moved), 12, 6)
    target = moved.reshape(len(moved), 12, 1)
    transposed = np.swapaxes(design, 1, 2)
    solution = np.linalg.solve(transposed @ design, transposed @ target)
    slip = np.sqrt(((target - design @ solution) ** 2).mean(axis=(1, 2)) * 3)
    return np.asarray(solution[:, 3:, 0], dtype=float), np.asarray(slip, dtype=float)


def _best_offset(unexplained: Unexplained, factor: FloatArray) -> tuple[float, float]:
    """Where it is least, and what is left there."""
    coarse = np.arange(-_FARTHEST, _FARTHEST + _COARSE / 2, _COARSE)
    left = [unexplained(float(offset), factor) for offset in coarse]
    near = float(coarse[int(np.argmin(left))])
    fine = near + np.arange(-4, 5) * _FINE
    left = np.array([unexplained(float(offset), factor) for offset in fine])
    second, first, _ = np.polyfit(fine - near, left, 2)
    offset = float(np.clip(near - first / (2 * second), fine[0], fine[-1])) if second > 0 else near
    return offset, unexplained(offset, factor)


def _name_mistake(unexplained: Unexplained) -> None:
    for what, factor in GYROSCOPE_MISTAKES:
        _, cured = _best_offset(unexplained, factor)
        if cured < _CURED:
            raise RecordingError(
                "over planted feet the gyroscope does not turn as the legs say that the base does: it must be in rad/s, in "
                f"the axes of the IMU's frame ({what})"
            )
