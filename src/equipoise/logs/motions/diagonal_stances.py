"""Diagonal stances, and tests that they are lifts: from rest, by the legs, with the other feet standing."""

from __future__ import annotations

from collections.abc import Sequence

from equipoise.logs.motions.foot_paths import FootPaths
from equipoise.logs.motions.rests import LoggedRest
from equipoise.recording.runs import true_runs
from equipoise.recording.trials import Step
from equipoise.robot.model import DIAGONALS, LEG_NAMES
from equipoise.robot.stance import Stance

# On an A1; lengths and times are multiplied by those of the stance's scale.
_CLEAR = 2.5e-3  # [m] above the standing feet: off the floor, as lift_samples.py has it
_DRAWN_UP = (
    6e-3  # [m] by which a leg lifts its foot: at least 9 mm in lifts, 2 mm where another leg steps and the robot tips
)
_STANDING_SLID = 5e-3  # [m] of two standing feet against each other; below 1 mm in lifts
_SOON = 1.5  # [s] from the rest's end until two feet are up: the attitude drifts
_NEXT_STEP = 0.15  # [s]; feet that rise sooner after others came down walk
SHORTEST_STANCE = 0.05
"""[s] on an A1; shorter ones are not reported."""


def diagonal_stances(paths: FootPaths, stance: Stance) -> list[Step]:
    """Return the times in which the two feet off a diagonal are up, in order."""
    found: list[Step] = []
    for diagonal, standing in DIAGONALS.items():
        up = paths.rise_above(standing)[:, _lifted(diagonal)].min(axis=1) > _CLEAR * stance.scale.length
        spans = [(float(paths.time[first]), float(paths.time[last - 1])) for first, last in true_runs(up)]
        found += [Step(standing, a, b) for a, b in spans if b - a >= SHORTEST_STANCE * stance.scale.time]
    return sorted(found, key=lambda one: one.start)


def why_no_lift(paths: FootPaths, stances: Sequence[Step], rest: LoggedRest, stance: Stance) -> str | None:
    """Return the reason why the first diagonal stance after a rest is not a lift, or None.

    Args:
        paths: paths of the feet since that rest.
        stances: diagonal stances that follow the rest.
        stance: nominal stance of the robot.
    """
    scale, first = stance.scale, stances[0]
    for other in stances[1:]:
        if other.pair != first.pair and other.start - first.end < _NEXT_STEP * scale.time:
            return f"the other two feet rise {max(0.0, other.start - first.end):.2f} s after these came down: it walks"
    inside = (paths.time >= first.start) & (paths.time <= first.end)
    slid = float(paths.slid(DIAGONALS[first.pair])[paths.time <= first.end].max())
    if slid > _STANDING_SLID * scale.length:
        return f"the standing feet have moved by {slid * 1000:.0f} mm since the rest: they step or slip"
    if first.start - rest.end > _SOON * scale.time:
        return f"two feet go up {first.start - rest.end:.1f} s after the last rest: the attitude has drifted"
    lifted = _lifted(first.pair)
    drawn_up = paths.drawn_up - paths.drawn_up[:, [not up for up in lifted]].mean(axis=1, keepdims=True)
    if drawn_up[inside][:, lifted].min(axis=1).max() < _DRAWN_UP * scale.length:
        return "only one of the two feet is lifted, and the robot tips off the other"
    return None


def _lifted(diagonal: str) -> list[bool]:
    return [leg not in DIAGONALS[diagonal] for leg in LEG_NAMES]
