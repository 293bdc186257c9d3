"""Step 1 of the paper: the planar centre of mass by bisection (Algorithms 1 and 2).

The support line is moved by moving the body over planted feet: that puts the feet where the algorithm wants them in the
base frame without dragging them over the floor.

What the paper leaves open is what to do where the robot balances beyond the bounds: a search that converges to an end of
its bracket tries that end, and if the robot tips the wrong way there widens the bracket, once.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NoReturn

from equipoise.errors import MotionError, ReachError, SettingsError
from equipoise.paper.bracket import Bracket, done, next_offset, step
from equipoise.paper.lift_trial import LiftReading
from equipoise.paper.trial_runner import TrialRunner, check_offset, check_search
from equipoise.robot.model import DIAGONALS


@dataclass(frozen=True, eq=False)
class SupportVector:
    """Where one diagonal's search ended.

    Attributes:
        diagonal: diagonal that the robot stood on, "FL_RR" or "FR_RL".
        bracket: last bounds x_l and x_u [m]; equal if the robot stayed balanced there.
        lifts: lift trials in the order they were done.
    """

    diagonal: str
    bracket: Bracket
    lifts: tuple[LiftReading, ...]

    @property
    def offset(self) -> float:
        """x_m: the offset at which the robot balances [m]."""
        return self.bracket.middle


def find_com(runner: TrialRunner) -> tuple[SupportVector, SupportVector]:
    """Algorithm 2, FindCOM: one support line per diagonal. Where they cross is `find_intersection` (line 5)."""
    x_l, x_u = runner.settings.bounds(runner.stance)  # Algorithm 2, line 1
    check_search(runner.standing.robot, runner.stance, runner.settings)
    first = find_support_vector(runner, "FL_RR", x_u, x_l)  # line 3
    second = find_support_vector(runner, "FR_RL", x_u, x_l)  # line 4
    return first, second


def find_support_vector(runner: TrialRunner, diagonal: str, x_u: float, x_l: float) -> SupportVector:
    """Algorithm 1, FindSupportVector: the offset of one diagonal's support line that balances the robot.

    Line numbers are the paper's. Lines 3 to 12 are one call here: `TrialRunner.tilt_at` shifts the feet (3, 4), and
    `lift_trial` solves the inverse kinematics (5), moves until q is close to q_d (6-8), lifts the other diagonal's feet and
    waits for t_thres (9-12).

    Raises:
        MotionError: the robot tips the same way at both ends, also after widening once; it tips at both ends away from where
            its CoM must be; or it did not come to rest where it was sent.
    """
    if diagonal not in DIAGONALS:
        raise SettingsError(f"no diagonal is called {diagonal!r}; they are {', '.join(DIAGONALS)}")
    if not x_u > x_l:
        raise SettingsError(f"the search bounds are the wrong way round: upper {x_u} m is not above lower {x_l} m")
    lifts: list[LiftReading] = []
    bracket = first = Bracket(x_l, x_u, runner.settings.tolerance, runner.heights[-1])
    while not done(bracket):  # line 1
        x_m = next_offset(bracket)  # line 2
        tried = runner.tilt_at(diagonal, x_m, bracket, lifts)  # lines 3 to 12
        bracket = step(bracket, tried)  # lines 13 to 16
        if bracket.refuted:
            bracket = _widened(runner, diagonal, bracket, first, lifts)
    return SupportVector(diagonal, bracket, tuple(lifts))  # line 19


def _widened(runner: TrialRunner, diagonal: str, bracket: Bracket, first: Bracket, lifts: list[LiftReading]) -> Bracket:
    """A bracket with the refuted end farther out, by half the first one's width or as far as the legs reach.

    Raises:
        MotionError: it was widened before, or cannot be. The message names the IMU if the other end shows that its tilts have
            the wrong sign.
    """
    at_upper = bracket.at_upper is None
    end = bracket.upper if at_upper else bracket.lower
    if bracket.widened:
        _refuse(runner, diagonal, first, end, at_upper, lifts)
    wider = _reachable_end(runner, end, end + first.width / 2 if at_upper else end - first.width / 2)
    if abs(wider - end) <= bracket.tolerance:
        _refuse(runner, diagonal, first, wider, at_upper, lifts)
    moved = replace(bracket, upper=wider) if at_upper else replace(bracket, lower=wider)
    return replace(moved, widened=True)


def _refuse(
    runner: TrialRunner, diagonal: str, first: Bracket, farthest: float, at_upper: bool, lifts: list[LiftReading]
) -> NoReturn:
    """Say why no support line balances the robot: the CoM is elsewhere, or the IMU tells tilts the wrong way round."""
    other_end = first.lower if at_upper else first.upper
    lower, upper = sorted((other_end, farthest))
    tried = runner.tilt_at(diagonal, other_end, replace(first, lower=lower, upper=upper), lifts)
    recordings = tuple(lift.recording for lift in lifts)
    if tried.verdict == ("backward" if at_upper else "forward"):
        raise MotionError(
            f"on {diagonal} the robot tips away from its centre of mass at both ends of the search: the IMU seems mounted "
            "turned; give its pose under imu_rpy in a robot description",
            recordings,
        )
    side = "ahead of" if at_upper else "behind"
    raise MotionError(
        f"on {diagonal} the robot tips the same way at every support line from {lower * 1000:.0f} mm to "
        f"{upper * 1000:.0f} mm: its centre of mass is {side} all of them. Move the payload towards the "
        "middle, or give wider bounds if the legs reach them",
        recordings,
    )


def _reachable_end(runner: TrialRunner, near: float, far: float) -> float:
    """The farthest offset towards `far` that is safe to try [m]."""
    for fraction in (1.0, 0.75, 0.5, 0.25):
        candidate = near + fraction * (far - near)
        try:
            check_offset(runner.standing.robot, runner.stance, candidate, runner.heights[0])
        except ReachError:
            continue
        return candidate
    return near
