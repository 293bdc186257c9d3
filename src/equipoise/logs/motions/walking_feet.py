"""Detection of walks: times in which a robot stands on two or three feet, and pieces of a log with several of them.

No contact sensors are needed. Standing feet move against each other only by rolling, and feet off the floor are clearly
higher. Touchdown and lift-off fall into the parts that are trimmed off either end.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np
from numpy.typing import NDArray

from equipoise.conventions import FloatArray
from equipoise.estimator.measurements.leg_motion import LegChains, cross
from equipoise.estimator.measurements.walking import CONTEXT, up_between_steps
from equipoise.logs.motions.rests import LOWEST
from equipoise.logs.motions.track import Track, at_once
from equipoise.recording.runs import true_runs
from equipoise.recording.trials import Step
from equipoise.robot.model import LEG_NAMES, PAIRS
from equipoise.robot.stance import Stance

# On an A1; lengths and times are multiplied by those of the stance's scale.
_CLEAR = 5e-3  # [m] above the standing feet: off the floor, with uncertain joint offsets and attitude
_SLIP = 0.25  # [m/s] of two standing feet against each other: soft feet that roll show 0.1
_STAYS = 0.1  # [m/s] of a foot against standing ones, throughout: it stands, too
_UNEVEN = 0.03  # [m] of one standing foot above the other
_FALLING, _LANDING = 5.0, 20.0  # [m/s2]: no foot is on the floor; a foot lands hard
_SHORTEST = 0.09  # [s]
_FEWEST = 4  # steps: fewer are not a walk, but a failed lift or a stumble
_RARE = 0.25  # of the times that a robot stands on its usual two feet
_PIECE = 2.0  # [s] that are one motion to the estimate
_PAUSE = 1.0  # [s] without a step that ends a walk
SHORTEST_ON_THREE = 0.25
"""[s] on an A1: longer than a foot is up in a trot, even one that lands late."""


@dataclass(frozen=True, eq=False)
class WalkingFeet:
    """Positions and velocities of the feet, in n steps of a track.

    Attributes:
        stance: nominal stance of the robot.
        time: (n,) times of the steps' middles [s].
        turned: (n,) angle by which the robot has turned to its left since the track's start [rad].
        foot: (n, 4, 3) centres of the feet, in the base frame [m].
        height: (n, 4) heights of the soles against gravity, from the base's origin [m].
        velocity: (n, 4, 3) velocities without rolling, in base axes; the base's unknown one is common to all [m/s].
        carried: (n,) whether the accelerometer reads neither a fall nor an impact.
    """

    stance: Stance
    time: FloatArray
    turned: FloatArray
    foot: FloatArray
    height: FloatArray
    velocity: FloatArray
    carried: NDArray[np.bool_]

    @classmethod
    def of(cls, legs: LegChains, stance: Stance, track: Track) -> WalkingFeet | None:
        """Make it from a track without gyroscope bias; None if it is too short to determine the vertical."""
        time, clock = track.time, stance.scale.time
        if len(time) * track.step < 2 * CONTEXT * clock:
            return None
        up, turned = up_between_steps(
            time, track.angular_velocity_in_base, track.acceleration_in_base, CONTEXT / 2 * clock
        )
        foot, height, velocity = _feet(legs, track, up)
        force = np.linalg.norm(track.acceleration_in_base, axis=1)
        return cls(stance, time, turned, foot, height, velocity, (force > _FALLING) & (force < _LANDING))

    def on_two(self) -> list[Step]:
        """Return all times on two feet, in order."""
        found: list[Step] = []
        for standing in PAIRS.values():
            feet = [LEG_NAMES.index(leg) for leg in standing]
            spans = self._standing(feet, _SHORTEST, self.carried)
            found += [Step(standing, *span) for span in spans if not self._stand_too(feet, *span)]
        return sorted(found, key=lambda step: step.start)

    def on_three(self) -> list[Step]:
        """Return all times on three feet, in order; none while the robot lies.

        Over short times the plane of the standing feet is a better reference than the IMU's vertical.
        """
        found: list[Step] = []
        nominal = float(self.stance.feet_in_base[:, 2].mean())
        for lifted in range(4):
            standing = [foot for foot in range(4) if foot != lifted]
            hips = self.stance.hip_height + nominal - self.height[:, standing].mean(axis=1)
            where = self.carried & (hips > LOWEST * self.stance.hip_height)
            where &= _above_plane(self.foot[:, lifted], self.foot[:, standing]) > _CLEAR * self.stance.scale.length
            legs = tuple(LEG_NAMES[foot] for foot in standing)
            found += [Step(legs, start, end) for start, end in self._standing(standing, SHORTEST_ON_THREE, where)]
        return sorted(found, key=lambda step: step.start)

    def _stand_too(self, feet: list[int], start: float, end: float) -> bool:
        """Return whether a foot that seems to be lifted, because the robot accelerates, stands throughout an interval [s].

        Args:
            feet: indices of the two feet that stand.
        """
        part = slice(*np.searchsorted(self.time, [start, end], side="left"))
        lifted = [foot for foot in range(4) if foot not in feet]
        against = self.velocity[part][:, lifted] - self.velocity[part][:, feet].mean(axis=1, keepdims=True)
        fastest = np.linalg.norm(against, axis=2).max(axis=0)
        moves = fastest > _STAYS * self.stance.scale.length / self.stance.scale.time
        if moves.any():
            return not moves.all()
        raised = [
            np.abs(_above_plane(self.foot[part, one], self.foot[part][:, [*feet, other]]))
            for one, other in (lifted, lifted[::-1])
        ]
        return bool(np.max(raised) < _CLEAR * self.stance.scale.length)

    def _standing(self, feet: list[int], shortest: float, where: NDArray[np.bool_]) -> list[tuple[float, float]]:
        """Return the times [s] in which some feet stand, by index, and the others are off the floor.

        Args:
            shortest: shortest duration that counts, on an A1 [s].
            where: (n,) whether the times are considered.
        """
        scale, height, time = self.stance.scale, self.height, self.time
        lifted = [foot for foot in range(4) if foot not in feet]
        lowest = height[:, lifted].min(axis=1) - height[:, feet].mean(axis=1)
        standing = where & (lowest > _CLEAR * scale.length)
        for one, other in combinations(feet, 2):
            slip = np.linalg.norm(self.velocity[:, one] - self.velocity[:, other], axis=1)
            standing &= slip < _SLIP * scale.length / scale.time
            standing &= np.abs(height[:, one] - height[:, other]) < _UNEVEN * scale.length
        spans = [(float(time[first]), float(time[last - 1])) for first, last in true_runs(standing)]
        return [(start, end) for start, end in spans if end - start >= shortest * scale.time]


def walks(steps: Sequence[Step], stance: Stance) -> list[list[Step]]:
    """Return consecutive steps in pieces, each one motion of the estimate; only walks are kept."""
    clock = stance.scale.time
    gaits = [_without_rare(bout) for bout in _bouts(steps, _PAUSE * clock)]
    return [piece for gait in gaits if len(gait) >= _FEWEST for piece in _pieces(gait, _PIECE * clock)]


def crawls(steps: Sequence[Step], stance: Stance) -> list[list[Step]]:
    """Return consecutive times on three feet in pieces; a single one is enough."""
    bouts, duration = _bouts(steps, _PAUSE * stance.scale.time), _PIECE * stance.scale.time
    return [piece for bout in bouts if bout for piece in _pieces(bout, duration)]


def _bouts(steps: Sequence[Step], pause: float) -> list[list[Step]]:
    """Return groups of steps that follow each other within a pause [s]."""
    bouts: list[list[Step]] = [[*steps[:1]]]
    for before, step in pairwise(steps):
        if step.start - before.end > pause:
            bouts.append([])
        bouts[-1].append(step)
    return bouts


def _without_rare(bout: Sequence[Step]) -> list[Step]:
    """Return the steps without pairs of feet that are rare in the gait: a third foot still drags there."""
    counts = Counter(step.pair for step in bout)
    return [step for step in bout if counts[step.pair] >= _RARE * max(counts.values())]


def _pieces(bout: Sequence[Step], duration: float) -> list[list[Step]]:
    """Cut a bout into pieces of about equal duration."""
    start, end = bout[0].start, bout[-1].end
    count = max(1, round((end - start) / duration))
    edges = np.linspace(start, end, count + 1)[1:-1]
    cut: list[list[Step]] = [[] for _ in range(count)]
    places: list[int] = np.searchsorted(edges, [step.start for step in bout]).tolist()
    for step, place in zip(bout, places, strict=True):
        cut[place].append(step)
    return [piece for piece in cut if piece]


def _above_plane(foot: FloatArray, standing: FloatArray) -> FloatArray:
    """Return (n,) heights of (n, 3) feet above the planes of (n, 3, 3) others, on the base's side [m]."""
    first = standing[:, 0]
    normal = cross(standing[:, 1] - first, standing[:, 2] - first)
    normal = normal * (np.sign(-np.einsum("ni,ni->n", normal, first)) / np.linalg.norm(normal, axis=1))[:, None]
    return np.asarray(np.einsum("ni,ni->n", foot - first, normal), dtype=float)


def _feet(legs: LegChains, track: Track, up: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the feet relative to the base's origin.

    Returns:
        (n, 4, 3) centres [m], (n, 4) heights of the soles against gravity [m], (n, 4, 3) velocities without rolling [m/s].
    """
    moving = np.gradient(track.joint_position, track.time, axis=0)
    foot, height, velocity = (np.empty((len(track.time), 4, *more)) for more in ((3,), (), (3,)))
    for part in at_once(len(track.time)):
        motion = legs.motion(track.joint_position[part], moving[part], track.angular_velocity_in_base[part])
        radius = legs.foot_radius[:, None] * up[part, None]
        foot[part] = motion.foot
        height[part] = np.einsum("nli,ni->nl", motion.foot - radius, up[part])
        velocity[part] = motion.foot_velocity - cross(motion.foot_angular_velocity, radius)
    return foot, height, velocity
