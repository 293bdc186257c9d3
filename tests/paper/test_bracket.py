"""Bracket of Algorithm 1 without a robot: lifts tip forward behind a given balancing offset and backward ahead of it."""

import numpy as np
import pytest

from equipoise.experiments.tilt import SupportPlane
from equipoise.paper.bracket import Bracket, TriedOffset, done, next_offset, step

START = Bracket(-0.06, 0.06, tolerance=0.005, highest_lift=0.04)


def lift(offset, verdict, lift_height=0.04):
    return TriedOffset(offset, lift_height, verdict)


def tipping_lift(offset, balance):
    return lift(offset, "forward" if offset < balance else "backward")


def search_path(bracket, balance):
    path = [bracket]
    while not done(path[-1]) and not path[-1].refuted:
        path.append(step(path[-1], tipping_lift(next_offset(path[-1]), balance)))
    return path


@pytest.mark.parametrize("balance", [-0.041, -0.0123, 0.001, 0.0301])
def test_the_bracket_halves_until_it_is_as_narrow_as_the_tolerance(balance):
    path = search_path(START, balance)
    assert [bracket.width for bracket in path] == pytest.approx([0.12 / 2**halving for halving in range(6)])
    assert all(bracket.lower < balance < bracket.upper for bracket in path)
    assert done(path[-1])
    assert (path[-1].at_lower.verdict, path[-1].at_upper.verdict) == ("forward", "backward")


def test_a_robot_that_stays_balanced_in_the_highest_lift_ends_the_search():
    bracket = step(START, lift(0.01, "balanced"))
    assert bracket.balanced
    assert done(bracket)
    assert (bracket.lower, bracket.middle, bracket.upper) == (0.01, 0.01, 0.01)


def test_a_lower_lift_without_a_tilt_does_not_change_the_bracket():
    assert step(START, lift(0.0, "balanced", lift_height=0.025)) is START


@pytest.mark.parametrize(("balance", "end"), [(-0.0599, -0.06), (0.0599, 0.06)])
def test_an_end_that_a_search_converges_to_is_tried_before_the_search_is_over(balance, end):
    path = search_path(START, balance)
    assert not done(path[-2])
    assert next_offset(path[-2]) == end
    assert done(path[-1])
    assert end in (path[-1].at_lower.offset, path[-1].at_upper.offset)


@pytest.mark.parametrize(("balance", "end"), [(-0.07, -0.06), (0.07, 0.06)])
def test_an_end_at_which_the_robot_tips_the_wrong_way_is_refuted(balance, end):
    bracket = search_path(START, balance)[-1]
    assert bracket.refuted
    assert not done(bracket)
    assert (bracket.lower, bracket.upper) == (end, end)


def test_a_widened_end_is_tried_first_and_then_the_middle():
    refuted = search_path(START, 0.07)[-1]
    widened = Bracket(0.06, 0.12, 0.005, 0.04, at_lower=refuted.at_lower, widened=True)
    assert next_offset(widened) == 0.12
    after = step(widened, tipping_lift(0.12, 0.07))
    assert not done(after)
    assert next_offset(after) == pytest.approx(0.09)


def test_a_search_does_not_end_with_crossed_or_equal_ends():
    crossed = step(step(START, lift(0.004, "forward")), lift(0.001, "backward"))
    assert not done(crossed)
    assert not done(step(step(START, lift(0.0, "forward")), lift(0.0, "backward")))


@pytest.mark.parametrize(("ahead", "behind", "at"), [(0.001, -0.003, 0.001), (0.003, -0.001, 0.003), (0.0, 0.0, 0.002)])
def test_the_plane_lies_nearer_to_the_end_at_which_the_robot_tipped_more_slowly(ahead, behind, at):
    ends = [SupportPlane(np.array([x, 0.0, 0.0]), np.array([1.0, 0.0, 0.0])) for x in (0.0, 0.004)]
    bracket = step(START, TriedOffset(0.0, 0.04, "forward", ends[0], ahead))
    assert bracket.plane is None  # the other end was not tried
    bracket = step(bracket, TriedOffset(0.004, 0.04, "backward", ends[1], behind))
    assert bracket.plane.point[0] == pytest.approx(at)
