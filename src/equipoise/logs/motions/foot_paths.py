"""Paths of the feet since the last rest, from encoders and gyroscope.

The base's path in the world is unknown, so that only differences between feet are meaningful: each foot's displacement less
the mean of the standing feet. Rolling of standing feet is removed: a sphere's centre moves with its angular velocity x
(radius up).
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.estimator.measurements.leg_motion import LegChains, cross
from equipoise.estimator.measurements.lift_samples import attitudes
from equipoise.logs.motions.rests import LoggedRest
from equipoise.logs.motions.track import Track, at_once
from equipoise.recording.runs import true_runs
from equipoise.robot.model import LEG_NAMES
from equipoise.robot.stance import Stance

_STANCE_WINDOW, _STANCE_SLID = 0.2, 1.5e-3  # [s], [m] on an A1: feet that move less in a window do not slip


@dataclass(frozen=True, eq=False)
class FootPaths:
    """Paths of the feet in n steps after a rest, in base axes at that rest.

    Attributes:
        time: (n,) times [s].
        way: (n, 4, 3) displacement of each foot since the rest without rolling; the base's unknown one is common to all [m].
        height: (n, 4) heights of these displacements, against gravity [m].
        drawn_up: (n, 4) decrease of each foot's distance to the base since the rest, along the vertical of the rest [m].
        turned: (n,) angle of the base's rotation since the rest [rad].
    """

    time: FloatArray
    way: FloatArray
    height: FloatArray
    drawn_up: FloatArray
    turned: FloatArray

    @classmethod
    def after(cls, legs: LegChains, track: Track, rest: LoggedRest) -> FootPaths:
        """Compute the paths after a rest.

        Args:
            track: samples from the rest's end on, two at least, with the gyroscope's bias removed.
        """
        time, position, angular_velocity_in_base = track.time, track.joint_position, track.angular_velocity_in_base
        attitude = attitudes(time, angular_velocity_in_base)
        to_rest = attitude.as_matrix()
        up = attitude.inv().apply(rest.up)
        feet = legs.feet(rest.joint_position[None])[0]
        moving = np.gradient(position, time, axis=0)
        way, rolling = np.empty((len(time), 4, 3)), np.empty((len(time), 4, 3))
        drawn_up = np.empty((len(time), 4))
        for some in at_once(len(time)):
            motion = legs.motion(position[some], moving[some], angular_velocity_in_base[some])
            rolls = cross(motion.foot_angular_velocity, legs.foot_radius[:, None] * up[some, None])
            rolling[some] = np.einsum("nij,nlj->nli", to_rest[some], rolls)
            way[some] = np.einsum("nij,nlj->nli", to_rest[some], motion.foot) - feet
            drawn_up[some] = (motion.foot - feet) @ rest.up
        way[1:] -= np.cumsum((rolling[1:] + rolling[:-1]) / 2 * np.diff(time)[:, None, None], axis=0)
        return cls(time, way, way @ rest.up, drawn_up, np.linalg.norm(attitude.as_rotvec(), axis=1))

    def slid(self, feet: tuple[str, ...] = LEG_NAMES) -> FloatArray:
        """Return (n,) the largest displacement of some feet against their mean [m]."""
        way = self.way[:, [LEG_NAMES.index(foot) for foot in feet]]
        return np.linalg.norm(way - way.mean(axis=1, keepdims=True), axis=2).max(axis=1)

    def rise_above(self, feet: tuple[str, ...]) -> FloatArray:
        """Return (n, 4) heights above the mean of the standing feet [m]."""
        standing = [LEG_NAMES.index(foot) for foot in feet]
        return self.height - self.height[:, standing].mean(axis=1, keepdims=True)

    def between(self, start: float, end: float) -> FootPaths:
        """Return the part with start <= time < end [s]."""
        part = (self.time >= start) & (self.time < end)
        return FootPaths(*(getattr(self, field.name)[part] for field in fields(self)))

    def off_the_floor(self, least: float, shortest: float) -> list[str]:
        """Return the feet that are above the two lowest by a least height [m] for a least total time [s]."""
        if len(self.time) < 2:
            return []
        lowest = np.sort(self.height, axis=1)[:, :2].mean(axis=1, keepdims=True)
        duration = (self.height - lowest > least).sum(axis=0) * float(np.diff(self.time).mean())
        return [foot for foot, time in zip(LEG_NAMES, duration.tolist(), strict=True) if time > shortest]

    def longest_standing(self, stance: Stance, shortest: float) -> tuple[float, float] | None:
        """Return the longest stretch in which no foot moves; None if it is too short.

        Args:
            shortest: shortest duration that counts [s].
        """
        window = max(2, round(_STANCE_WINDOW * stance.scale.time / float(np.diff(self.time).mean())))
        moved = self.way[window:] - self.way[:-window]
        slid = np.linalg.norm(moved - moved.mean(axis=1, keepdims=True), axis=2).max(axis=1)
        runs = true_runs(slid < _STANCE_SLID * stance.scale.length)
        if not runs:
            return None
        first, last = max(runs, key=lambda run: run[1] - run[0])
        start, end = float(self.time[first]), float(self.time[last + window - 1])
        return (start, end) if end - start >= shortest else None
