"""Where a robot walks: the times in which it stands on two feet, and pieces of a log that hold some of them.

No contact sensors are needed. Two feet stand where neither moves against the other but by rolling, and the other two are
plainly higher; what the floor does to feet as they come and go is left to what is trimmed off either end.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.logs.motions.track import Track, at_once
from equipoise.precise.measurements.leg_motion import LegChains, cross
from equipoise.precise.measurements.walking import CONTEXT, up_between_steps
from equipoise.recording.runs import true_runs
from equipoise.recording.trials import TwoFeet
from equipoise.robot.model import LEG_NAMES, PAIRS
from equipoise.robot.stance import Stance

# On an A1; lengths and times are multiplied by those of the stance's scale.
_CLEAR = 5e-3  # [m] above the standing feet: off the floor, though joint zeros and the attitude are not known
_SLIP = 0.25  # [m/s] of two standing feet against each other: soft feet that roll show 0.1
_UNEVEN = 0.03  # [m] of one standing foot above the other
_FALLING, _LANDING = 5.0, 20.0  # [m/s2]: no foot is on the floor; one meets it hard
_SHORTEST = 0.09  # [s]
_FEWEST = 4  # steps: fewer are no walk, but a lift that failed or a stumble
_RARE = 0.25  # of the times that a robot stands on its usual two feet
_PIECE = 2.0  # [s] that are one motion to the estimate
_PAUSE = 1.0  # [s] without a step that ends a walk


def find_steps(legs: LegChains, stance: Stance, track: Track) -> tuple[list[TwoFeet], FloatArray]:
    """All times on two feet in order, and (n,) how far the robot has turned to its left by each step of the track [rad].

    Args:
        track: samples with the gyroscope's bias taken off.
    """
    time, scale = track.time, stance.scale
    if len(time) * track.step < 2 * CONTEXT * scale.time:
        return [], np.zeros(len(time))
    up, turned = up_between_steps(
        time, track.angular_velocity_in_base, track.acceleration_in_base, CONTEXT / 2 * scale.time
    )
    height, velocity = _feet(legs, track, up)
    felt = np.linalg.norm(track.acceleration_in_base, axis=1)
    carried = (felt > _FALLING) & (felt < _LANDING)
    found: list[TwoFeet] = []
    for pair, standing in PAIRS.items():
        one, other = (LEG_NAMES.index(leg) for leg in standing)
        lifted = [leg not in standing for leg in LEG_NAMES]
        lowest = height[:, lifted].min(axis=1) - height[:, [one, other]].mean(axis=1)
        slip = np.linalg.norm(velocity[:, one] - velocity[:, other], axis=1)
        on_two = carried & (lowest > _CLEAR * scale.length) & (slip < _SLIP * scale.length / scale.time)
        on_two &= np.abs(height[:, one] - height[:, other]) < _UNEVEN * scale.length
        spans = [(float(time[first]), float(time[last - 1])) for first, last in true_runs(on_two)]
        found += [TwoFeet(pair, a, b) for a, b in spans if b - a >= _SHORTEST * scale.time]
    return sorted(found, key=lambda step: step.start), turned


def walks(steps: Sequence[TwoFeet], stance: Stance) -> list[list[TwoFeet]]:
    """Steps that follow each other, in pieces that are one motion to the estimate; what is no walk is left out."""
    clock = stance.scale.time
    bouts: list[list[TwoFeet]] = [[*steps[:1]]]
    for before, step in pairwise(steps):
        if step.start - before.end > _PAUSE * clock:
            bouts.append([])
        bouts[-1].append(step)
    gaits = [_without_rare(bout) for bout in bouts]
    return [piece for gait in gaits if len(gait) >= _FEWEST for piece in _pieces(gait, _PIECE * clock)]


def _without_rare(bout: Sequence[TwoFeet]) -> list[TwoFeet]:
    """Without pairs of feet that the gait hardly ever stands on: there a third foot still drags, or already does."""
    counts = Counter(step.pair for step in bout)
    return [step for step in bout if counts[step.pair] >= _RARE * max(counts.values())]


def _pieces(bout: Sequence[TwoFeet], duration: float) -> list[list[TwoFeet]]:
    """Of about equal duration."""
    start, end = bout[0].start, bout[-1].end
    count = max(1, round((end - start) / duration))
    edges = np.linspace(start, end, count + 1)[1:-1]
    cut = [[step for step in bout if np.searchsorted(edges, step.start) == place] for place in range(count)]
    return [piece for piece in cut if piece]


def _feet(legs: LegChains, track: Track, up: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(n, 4) heights of the feet's soles, against gravity [m], and (n, 4, 3) velocities that rolling does not explain [m/s].

    All as seen from the base's origin.
    """
    moving = np.gradient(track.joint_position, track.time, axis=0)
    height, velocity = np.empty((len(track.time), 4)), np.empty((len(track.time), 4, 3))
    for part in at_once(len(track.time)):
        motion = legs.motion(track.joint_position[part], moving[part], track.angular_velocity_in_base[part])
        radius = legs.foot_radius[:, None] * up[part, None]
        height[part] = np.einsum("nli,ni->nl", motion.foot - radius, up[part])
        velocity[part] = motion.foot_velocity - cross(motion.foot_angular_velocity, radius)
    return height, velocity
