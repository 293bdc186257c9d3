"""Comparison of the gyroscope with the legs.

In stance motions the encoders alone determine the base's rotation; on two standing feet, its rotation across their line. The
comparison gives the offset between the clocks, and detects a gyroscope in other units or axes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError
from equipoise.estimator.diagnostics.screening import GYROSCOPE_MISTAKES, RIGHT_ANGLE_TURNS, imu_mounting_error
from equipoise.estimator.measurements.leg_motion import LegChains, cross, cross_matrix
from equipoise.estimator.measurements.walking import CONTEXT, gyro_bias_of_walks
from equipoise.logs.motions.track import STEP, Track, at_once, integral
from equipoise.logs.motions.walking_feet import WalkingFeet
from equipoise.recording.gaps import split_at_gaps
from equipoise.recording.recording import Recording
from equipoise.recording.trials import Step
from equipoise.robot.model import LEG_NAMES, RobotModel
from equipoise.robot.stance import Stance

Unexplained = Callable[[float, FloatArray], float]
Seen = tuple[FloatArray, FloatArray, FloatArray | None]
"""Rotation of the base by the encoders, in n steps of a track, in base axes: (2, n) begin and end of each [s]; (n, 3) angular
velocity, or its cross product with the arms; (n, 3) arms whose rotation is measured [m], or None."""

_STANCE_MOTION, _STEPS = "stance motion", "steps"

# [s] by which clocks may differ: with more, rests and motions no longer coincide. One step resembles the next, so that the
# offsets around the right one are compared, too. The gyroscope is read in the motion and around it.
_FARTHEST, _FARTHEST_OF_STEPS, _AROUND = 0.5, 2.0, 3.0
_AS_GOOD = 1.5  # times the residual at the best offset
_APART = 0.1  # [s] between distinct offsets
_SHARED = 0.5  # of the steps that an offset leaves within the IMU's samples: it is not compared by fewer
_COARSE, _FINE = 0.01, 0.0025  # [s]
_SLIP = 0.02  # [m/s] on an A1, rms over the feet: standing feet that roll stay below
_SLOWEST = 0.05  # [rad/s]: slower motion is not compared
_ENOUGH = 1.0  # [s] of such motion
_COMPARABLE = 0.5  # of the steps by the best correction: those that others find by chance are fewer
# Numbers of steps: in one batch, sufficient, and too few.
_PIECE, _PLENTY, _FEWEST = 30_000, 12_000, 8
_WRONG = 0.4  # of the variance unexplained: 0.03 to 0.07 without a mistake
_DOUBTFUL, _CURED = 0.08, 0.25
_UPRIGHT = 0.7  # cosine of the lean of a robot that walks, at least


@dataclass(frozen=True)
class GyroscopeComparison:
    """Comparison of the gyroscope with the legs.

    Attributes:
        offset: time to be added to the IMU's stamps so that it agrees with the joints [s].
        unexplained: fraction of the variance of the base's angular velocity by the legs that the gyroscope does not explain.
        agrees: whether that fraction is small enough to accept the offset.
        time: duration of the motion that was compared [s].
        motion: name of the kind of motion.
    """

    offset: float
    unexplained: float
    agrees: bool
    time: float
    motion: str


def compare_gyroscope(robot: RobotModel, stance: Stance, recording: Recording) -> GyroscopeComparison | None:
    """Compare the IMU's clock with the joints'; None if there is too little stance motion and walking.

    Raises:
        RecordingError: the gyroscope agrees with the legs only in other units or with another sign.
        MotionError: it agrees only if the IMU is rotated.
    """
    legs, motion = LegChains(robot), _STANCE_MOTION
    # One track across a stamp that is far away would be as long as the gap.
    tracks = [Track.of(robot, part, stance.scale.time) for part, _ in split_at_gaps(recording)]
    parts = [part for track in tracks for part in _parts(track)]
    seen = _moving_part(legs, stance, parts)
    if seen is None:
        walked = (_walked(legs, stance, part) for part in parts)
        seen, motion = next((part for part in walked if part is not None), None), _STEPS
    if seen is None:
        return None
    edges, turning, arms = seen
    imu = recording.between(edges.min() - _AROUND, edges.max() + _AROUND).imu
    angle = integral(imu.time, imu.angular_velocity_in_imu @ np.array(robot.imu_in_base.rotation).T)

    def unexplained(offset: float, correction: FloatArray) -> float:
        begin, end = edges - offset
        inside = (begin >= imu.time[0]) & (end <= imu.time[-1])
        sensed = (angle(end) - angle(begin)) / (end - begin)[:, None] @ correction.T
        return _unexplained(sensed if arms is None else cross(sensed, arms), turning, inside)

    offset, left = _best_offset(unexplained, np.eye(3), _FARTHEST if motion == _STANCE_MOTION else _FARTHEST_OF_STEPS)
    if left > _DOUBTFUL:
        _name_mistake(robot, unexplained, min(_CURED, left / 3), motion)
    return GyroscopeComparison(offset, left, left <= _WRONG, float(np.diff(edges, axis=0).sum()), motion)


def _unexplained(sensed: FloatArray, turning: FloatArray, inside: NDArray[np.bool_]) -> float:
    """Return the fraction of its variance that the (n, 3) sensed rotation leaves; all of it if few steps are inside."""
    if inside.mean() < _SHARED:
        return 1.0
    difference, reference = (sensed - turning)[inside], turning[inside]
    spread = ((reference - reference.mean(axis=0)) ** 2).sum()
    return float(((difference - difference.mean(axis=0)) ** 2).sum() / max(spread, 1e-12))


def _parts(track: Track) -> Iterator[Track]:
    """Yield a long track in pieces; none is very short."""
    for first in range(0, max(len(track.time) - _FEWEST, 0), _PIECE):
        last = first + _PIECE
        yield track.part(slice(first, last if len(track.time) - last > _FEWEST else None))


def _walked(legs: LegChains, stance: Stance, track: Track) -> Seen | None:
    """Return the rotation in the steps of a piece of a track; None if the robot does not walk for long in it."""
    if len(track.time) * track.step < 2 * CONTEXT * stance.scale.time:
        return None
    up = np.median(track.acceleration_in_base, axis=0)
    up = up / max(float(np.linalg.norm(up)), 1e-9)
    turns = [turn for turn in (np.eye(3), *RIGHT_ANGLE_TURNS) if (turn @ up)[2] > _UPRIGHT]
    # With a gyroscope of wrong sign or unit, or a turned IMU, few steps are found: try the corrections of each mistake.
    tried: list[tuple[Track, list[Step]]] = []
    mistakes = [(np.diag(factor), np.eye(3)) for _, factor in GYROSCOPE_MISTAKES]
    for of_gyroscope, of_accelerometer in [*((turn, turn) for turn in turns), *mistakes]:
        turning = track.angular_velocity_in_base @ of_gyroscope.T
        force = track.acceleration_in_base @ of_accelerometer.T
        cured = replace(track, angular_velocity_in_base=turning, acceleration_in_base=force)
        bias = gyro_bias_of_walks([(track.time, turning, force)])
        walking = WalkingFeet.of(legs, stance, cured.without_bias(bias))
        tried.append((cured, [] if walking is None else walking.on_two()))
    fewest = _COMPARABLE * max(len(steps) for _, steps in tried)
    for cured, steps in tried:
        if len(steps) >= fewest and sum(step.end - step.start for step in steps) > _ENOUGH * stance.scale.time:
            return _seen_in(legs, cured, steps)
    return None


def _seen_in(legs: LegChains, track: Track, steps: Sequence[Step]) -> Seen | None:
    """Return the rotation of the line between two standing feet, in the base frame, over steps.

    With velocities v in the base frame, less rolling: v_one - v_other = -omega x (p_one - p_other).
    """
    up = np.median(track.acceleration_in_base, axis=0)
    edges: list[FloatArray] = []
    turning: list[FloatArray] = []
    arms: list[FloatArray] = []
    for step in steps:
        part = track.part(track.indices(step.start, step.end))
        if len(part.time) < _FEWEST:
            continue
        velocity = np.gradient(part.joint_position, part.time, axis=0)
        motion = legs.motion(part.joint_position, velocity, np.zeros((len(velocity), 3)))
        radius = legs.foot_radius[:, None] * (up / np.linalg.norm(up))
        moved = motion.foot_velocity - cross(motion.foot_angular_velocity, np.broadcast_to(radius, motion.foot.shape))
        one, other = (LEG_NAMES.index(leg) for leg in step.standing)
        edges.append(np.array([part.time - track.step / 2, part.time + track.step / 2]))
        turning.append(moved[:, other] - moved[:, one])
        arms.append((motion.foot - radius)[:, one] - (motion.foot - radius)[:, other])
    return (np.hstack(edges), np.concatenate(turning), np.concatenate(arms)) if turning else None


def _moving_part(legs: LegChains, stance: Stance, parts: Sequence[Track]) -> Seen | None:
    """Return the rotation of the base in stance motions, by the legs; None if there is too little.

    Some minutes of motion suffice: a long log is read piece by piece until there are as many.
    """
    steps: list[FloatArray] = []
    turning: list[FloatArray] = []
    for part in parts:
        angular_velocity_in_base, standing = angular_velocity_by_legs(legs, stance, part)
        middle = part.time[standing]
        steps.append(np.array([middle - part.step / 2, middle + part.step / 2]))
        turning.append(angular_velocity_in_base[standing])
        if sum(map(len, turning)) > _PLENTY:
            break
    if sum(map(len, turning)) * STEP < _ENOUGH:
        return None
    every = 1 + sum(map(len, turning)) // _PLENTY
    return np.hstack(steps)[:, ::every], np.concatenate(turning)[::every], None


def angular_velocity_by_legs(legs: LegChains, stance: Stance, track: Track) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return (n, 3) angular velocities of the base by the encoders, in base axes, and (n,) whether they are valid.

    A standing foot's velocity in the base frame is J dq = rolling - v - omega x p: least squares over the four feet. A large
    residual means that a foot slides.
    """
    velocity = np.gradient(track.joint_position, track.time, axis=0)
    up = np.median(track.acceleration_in_base, axis=0)
    up = up / np.linalg.norm(up)
    found = [_turning(legs, track.joint_position[part], velocity[part], up) for part in at_once(len(velocity))]
    angular_velocity_in_base, slip = (np.concatenate(values) for values in zip(*found, strict=True))
    return angular_velocity_in_base, (slip < _SLIP * stance.scale.length / stance.scale.time) & (
        np.linalg.norm(angular_velocity_in_base, axis=1) > _SLOWEST
    )


