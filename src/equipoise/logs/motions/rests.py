"""Rests in a long recording, and tests that the robot stands on four feet in them.

At rest neither encoders nor gyroscope change; a constant gyroscope bias does not matter. The robot stands if its feet,
according to the encoders, are under the base and on one plane that is as level as floors are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from equipoise.conventions import FloatArray
from equipoise.estimator.measurements.leg_motion import LegChains
from equipoise.logs.motions.track import STEP, Track
from equipoise.recording.runs import true_runs
from equipoise.robot.floor import floor_normals_by_fit
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance
from equipoise.robot.statics import PLAUSIBLE_LOAD, carried_mass

# Spread of the means over the quarters of a window. Resting A1s and Solos show a third to a half of this, moving ones ten
# times as much.
_WINDOW, _PARTS = 16, 4  # [steps]
_STILL_JOINTS, _STILL_BASE = 1.5e-3, 6e-3  # [rad], [rad/s]
_NOISE_FACTOR = 4.0  # of a mean's white noise: its spread over four parts and a dozen joints
_SHORTEST = 0.2  # [s] on an A1; half of it is used by each neighbour
_RAISED = 0.02  # [m] on an A1: a foot so far off the plane of the others is not on the floor
_LEANING = 0.25  # [rad] between the feet's floor and the accelerometer's: too much for a floor
LOWEST = 0.4
"""Least hip height of a standing robot, relative to the nominal stance: crouching robots have 0.6, lying ones 0.3."""


@dataclass(frozen=True, eq=False)
class LoggedRest:
    """Interval in which nothing moves.

    Attributes:
        start, end: times at which the rest begins and ends [s].
        joint_position: (nj,) mean of the joint positions [rad].
        up: (3,) unit vector against gravity, in base axes, by the accelerometer.
        angular_velocity_in_base: (3,) mean of the gyroscope, in base axes: its bias [rad/s].
        folded: whether the legs are folded, as on a lying robot.
        reason_unused: reason why the robot does not stand on four feet here, or None if it does.
    """

    start: float
    end: float
    joint_position: FloatArray
    up: FloatArray
    angular_velocity_in_base: FloatArray
    folded: bool
    reason_unused: str | None

    @property
    def standing(self) -> bool:
        """Return whether the robot stands on four feet."""
        return self.reason_unused is None


def find_rests(robot: RobotModel, stance: Stance, track: Track) -> list[LoggedRest]:
    """Return all rests of a track, in order of time."""
    rests: list[LoggedRest] = []
    legs = LegChains(robot)
    for first, last in _still_runs(track, max(_WINDOW, round(_SHORTEST / STEP))):
        part = slice(first, last)
        position, acceleration = track.joint_position[part].mean(axis=0), track.acceleration_in_base[part].mean(axis=0)
        up = acceleration / max(float(np.linalg.norm(acceleration)), 1e-9)
        torque = None if track.joint_torque is None else track.joint_torque[part].mean(axis=0)
        feet = legs.feet(position[None])[0]
        normal, _ = floor_normals_by_fit(feet[None])
        folded = _folded(stance, feet, normal[0])
        reason_unused = (
            "the legs are folded: it lies, or hangs" if folded else _why_not_level(stance, feet, normal[0], up)
        )
        if reason_unused is None and torque is not None:
            reason_unused = why_not_carried(robot, position, torque)
        start, end = float(track.time[first] - track.step / 2), float(track.time[last - 1] + track.step / 2)
        turning = track.angular_velocity_in_base[part].mean(axis=0)
        rests.append(LoggedRest(start, end, position, up, turning, folded, reason_unused))
    return rests


def _still_runs(track: Track, shortest: int) -> list[tuple[int, int]]:
    """Return the first and last (exclusive) index of every run of steps in which nothing moves."""
    if len(track.time) < _WINDOW:
        return []
    part_noise = np.sqrt(_PARTS / _WINDOW)
    still = _spread(track.joint_position) < _STILL_JOINTS + _NOISE_FACTOR * part_noise * track.encoder_noise
    still &= _spread(track.angular_velocity_in_base) < _STILL_BASE + _NOISE_FACTOR * part_noise * track.gyro_noise
    covered = np.convolve(still, np.ones(_WINDOW)) > 0  # by a window that is still
    return [run for run in true_runs(covered) if run[1] - run[0] >= shortest]


def _spread(values: FloatArray) -> FloatArray:
    """Return (n - window + 1,) largest spread, over columns, of the means over the parts of each window."""
    length = _WINDOW // _PARTS
    largest = np.zeros(len(values) - _WINDOW + 1)
    for column in values.T:
        means = sliding_window_view(column, length).mean(axis=-1)
        parts = np.stack([means[k * length : len(values) - _WINDOW + k * length + 1] for k in range(_PARTS)])
        largest = np.maximum(largest, np.ptp(parts, axis=0))
    return largest


def _folded(stance: Stance, feet: FloatArray, normal: FloatArray) -> bool:
    # The base's origin may be anywhere; the hips are above the floor by as much more as the feet are farther below.
    lower = float((stance.feet_in_base[:, 2] - feet @ normal).mean())
    return stance.hip_height + lower < LOWEST * stance.hip_height


def _why_not_level(stance: Stance, feet: FloatArray, normal: FloatArray, up: FloatArray) -> str | None:
    """Return why (4, 3) feet in the base frame, and the normal of their plane, do not fit a standing robot, or None."""
    # One foot that is raised by d turns the plane through all four: each is then d / 4 off it.
    raised = 4 * float(np.abs((feet - feet.mean(axis=0)) @ normal).max())
    if raised > _RAISED * stance.scale.length:
        return f"the feet are not on one plane: one is raised by some {1000 * raised:.0f} mm"
    lean = float(np.arccos(np.clip(normal @ up, -1, 1)))
    if lean > _LEANING:
        return f"the plane of the feet leans by {np.degrees(lean):.0f} deg against gravity"
    return None


def why_not_carried(robot: RobotModel, position: FloatArray, torque: FloatArray) -> str | None:
    """Return why (nj,) joint torques [Nm] at (nj,) joint positions [rad] do not fit a standing robot, or None."""
    carried = carried_mass(robot, position, torque)
    if abs(carried) < PLAUSIBLE_LOAD[0] * robot.mass:  # a wrong sign is screened for separately
        return f"the joint torques carry only {carried:.1f} kg: it hangs, or lies"
    return None
