"""Bracket of Algorithm 1: state, step and stop rule.

The search, the estimate from its recordings, Fig. 3 and the viewer apply `step` to one lift after the other.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from equipoise.experiments.tilt import SupportPlane, Verdict

_SAME_HEIGHT = 0.999  # heights are products of floats


@dataclass(frozen=True, eq=False)
class TriedOffset:
    """Result of one lift of a search.

    Attributes:
        offset: offset x_m of the support line along the base's x axis [m].
        lift_height: commanded height of the lifted feet [m].
        verdict: direction in which the robot tipped.
        plane: support plane at the nominal stance in the base frame, or None if it is not available.
        ahead: distance of the CoM from that plane, from the rate of tipping; positive: forward [m].
    """

    offset: float
    lift_height: float
    verdict: Verdict
    plane: SupportPlane | None = None
    ahead: float = 0.0


@dataclass(frozen=True, eq=False)
class Bracket:
    """Bounds between which the offset lies at which the robot balances.

    Attributes:
        lower, upper: offsets x_l and x_u of the support line along the base's x axis [m].
        tolerance: width of the bracket at which the search ends [m].
        highest_lift: lift height at which a robot that does not tip is balanced [m]; below it, the lift is repeated higher.
        at_lower, at_upper: lift tried at each end, tipping forward and backward; None if the end was not tried.
            Both are the same lift if the robot stayed balanced in it.
        widened: true if an end was moved outward because the robot tipped the wrong way there.
    """

    lower: float
    upper: float
    tolerance: float
    highest_lift: float
    at_lower: TriedOffset | None = None
    at_upper: TriedOffset | None = None
    widened: bool = False

    @property
    def middle(self) -> float:
        """Middle of the bracket, (x_l + x_u) / 2 [m]."""
        return (self.lower + self.upper) / 2

    @property
    def width(self) -> float:
        """Width x_u - x_l [m]; not positive if an end is refuted."""
        return self.upper - self.lower

    @property
    def balanced(self) -> bool:
        """True if the robot stayed balanced at an offset."""
        return self.at_lower is not None and self.at_lower is self.at_upper

    @property
    def plane(self) -> SupportPlane | None:
        """Support plane within the bracket, nearer to the end at which the robot tipped more slowly.

        None if the plane of an end is not available.
        """
        if self.at_lower is None or self.at_upper is None or self.at_lower.plane is None or self.at_upper.plane is None:
            return None
        ahead, behind = max(self.at_lower.ahead, 0.0), max(-self.at_upper.ahead, 0.0)
        share = ahead / (ahead + behind) if ahead + behind > 0 else 0.5
        return self.at_lower.plane.towards(self.at_upper.plane, share)

    @property
    def refuted(self) -> bool:
        """True if the robot tipped the wrong way at an end: the balancing offset is beyond it."""
        return self.width <= 0 and not self.balanced


def step(bracket: Bracket, tried: TriedOffset) -> Bracket:
    """Return the bracket after one more lift (Algorithm 1, lines 13 to 16)."""
    if tried.verdict == "forward":  # line 13: the CoM is ahead of the line
        return replace(bracket, lower=tried.offset, at_lower=tried)  # line 14
    if tried.verdict == "backward":
        return replace(bracket, upper=tried.offset, at_upper=tried)  # line 16
    if tried.lift_height < _SAME_HEIGHT * bracket.highest_lift:
        return bracket
    return replace(bracket, lower=tried.offset, upper=tried.offset, at_lower=tried, at_upper=tried)


def done(bracket: Bracket) -> bool:
    """Return true if the search is over (line 1) and both ends were tried."""
    tried = bracket.at_lower is not None and bracket.at_upper is not None
    return bracket.balanced or (tried and 0 < bracket.width <= bracket.tolerance)


def next_offset(bracket: Bracket) -> float:
    """Return the offset x_m to try next [m]: the middle (line 2), or an end that must be tried before the search is over."""
    if bracket.widened or bracket.width <= bracket.tolerance:
        if bracket.at_lower is None:
            return bracket.lower
        if bracket.at_upper is None:
            return bracket.upper
    return bracket.middle