def _turning(
    legs: LegChains, position: FloatArray, velocity: FloatArray, up: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return (n, 3) angular velocity of the base by the encoders, in base axes, and (n,) residual foot speed [m/s]."""
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


def _best_offset(unexplained: Unexplained, correction: FloatArray, farthest: float = _FARTHEST) -> tuple[float, float]:
    """Return the offset with the least residual, and that residual; among nearly equal offsets the smallest."""
    coarse = np.arange(-farthest, farthest + _COARSE / 2, _COARSE)
    left = np.array([unexplained(float(offset), correction) for offset in coarse])
    least = min(coarse[left <= _AS_GOOD * left.min()], key=abs)
    near = float(coarse[np.argmin(np.where(np.abs(coarse - least) < _APART, left, np.inf))])
    fine = near + np.arange(-4, 5) * _FINE
    left = np.array([unexplained(float(offset), correction) for offset in fine])
    second, first, _ = np.polyfit(fine - near, left, 2)
    offset = float(np.clip(near - first / (2 * second), fine[0], fine[-1])) if second > 0 else near
    return offset, unexplained(offset, correction)


def _name_mistake(robot: RobotModel, unexplained: Unexplained, limit: float, motion: str) -> None:
    cured, what = min((_best_offset(unexplained, np.diag(factor))[1], what) for what, factor in GYROSCOPE_MISTAKES)
    by_turn, index = min((_best_offset(unexplained, turn)[1], index) for index, turn in enumerate(RIGHT_ANGLE_TURNS))
    if by_turn < min(limit, cured):
        seen = f"in {motion} the gyroscope differs from the base's rotation by the legs"
        raise imu_mounting_error(robot, RIGHT_ANGLE_TURNS[index], seen)
    if cured < limit:
        raise RecordingError(
            f"in {motion} the gyroscope differs from the base's rotation by the legs: it must be in rad/s, in the axes of the "
            f'IMU\'s frame ({what}). For a table in deg/s, write units.gyro = "deg/s" into a file for --columns'
        )
