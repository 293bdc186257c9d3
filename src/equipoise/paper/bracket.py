"""The bracket of Algorithm 1: a state, a step and when it is done.

The search, the estimate from its recordings, Fig. 3 and the viewer fold this one over the lifts that were tried.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from equipoise.experiments.tilt import SupportPlane, Verdict

_SAME_HEIGHT = 0.999  # heights are products of floats


@dataclass(frozen=True, eq=False)
class TriedOffset:
    """What one lift of a search showed.

    Attributes:
        offset: offset x_m of the support line along the base's x axis [m].
        lift_height: commanded height of the lifted feet [m].
        verdict: direction in which the robot tipped.
        plane: support plane at the nominal stance in the base frame, or None if it is not at hand.
        ahead: distance of the CoM from that plane, by how fast the robot tipped; positive: forward [m].
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
        highest_lift: height from which on a robot that does not tip counts as balanced [m]; below, it is lifted higher.
        at_lower, at_upper: lift tried at each end, tipping forward and backward; None where an end is only assumed.
            The same lift, if the robot stayed balanced in it.
        widened: whether an end was moved outward because the robot tipped the wrong way there.
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
        """(x_l + x_u) / 2 [m]."""
        return (self.lower + self.upper) / 2

    @property
    def width(self) -> float:
        """x_u - x_l [m]; not positive once an end is refuted."""
        return self.upper - self.lower

    @property
    def balanced(self) -> bool:
        """Whether the robot stayed balanced at an offset."""
        return self.at_lower is not None and self.at_lower is self.at_upper

    @property
    def plane(self) -> SupportPlane | None:
        """The plane within the bracket: nearer to the end at which the robot tipped more slowly.

        None where the planes of both ends are not at hand.
        """
        if self.at_lower is None or self.at_upper is None or self.at_lower.plane is None or self.at_upper.plane is None:
            return None
        ahead, behind = max(self.at_lower.ahead, 0.0), max(-self.at_upper.ahead, 0.0)
        share = ahead / (ahead + behind) if ahead + behind > 0 else 0.5
        return self.at_lower.plane.towards(self.at_upper.plane, share)

    @property
    def refuted(self) -> bool:
        """Whether the robot tipped the wrong way at an end: the balance is beyond it."""
        return self.width <= 0 and not self.balanced


def step(bracket: Bracket, tried: TriedOffset) -> Bracket:
    """The bracket after one more lift (Algorithm 1, lines 13 to 16)."""
    if tried.verdict == "forward":  # line 13: the CoM is ahead of the line
        return replace(bracket, lower=tried.offset, at_lower=tried)  # line 14
    if tried.verdict == "backward":
        return replace(bracket, upper=tried.offset, at_upper=tried)  # line 16
    if tried.lift_height < _SAME_HEIGHT * bracket.highest_lift:
        return bracket
    return replace(bracket, lower=tried.offset, upper=tried.offset, at_lower=tried, at_upper=tried)


def done(bracket: Bracket) -> bool:
    """Whether the search is over (line 1), both its ends having been tried."""
    tried = bracket.at_lower is not None and bracket.at_upper is not None
    return bracket.balanced or (tried and 0 < bracket.width <= bracket.tolerance)


def next_offset(bracket: Bracket) -> float:
    """x_m, the offset to try next [m]: the middle (line 2), or an end that is left over or new and was never tried."""
    if bracket.widened or bracket.width <= bracket.tolerance:
        if bracket.at_lower is None:
            return bracket.lower
        if bracket.at_upper is None:
            return bracket.upper
    return bracket.middle
