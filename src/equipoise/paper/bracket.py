"""What a bisection does when it converges to an end of its bracket."""

from __future__ import annotations

from typing import NoReturn

from equipoise.errors import BracketError, ImuMountingError, ReachError
from equipoise.experiments.lift import LiftTrial
from equipoise.paper.trial_runner import TrialRunner, check_offset


def check_end(
    runner: TrialRunner,
    diagonal: str,
    x_l: float,
    x_u: float,
    first_l: float,
    first_u: float,
    trials: list[LiftTrial],
) -> tuple[float, float]:
    """A search converged to an end of its bracket, which was never tried: try it, and widen once if need be.

    Args:
        runner: does the trials.
        diagonal: that is searched.
        x_l, x_u: where the search converged [m].
        first_l, first_u: the bracket that it began with [m].
        trials: to append to.

    Returns:
        bounds that hold the balance, equal if the robot stayed balanced there: the old ones, or those of a widened
        bracket.

    Raises:
        BracketError: the robot tips the same way at both ends, also after widening once.
        ImuMountingError: at both ends it tips away from where its CoM must be.
    """
    at_upper = x_u == first_u
    end, expected = (x_u, "backward") if at_upper else (x_l, "forward")
    tilt = runner.tilt_at(diagonal, end, x_l, x_u, trials)
    if tilt == "balanced":
        return end, end
    if tilt == expected:
        return x_l, x_u
    width = (first_u - first_l) / 2
    wider = _reachable_end(runner, end, end + width if at_upper else end - width)
    if abs(wider - end) > runner.settings.tolerance:
        tilt = runner.tilt_at(diagonal, wider, min(end, wider), max(end, wider), trials)
        if tilt == "balanced":
            return wider, wider
        if tilt == expected:
            return min(end, wider), max(end, wider)
    _refuse_bracket(runner, diagonal, first_l if at_upper else first_u, not at_upper, wider, trials)


def _refuse_bracket(
    runner: TrialRunner, diagonal: str, other_end: float, other_is_upper: bool, wider: float, trials: list[LiftTrial]
) -> NoReturn:
    """Say why no support line balances the robot: the CoM is elsewhere, or the IMU tells tilts the wrong way round."""
    tilt = runner.tilt_at(diagonal, other_end, min(other_end, wider), max(other_end, wider), trials)
    recordings = tuple(trial.recording for trial in trials)
    if tilt == ("forward" if other_is_upper else "backward"):
        raise ImuMountingError(
            f"on {diagonal} the robot tips away from its centre of mass at both ends of the search: the IMU seems mounted "
            "turned; give its pose under imu_rpy in a robot description",
            recordings,
        )
    side = "behind" if other_is_upper else "ahead of"
    raise BracketError(
        f"on {diagonal} the robot tips the same way at every support line from {min(other_end, wider) * 1000:.0f} mm to "
        f"{max(other_end, wider) * 1000:.0f} mm: its centre of mass is {side} all of them. Move the payload towards the "
        "middle, or give wider bounds if the legs reach them",
        recordings,
    )


def _reachable_end(runner: TrialRunner, near: float, far: float) -> float:
    """The farthest offset towards `far` that is safe to try."""
    for fraction in (1.0, 0.75, 0.5, 0.25):
        candidate = near + fraction * (far - near)
        try:
            check_offset(runner.planted.robot, runner.stance, candidate, runner.heights[0])
        except ReachError:
            continue
        return candidate
    return near
