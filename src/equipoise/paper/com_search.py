"""Step 1 of the paper: planar CoM by bisection. `find_support_vector` is Algorithm 1, `find_com` is Algorithm 2.

The body moves over fixed feet. In the base frame this shifts the feet as the algorithm requires, without dragging them.

The paper assumes that the robot balances within the bounds. Here, a search that converges to one end tests the robot at
that end. If the robot tips outward there, the bracket is widened once.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NoReturn

from equipoise.errors import MotionError, ReachError
from equipoise.paper.bracket import Bracket, done, next_offset, step
from equipoise.paper.lift_trial import LiftReading
from equipoise.paper.trial_runner import TrialRunner, check_offset, check_search


def find_com(runner: TrialRunner) -> None:
    """Run Algorithm 2, FindCOM: find one support line per diagonal. `find_intersection` computes their crossing (line 5)."""
    x_l, x_u = runner.settings.bounds(runner.stance)  # Algorithm 2, line 1
    check_search(runner.standing.robot, runner.stance, runner.settings)
    find_support_vector(runner, "FL_RR", x_u, x_l)  # line 3
    find_support_vector(runner, "FR_RL", x_u, x_l)  # line 4


def find_support_vector(
    runner: TrialRunner, diagonal: str, x_u: float, x_l: float
) -> tuple[Bracket, list[LiftReading]]:
    """Run Algorithm 1, FindSupportVector: find the offset of one diagonal's support line that balances the robot.

    Line numbers are the paper's. Lines 3 to 12 are one call: `TrialRunner.tilt_at` shifts the feet (3, 4).
    `lift_trial` then solves the inverse kinematics (5), moves until q is close to q_d (6-8), lifts the other diagonal's feet
    and waits for t_thres (9-12).

    Returns:
        last bounds x_l and x_u, equal if the robot stayed balanced there; and the lift trials in the order they were done.

    Raises:
        MotionError: the robot tips the same way at both ends of the widened bracket; it tips away from its CoM at both ends;
            or it did not come to rest at its target.
    """
    lifts: list[LiftReading] = []
    bracket = first = Bracket(x_l, x_u, runner.settings.tolerance, runner.heights[-1])
    while not done(bracket):  # line 1
        x_m = next_offset(bracket)  # line 2
        tried = runner.tilt_at(diagonal, x_m, bracket, lifts)  # lines 3 to 12
        bracket = step(bracket, tried)  # lines 13 to 16
        if bracket.refuted:
            bracket = _widen(runner, diagonal, bracket, first, lifts)
    return bracket, lifts  # line 19


def _widen(runner: TrialRunner, diagonal: str, bracket: Bracket, first: Bracket, lifts: list[LiftReading]) -> Bracket:
    """Return a bracket with the refuted end moved out by half the first bracket's width, or as far as the legs reach.

    Raises:
        MotionError: the bracket was widened before or cannot be. The message names the IMU if the tilt at the other end has
            the wrong sign.
    """
    at_upper = bracket.at_upper is None
    end = bracket.upper if at_upper else bracket.lower
    if bracket.widened:
        _raise_unbalanced(runner, diagonal, first, end, at_upper, lifts)
    wider = _reachable_end(runner, end, end + first.width / 2 if at_upper else end - first.width / 2)
    if abs(wider - end) <= bracket.tolerance:
        _raise_unbalanced(runner, diagonal, first, wider, at_upper, lifts)
    moved = replace(bracket, upper=wider) if at_upper else replace(bracket, lower=wider)
    return replace(moved, widened=True)


def _raise_unbalanced(
    runner: TrialRunner, diagonal: str, first: Bracket, farthest: float, at_upper: bool, lifts: list[LiftReading]
) -> NoReturn:
    """Raise MotionError with the reason for an unsuccessful search: CoM outside the bounds, or IMU tilts of the wrong sign."""
    other_end = first.lower if at_upper else first.upper
    lower, upper = sorted((other_end, farthest))
    tried = runner.tilt_at(diagonal, other_end, replace(first, lower=lower, upper=upper), lifts)
    recordings = tuple(lift.recording for lift in lifts)
    if tried.verdict == ("backward" if at_upper else "forward"):
        raise MotionError(
            f"on {diagonal} the robot tips away from its centre of mass at both ends of the search: the orientation of the "
            "IMU is wrong; set imu_rpy in the robot configuration",
            recordings,
        )
    side = "ahead of" if at_upper else "behind"
    raise MotionError(
        f"on {diagonal} the robot tips the same way at every support line from {lower * 1000:.0f} mm to "
        f"{upper * 1000:.0f} mm: its centre of mass is {side} all of them. Move the payload towards the "
        "middle, or set wider bounds if the legs reach them",
        recordings,
    )


def _reachable_end(runner: TrialRunner, near: float, far: float) -> float:
    """Return the farthest safe offset of `far` and three evenly spaced ones before it; `near` if none is safe [m]."""
    for fraction in (1.0, 0.75, 0.5, 0.25):
        candidate = near + fraction * (far - near)
        try:
            check_offset(runner.standing.robot, runner.stance, candidate, runner.heights[0])
        except ReachError:
            continue
        return candidate
    return near
